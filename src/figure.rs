//! Pictures of maps and curves: SVG for print, PNG for everybody, and the numbers beside them.
//!
//! A picture is plain data ([`HeatMap`], [`LineChart`], several of them in a [`Sheet`]) that
//! implements [`Figure`]; [`Figure::write`] puts `NAME.svg`, `NAME.png` and its tables as CSV into
//! a folder. The PNG is the SVG, rendered with a font that comes along, so it looks the same on a
//! machine without fonts. Nothing is computed here: what is drawn is what stands in the data and in
//! the CSV.
//!
//! ```
//! use stockpilot::figure::{Figure, HeatMap, Ink, Lattice, Overlay, Shape};
//!
//! let hills = HeatMap {
//!     title: "Two hills".to_owned(),
//!     grid: Lattice {
//!         x_min_m: 0.0,
//!         y_min_m: 0.0,
//!         cell_m: 1.0,
//!         n_cols: 2,
//!         values: vec![0.0, 1.0, f64::NAN, 0.5],
//!     },
//!     quantity: "height (m)".to_owned(),
//!     range: None,
//!     is_signed: false,
//!     overlays: vec![Overlay::new("flight", Shape::Path, Ink::Red, vec![[0.2, 0.1], [1.8, 1.5]])],
//! };
//! assert!(hills.svg()?.starts_with("<svg"));
//! assert!(hills.png()?.starts_with(b"\x89PNG"));
//! # Ok::<(), stockpilot::figure::FigureError>(())
//! ```

mod canvas;
mod class_map;
mod heat_map;
mod legend;
mod line_chart;
mod overlay;
mod raster;
mod sheet;
mod table;
#[cfg(test)]
mod tests;
mod ticks;

pub use class_map::ClassMap;
pub use heat_map::{HeatMap, Lattice};
pub use line_chart::{Axis, Band, LineChart, Series, Stroke};
pub use overlay::{Ink, Overlay, Shape};
pub use sheet::Sheet;
pub use table::Table;

use std::path::{Path, PathBuf};

/// A picture could not be made.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// The data contradicts itself.
    #[error("figure {title:?} cannot be drawn: {reason}")]
    BadData {
        /// Of the figure.
        title: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The drawing library refused.
    #[error("cannot draw: {0}")]
    Draw(String),
    /// A file could not be written.
    #[error("cannot write {path}")]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        #[source]
        source: std::io::Error,
    },
}

/// Something that can be drawn.
pub trait Figure {
    /// The picture as SVG; texts stay texts.
    ///
    /// # Errors
    /// Data that contradicts itself.
    fn svg(&self) -> Result<String, FigureError>;

    /// The numbers that are drawn, one table for each kind.
    fn tables(&self) -> Vec<Table>;

    /// The picture as PNG, two pixels for each unit of the SVG.
    ///
    /// # Errors
    /// As [`Self::svg`].
    fn png(&self) -> Result<Vec<u8>, FigureError> {
        raster::png(&self.svg()?)
    }

    /// Writes `NAME.svg`, `NAME.png`, and each table as `NAME.csv` or `NAME.KIND.csv`; the folder
    /// must exist, files of the same names are replaced.
    ///
    /// # Errors
    /// As [`Self::svg`], and files that cannot be written.
    fn write(&self, folder: &Path, name: &str) -> Result<(), FigureError> {
        self.write_pictures(folder, name)?;
        for table in self.tables() {
            let kind =
                if table.kind.is_empty() { String::new() } else { format!(".{}", table.kind) };
            write_file(&folder.join(format!("{name}{kind}.csv")), table.csv().as_bytes())?;
        }
        Ok(())
    }

    /// Writes `NAME.svg` and `NAME.png` alone.
    ///
    /// # Errors
    /// As [`Self::write`].
    fn write_pictures(&self, folder: &Path, name: &str) -> Result<(), FigureError> {
        let svg = self.svg()?;
        write_file(&folder.join(format!("{name}.png")), &raster::png(&svg)?)?;
        write_file(&folder.join(format!("{name}.svg")), svg.as_bytes())
    }
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), FigureError> {
    std::fs::write(path, bytes)
        .map_err(|source| FigureError::Write { path: path.to_owned(), source })
}
