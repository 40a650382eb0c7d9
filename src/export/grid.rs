//! Numbers on the surface's cells as an ASCII grid of Esri.

use super::Surface;
use std::fmt::Write as _;

/// What stands for no value.
const NO_DATA: &str = "-9999";

/// One number for each cell, such as its height or its σ; cells that do not count have none.
///
/// The numbers read back to the last bit, so that a survey may be the base of a later one.
#[must_use]
pub fn esri_grid(surface: Surface<'_>, values: &[f64]) -> String {
    let grid = &surface.map.grid;
    // Writing into a text cannot fail.
    let mut text = String::new();
    let _ok = write!(
        text,
        "ncols {}\nnrows {}\nxllcorner {}\nyllcorner {}\ncellsize {}\nNODATA_value {NO_DATA}\n",
        grid.n_cols, grid.n_rows, grid.x_min_m, grid.y_min_m, grid.cell_m
    );
    for (index, cell) in surface.cells_from_above().enumerate() {
        let end = if (index + 1) % grid.n_cols == 0 { '\n' } else { ' ' };
        let _ok = match values.get(cell).filter(|v| surface.counts(cell) && v.is_finite()) {
            Some(value) => write!(text, "{value}{end}"),
            None => write!(text, "{NO_DATA}{end}"),
        };
    }
    text
}
