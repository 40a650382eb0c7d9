//! Ground that a survey has left out, and what it makes of the uncertainty: where another flight would
//! look.
//!
//! A gap is a patch of neighbouring cells that count and that no beam has hit, or in which something has
//! moved since. Single cells between hits are none: the surface bridges them.
//!
//! ```text
//! Var(V) = Σ w_i Cov(h_i, V) + s_i,   share of a gap = Σ over its cells / Σ over all cells
//! ```
//! - `w_i`: area that the cell stands for, m²; `Cov(h_i, V)`: m⁴
//! - `s_i`: the cell's part of what patches of unseen ground add ([`super::unseen_patch`]), m⁶
//!
//! That is how the field has it; the cells of the paper's grid are independent, and each has `w_i² Var(h_i)`. The sum over all
//! cells is exact; a part of it says how much of the variance goes through these cells,
//! not what would be left once they are measured: their neighbours are correlated with them.

use crate::messages::{CellCoverage, GridGeometry};

/// Ground that was left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Gap {
    /// Its cells, by number, ascending.
    pub cells: Vec<usize>,
    /// Its area, m².
    pub area_m2: f64,
    /// Its middle in the hall, x and y, m.
    pub centre_m: [f64; 2],
    /// Share of the surface's variance of the volume that goes through it, 0 to 1.
    pub share: f64,
}

/// Smaller patches are bridged well enough, m².
const LEAST_AREA_M2: f64 = 0.5;
/// What makes less of the variance is not worth a start.
const LEAST_SHARE: f64 = 0.005;
/// A person, and a battery, have no use for more.
const MOST_GAPS: usize = 12;

/// The gaps of a surface, the one with the largest share first.
///
/// - `areas_m2`: by cell, what of it counts
/// - `coverage`: by cell, how it is known
/// - `var_m6`: by cell, its summand of the variance of the volume
#[must_use]
pub fn gaps(
    grid: &GridGeometry,
    areas_m2: &[f64],
    coverage: &[CellCoverage],
    var_m6: &[f64],
) -> Vec<Gap> {
    let ground: Vec<Ground> = std::iter::zip(areas_m2, coverage)
        .map(|(area_m2, state)| match state {
            _ if *area_m2 <= 0.0 => Ground::None,
            CellCoverage::Measured => Ground::Seen,
            _ => Ground::Open,
        })
        .collect();
    let whole_m6: f64 = var_m6.iter().sum();
    let mut found: Vec<Gap> = patches(grid, &ground)
        .into_iter()
        .map(|cells| gap(grid, areas_m2, var_m6, whole_m6, cells))
        .filter(|gap| gap.area_m2 >= LEAST_AREA_M2 && gap.share >= LEAST_SHARE)
        .collect();
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    found.truncate(MOST_GAPS);
    found
}

fn gap(
    grid: &GridGeometry,
    areas_m2: &[f64],
    var_m6: &[f64],
    whole_m6: f64,
    cells: Vec<usize>,
) -> Gap {
    let sum = |of: &dyn Fn(usize) -> f64| cells.iter().map(|cell| of(*cell)).sum::<f64>();
    let area_m2 = sum(&|cell| areas_m2[cell]);
    let centre_m = [
        sum(&|cell| areas_m2[cell] * grid.centre_m(cell).0) / area_m2,
        sum(&|cell| areas_m2[cell] * grid.centre_m(cell).1) / area_m2,
    ];
    let share = if whole_m6 > 0.0 { sum(&|cell| var_m6[cell]) / whole_m6 } else { 0.0 };
    Gap { cells, area_m2, centre_m, share }
}

/// What a cell is to gaps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ground {
    /// It does not count: a wall, or beside the bays.
    None,
    Seen,
    Open,
}

/// Open cells that hang together: patches grow from cells none of whose four neighbours was seen, and take
/// in the open cells beside those.
fn patches(grid: &GridGeometry, ground: &[Ground]) -> Vec<Vec<usize>> {
    let is_open = |cell: usize| ground[cell] == Ground::Open;
    let is_core = |cell: usize| {
        is_open(cell) && neighbours(grid, cell, false).all(|beside| ground[beside] != Ground::Seen)
    };
    let mut is_taken = vec![false; ground.len()];
    let mut patches = Vec::new();
    for seed in 0..ground.len() {
        if is_taken[seed] || !is_core(seed) {
            continue;
        }
        is_taken[seed] = true;
        let mut cells = vec![seed];
        let mut next = 0;
        while let Some(cell) = cells.get(next).copied() {
            next += 1;
            if !is_core(cell) {
                continue;
            }
            for neighbour in neighbours(grid, cell, true) {
                if is_open(neighbour) && !is_taken[neighbour] {
                    is_taken[neighbour] = true;
                    cells.push(neighbour);
                }
            }
        }
        cells.sort_unstable();
        patches.push(cells);
    }
    patches
}

/// The cells beside a cell, with or without those at its corners.
fn neighbours(
    grid: &GridGeometry,
    cell: usize,
    with_corners: bool,
) -> impl Iterator<Item = usize> + '_ {
    let (row, col) = (cell / grid.n_cols, cell % grid.n_cols);
    let rows = row.saturating_sub(1)..=(row + 1).min(grid.n_rows - 1);
    rows.flat_map(move |r| {
        let cols = col.saturating_sub(1)..=(col + 1).min(grid.n_cols - 1);
        cols.filter(move |c| (r, *c) != (row, col) && (with_corners || r == row || *c == col))
            .map(move |c| grid.index(c, r))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: GridGeometry =
        GridGeometry { x_min_m: 10.0, y_min_m: -2.0, cell_m: 0.5, n_cols: 8, n_rows: 6 };

    /// `#` was not hit, `.` was, ` ` does not count; the first line is the row at the largest y.
    fn drawn(lines: [&str; 6]) -> (Vec<f64>, Vec<CellCoverage>) {
        let cells = || lines.iter().rev().flat_map(|line| line.chars());
        let area_m2 = |c| if c == ' ' { 0.0 } else { 0.25 };
        let state = |c| match c {
            '#' => CellCoverage::Unseen,
            '~' => CellCoverage::Disturbed,
            _ => CellCoverage::Measured,
        };
        (cells().map(area_m2).collect(), cells().map(state).collect())
    }

    #[test]
    fn patches_are_found_with_their_area_place_and_share() {
        let (areas_m2, coverage) = drawn([
            "###.....", //
            "###.....", //
            "###..#..", //
            ".....#..", //
            ".#....~~", //
            "......~~",
        ]);
        // Each cell of the upper gap has nine times the weight of the others.
        let var_m6: Vec<f64> =
            (0..48).map(|cell| if cell / 8 >= 3 && cell % 8 < 3 { 9.0 } else { 1.0 }).collect();
        let found = gaps(&GRID, &areas_m2, &coverage, &var_m6);
        // The single cell and the two in a row are bridged.
        assert_eq!(found.len(), 2, "{found:?}");
        let [upper, lower] = [&found[0], &found[1]];
        assert_eq!((upper.cells.len(), lower.cells.len()), (9, 4));
        assert!((upper.area_m2 - 2.25).abs() < 1e-12 && (lower.area_m2 - 1.0).abs() < 1e-12);
        let is_at = |gap: &Gap, [x, y]: [f64; 2]| {
            (gap.centre_m[0] - x).abs() < 1e-12 && (gap.centre_m[1] - y).abs() < 1e-12
        };
        assert!(is_at(upper, [10.75, 0.25]) && is_at(lower, [13.5, -1.5]));
        // 9 · 9 and 4 of 81 + 39.
        assert!((upper.share - 81.0 / 120.0).abs() < 1e-12);
        assert!((lower.share - 4.0 / 120.0).abs() < 1e-12);
    }

    #[test]
    fn what_does_not_count_is_no_gap_and_does_not_join_gaps() {
        let (areas_m2, coverage) = drawn([
            "###  ###", //
            "###  ###", //
            "###  ###", //
            "        ", //
            "        ", //
            "........",
        ]);
        let coverage: Vec<_> = std::iter::zip(&areas_m2, coverage)
            .map(|(area_m2, state)| if *area_m2 > 0.0 { state } else { CellCoverage::Unseen })
            .collect();
        let found = gaps(&GRID, &areas_m2, &coverage, &[1.0; 48]);
        assert_eq!(found.iter().map(|gap| gap.cells.len()).collect::<Vec<_>>(), [9, 9]);
    }

    #[test]
    fn a_survey_without_a_gap_has_none() {
        let coverage = vec![CellCoverage::Measured; 48];
        assert!(gaps(&GRID, &[0.25; 48], &coverage, &[1.0; 48]).is_empty());
        // Nothing known of the variance is no reason to divide by it.
        assert!(gaps(&GRID, &[0.25; 48], &[CellCoverage::Unseen; 48], &[0.0; 48]).is_empty());
    }
}
