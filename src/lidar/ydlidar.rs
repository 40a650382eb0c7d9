//! YDLIDAR sensors (X2, X4, G4, TG15, TG30, TG50, T-mini Pro): `AA 55` packets.
//!
//! | offset | size | field |
//! | --- | --- | --- |
//! | 0 | 2 | `AA 55` |
//! | 2 | 1 | bit 0: a turn begins (one sample); above: scan rate, 0.1 Hz |
//! | 3 | 1 | samples, 1 to 80 |
//! | 4 | 2 | angle of the first sample, 1/64° above a check bit |
//! | 6 | 2 | angle of the last sample |
//! | 8 | 2 | XOR of all other 16-bit words |
//! | 10 | | samples: distance u16, or intensity u8 and distance u16 |
//!
//! Triangulating models measure beside the head's angle, by an amount that depends on the
//! distance; [`Geometry`] corrects it. Commands are `A5 xx`, replies those of RPLIDAR. The X2 only
//! talks.
//!
//! Source: `YDLidar-SDK` 1.2.20 (`ydlidar_protocol.h`, `YDlidarDriver.cpp`, `doc/Dataset.md`). The
//! SDK stores negative corrected angles wrongly; here they are wrapped into the turn.

mod geometry;
mod packet;
mod parser;
mod session;

pub use geometry::Geometry;
pub use packet::SampleFormat;
pub use parser::{Arrived, PacketParser};
pub use session::Ydlidar;
pub(super) use session::model_of;
