//! Heights on a grid as a text file: the ASCII grid of Esri, which GIS programs read and write.
//!
//! ```text
//! ncols 3
//! nrows 2
//! xllcorner -1.0          the outer corner with the smallest x (or xllcenter, the cell's centre)
//! yllcorner 2.0
//! cellsize 0.25
//! NODATA_value -9999      may be left out
//! 0.31 0.33 0.35          the row with the largest y comes first
//! 0.29 -9999 0.30
//! ```
//! Words of the header may be in capitals. Lengths are metres in the hall.
//!
//! Source: Esri, "ASCII raster format" (also GDAL's driver `AAIGrid`).

use crate::messages::GridGeometry;

/// Numbers on a grid; a cell without one is NaN.
#[derive(Debug, Clone, PartialEq)]
pub struct AsciiGrid {
    /// Where the cells are.
    pub grid: GridGeometry,
    /// One number per cell, in the order of the grid.
    pub values: Vec<f64>,
}

/// Why a text is no grid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AsciiGridError {
    /// A word of the header is missing.
    #[error("the header has no {key}")]
    MissingKey {
        /// The word.
        key: &'static str,
    },
    /// Something that is not a number, or not a possible one.
    #[error("line {line}: {word:?} is not a number that can stand here")]
    BadNumber {
        /// Line, counted from 1.
        line: usize,
        /// What stands there.
        word: String,
    },
    /// The number of values is not the number of cells.
    #[error("{got} values for {expected} cells")]
    WrongCount {
        /// How many values there are.
        got: usize,
        /// How many cells there are.
        expected: usize,
    },
}

/// What stands for no value unless the header says otherwise.
const DEFAULT_NO_DATA: f64 = -9999.0;
/// More cells than this per side are no hall.
const MAX_SIDE: f64 = 10_000.0;

#[derive(Default)]
struct Header {
    n_cols: Option<usize>,
    n_rows: Option<usize>,
    cell_m: Option<f64>,
    x_corner_m: Option<f64>,
    y_corner_m: Option<f64>,
    x_centre_m: Option<f64>,
    y_centre_m: Option<f64>,
    no_data: Option<f64>,
}

impl Header {
    /// Takes in a line that begins with a word; false if it is none of the header.
    fn take(&mut self, key: &str, line: usize, word: &str) -> Result<bool, AsciiGridError> {
        let value = number(line, word)?;
        match key.to_ascii_lowercase().as_str() {
            "ncols" => self.n_cols = Some(count(line, word, value)?),
            "nrows" => self.n_rows = Some(count(line, word, value)?),
            "cellsize" if value > 0.0 => self.cell_m = Some(value),
            "xllcorner" => self.x_corner_m = Some(value),
            "yllcorner" => self.y_corner_m = Some(value),
            "xllcenter" => self.x_centre_m = Some(value),
            "yllcenter" => self.y_centre_m = Some(value),
            "nodata_value" => self.no_data = Some(value),
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn geometry(&self) -> Result<GridGeometry, AsciiGridError> {
        let missing = |key| AsciiGridError::MissingKey { key };
        let cell_m = self.cell_m.ok_or_else(|| missing("cellsize"))?;
        let corner = |corner: Option<f64>, centre: Option<f64>| {
            corner.or_else(|| centre.map(|centre| centre - cell_m / 2.0))
        };
        Ok(GridGeometry {
            x_min_m: corner(self.x_corner_m, self.x_centre_m)
                .ok_or_else(|| missing("xllcorner"))?,
            y_min_m: corner(self.y_corner_m, self.y_centre_m)
                .ok_or_else(|| missing("yllcorner"))?,
            cell_m,
            n_cols: self.n_cols.ok_or_else(|| missing("ncols"))?,
            n_rows: self.n_rows.ok_or_else(|| missing("nrows"))?,
        })
    }
}

fn number(line: usize, word: &str) -> Result<f64, AsciiGridError> {
    let refuse = || AsciiGridError::BadNumber { line, word: word.to_owned() };
    word.parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(refuse)
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "checked to be a small whole number"
)]
fn count(line: usize, word: &str, value: f64) -> Result<usize, AsciiGridError> {
    let is_count = value.fract() == 0.0 && (1.0..=MAX_SIDE).contains(&value);
    let refuse = || AsciiGridError::BadNumber { line, word: word.to_owned() };
    is_count.then_some(value as usize).ok_or_else(refuse)
}

/// Reads a grid.
///
/// # Errors
/// What is missing or wrong, with its line.
pub fn parse(text: &str) -> Result<AsciiGrid, AsciiGridError> {
    let mut header = Header::default();
    let mut values = Vec::new();
    for (line, content) in (1..).zip(text.lines()) {
        let mut words = content.split_whitespace();
        if let [key, word] = content.split_whitespace().collect::<Vec<_>>()[..]
            && values.is_empty()
            && key.starts_with(|c: char| c.is_ascii_alphabetic())
            && header.take(key, line, word)?
        {
            continue;
        }
        words.try_for_each(|word| number(line, word).map(|value| values.push(value)))?;
    }
    let grid = header.geometry()?;
    if values.len() != grid.n_cells() {
        let (got, expected) = (values.len(), grid.n_cells());
        return Err(AsciiGridError::WrongCount { got, expected });
    }
    let no_data = header.no_data.unwrap_or(DEFAULT_NO_DATA);
    // Rows come from the largest y down.
    let upwards = values.chunks_exact(grid.n_cols).rev().flatten();
    #[expect(clippy::float_cmp, reason = "the marker is written as it is read")]
    let values = upwards.map(|&v| if v == no_data { f64::NAN } else { v }).collect();
    Ok(AsciiGrid { grid, values })
}

/// Writes one number per cell of a grid; what is not finite becomes the marker for no value.
/// Numbers come back to the last bit.
#[must_use]
pub fn write(grid: &GridGeometry, values: &[f64]) -> String {
    let mut text = format!(
        "ncols {}\nnrows {}\nxllcorner {}\nyllcorner {}\ncellsize {}\nNODATA_value {}\n",
        grid.n_cols, grid.n_rows, grid.x_min_m, grid.y_min_m, grid.cell_m, DEFAULT_NO_DATA
    );
    for row in values.chunks(grid.n_cols).rev() {
        let words: Vec<String> = row.iter().map(|value| word_of(*value)).collect();
        text.push_str(&words.join(" "));
        text.push('\n');
    }
    text
}

fn word_of(value: f64) -> String {
    if value.is_finite() { value.to_string() } else { DEFAULT_NO_DATA.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXAMPLE: &str = "ncols 3\nNROWS 2\nxllcorner -1.0\nyllcenter 2.125\ncellsize 0.25\n\
                           NODATA_value -1\n0.31 0.33 0.35\n0.29 -1 0.30\n";

    #[test]
    fn the_first_row_has_the_largest_y() {
        let read = parse(EXAMPLE).expect("a grid");
        let expected =
            GridGeometry { x_min_m: -1.0, y_min_m: 2.0, cell_m: 0.25, n_cols: 3, n_rows: 2 };
        assert_eq!(read.grid, expected);
        let at = |x, y| read.values[read.grid.cell_at(x, y).expect("inside")];
        assert!((at(-0.9, 2.1) - 0.29).abs() < 1e-15 && (at(-0.3, 2.4) - 0.35).abs() < 1e-15);
        assert!(at(-0.6, 2.1).is_nan());
    }

    #[test]
    fn what_is_written_comes_back_exactly() {
        let grid = GridGeometry { x_min_m: 0.1, y_min_m: -7.3, cell_m: 0.3, n_cols: 4, n_rows: 3 };
        let values: Vec<f64> = (0..12).map(|i| (f64::from(i) * 0.7).sin() / 3.0).collect();
        assert_eq!(parse(&write(&grid, &values)).expect("a grid"), AsciiGrid { grid, values });
    }

    #[test]
    fn broken_texts_are_refused_with_their_place() {
        let refused = |text: String| parse(&text).unwrap_err().to_string();
        assert_eq!(
            refused(EXAMPLE.replace("0.33", "x")),
            "line 7: \"x\" is not a number that can stand here"
        );
        assert_eq!(refused(EXAMPLE.replace("0.33 ", "")), "5 values for 6 cells");
        assert_eq!(refused(EXAMPLE.replace("ncols 3\n", "")), "the header has no ncols");
        assert!(refused(EXAMPLE.replace("ncols 3", "ncols 2.5")).contains("line 1"));
        assert!(refused(EXAMPLE.replace("0.25", "-0.25")).contains("line 5"));
        assert!(refused(EXAMPLE.replace("0.35", "nan")).contains("line 7"));
        assert!(refused(String::new()).contains("cellsize"));
    }
}
