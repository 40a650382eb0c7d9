//! The hall's own reference system.

/// The hall as an engineering reference system: metres, x and y on the floor.
///
/// Version 1 of WKT, because LAS 1.4 and `.prj` files want it; readers make an engineering system of it.
/// Source: OGC 01-009, 7.2 (`LOCAL_CS`); ASPRS LAS 1.4-R15, 3.6.
pub const WKT: &str = "LOCAL_CS[\"stockpilot hall\",LOCAL_DATUM[\"hall, by its marker map\",0],\
    UNIT[\"metre\",1],AXIS[\"x\",EAST],AXIS[\"y\",NORTH]]";

/// Its name where only a name is wanted.
pub const NAME: &str = "stockpilot hall";
