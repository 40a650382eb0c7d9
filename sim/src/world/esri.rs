//! ESRI ASCII grids.

use super::{HeightField, WorldError};

/// From the units of a grid file to metres in the hall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridScale {
    /// Hall metres for one horizontal unit of the file.
    pub xy: f64,
    /// Hall metres for one vertical unit of the file.
    pub z: f64,
}

/// What stands above the heights.
#[derive(Debug, Clone, Copy)]
struct Header {
    n_cols: usize,
    n_rows: usize,
    cell: f64,
    nodata: Option<f64>,
}

const KEYS: [&str; 5] = ["ncols", "nrows", "xll", "yll", "cellsize"];

/// Reads a grid; heights count from its lowest cell, and its first row becomes the highest y.
pub(super) fn parse(text: &str, scale: GridScale) -> Result<HeightField, WorldError> {
    let mut lines = text.lines().enumerate().map(|(i, line)| (i + 1, line)).peekable();
    let mut numbers = [0.0; KEYS.len()];
    for (number, key) in numbers.iter_mut().zip(KEYS) {
        let (line, content) = lines.next().unwrap_or((1, ""));
        *number = header_number(content, key, line)?;
    }
    let nodata = match lines.peek() {
        Some((line, content)) if is_nodata(content) => {
            Some(header_number(content, "nodata_value", *line)?)
        }
        _ => None,
    };
    if nodata.is_some() {
        lines.next();
    }
    let header = Header {
        n_cols: count(numbers[0], "ncols", 1)?,
        n_rows: count(numbers[1], "nrows", 2)?,
        cell: numbers[4],
        nodata,
    };
    let heights = heights(lines, &header)?;
    standing_on_floor(&heights, &header, scale)
}

fn is_nodata(line: &str) -> bool {
    line.trim_start().to_ascii_lowercase().starts_with("nodata_value")
}

/// The number of a header line such as `cellsize 46`.
fn header_number(content: &str, key: &'static str, line: usize) -> Result<f64, WorldError> {
    let mut words = content.split_whitespace();
    let is_key = words.next().is_some_and(|word| word.to_ascii_lowercase().starts_with(key));
    let number = words.next().and_then(|word| word.parse::<f64>().ok()).filter(|n| n.is_finite());
    let bad = || WorldError::BadHeader { line, key, found: content.trim().to_owned() };
    number.filter(|_| is_key).ok_or_else(bad)
}

/// A whole number of columns or rows, at most 100 000.
fn count(number: f64, key: &'static str, line: usize) -> Result<usize, WorldError> {
    let is_count = number.fract() == 0.0 && (2.0..=1e5).contains(&number);
    let bad = || WorldError::BadHeader { line, key, found: number.to_string() };
    is_count.then(|| super::height_field::index_from(number)).ok_or_else(bad)
}

/// All heights in the file's order and units.
fn heights<'a>(
    lines: impl Iterator<Item = (usize, &'a str)>,
    header: &Header,
) -> Result<Vec<f64>, WorldError> {
    let expected = header.n_cols * header.n_rows;
    let mut heights = Vec::new();
    let mut last_line = 0;
    for (line, content) in lines {
        last_line = line;
        for word in content.split_whitespace() {
            heights.push(height(word, line, header.nodata)?);
        }
        if heights.len() > expected {
            return Err(WorldError::WrongCount { line, found: heights.len(), expected });
        }
    }
    let found = heights.len();
    let short = WorldError::WrongCount { line: last_line, found, expected };
    if found == expected { Ok(heights) } else { Err(short) }
}

fn height(word: &str, line: usize, nodata: Option<f64>) -> Result<f64, WorldError> {
    let value = word.parse::<f64>().ok().filter(|value| value.is_finite());
    let value = value.ok_or_else(|| WorldError::BadHeight { line, found: word.to_owned() })?;
    match nodata {
        Some(nodata) if (value - nodata).abs() < 1e-6 => Err(WorldError::NoData { line, nodata }),
        _ => Ok(value),
    }
}

/// The field with rows from south to north and its lowest cell at 0.
fn standing_on_floor(
    heights: &[f64],
    header: &Header,
    scale: GridScale,
) -> Result<HeightField, WorldError> {
    let lowest = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let south_first = heights.chunks_exact(header.n_cols).rev().flatten();
    let heights_m = south_first.map(|h| (h - lowest) * scale.z).collect();
    HeightField::new((0.0, 0.0), header.cell * scale.xy, header.n_cols, heights_m)
}
