//! Surfaces and point clouds as files that other programs read.
//!
//! | file | form | read by |
//! | --- | --- | --- |
//! | `height.tif` | GeoTIFF, two bands: height and its σ, double precision | GIS programs |
//! | `height.asc`, `sigma.asc` | ASCII grids of Esri, each with a `.prj` | GIS programs; a base of a later survey |
//! | `hits.laz` | LAS 1.4, compressed | point-cloud programs |
//! | `hits.ply` | binary PLY | 3-D programs |
//! | `surface.obj` | triangles between the cells' centres | 3-D programs |
//!
//! All coordinates are metres in the hall's own frame, z up. It has no place on the earth, and says so:
//! every form that can names an engineering reference system ([`crs::WKT`]), because without one GIS
//! programs refuse or guess.

pub mod crs;

mod cloud;
mod digest;
mod geotiff;
mod grid;
mod mesh;

pub use cloud::{Cloud, laz, ply};
pub use digest::{sha256_of_bytes, sha256_of_file};
pub use geotiff::geotiff;
pub use grid::esri_grid;
pub use mesh::obj;

use crate::messages::HeightMap;

/// Why a file cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The grid is empty or too large for the form.
    #[error("a map of {n_cols} × {n_rows} cells cannot be exported")]
    Size {
        /// Cells along x.
        n_cols: usize,
        /// Cells along y.
        n_rows: usize,
    },
    /// From the writer of TIFF.
    #[error("GeoTIFF: {0}")]
    Tiff(#[from] tiff::TiffError),
    /// From the writer of LAS.
    #[error("LAS: {0}")]
    Las(#[from] las::Error),
}

/// A surface, and which of its cells count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface<'a> {
    /// Heights and their σ.
    pub map: &'a HeightMap,
    /// By cell: it counts; the others are exported as cells without a value.
    pub counts: &'a [bool],
}

impl Surface<'_> {
    /// Numbers of the cells in the order of pictures: the row with the largest y first.
    fn cells_from_above(&self) -> impl Iterator<Item = usize> + '_ {
        let grid = &self.map.grid;
        (0..grid.n_rows)
            .rev()
            .flat_map(move |row| (0..grid.n_cols).map(move |col| grid.index(col, row)))
    }

    fn counts(&self, cell: usize) -> bool {
        self.counts.get(cell).copied().unwrap_or(false)
    }
}

#[cfg(test)]
mod tests;
