//! Which part of a volume was measured, which lies between measurements, which nobody saw, and where
//! something moved.

use super::disturbance::Flagged;
use crate::messages::{CellCoverage, GridGeometry, VolumeShares};
use std::collections::VecDeque;

/// Seen cells reach this far into what lies between them, in practical ranges of the material: at
/// half of it a height is still correlated by 0.45 (ν = 1).
const INTERPOLATED_RANGES: f64 = 0.5;

/// Cells that a beam has hit, and how far the others are from one.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenCells {
    /// Steps to the nearest cell that was hit: 0 for itself, `u32::MAX` where there is none.
    steps: Vec<u32>,
    cell_m: f64,
    /// Cells that something has moved in since they were hit.
    disturbed: Flagged,
}

impl SeenCells {
    /// Measures the way from every cell to the nearest one that was hit, along the grid.
    #[must_use]
    pub fn new(grid: &GridGeometry, is_hit: &[bool], disturbed: Flagged) -> Self {
        let mut steps = vec![u32::MAX; grid.n_cells()];
        let mut queue = VecDeque::new();
        for (cell, _) in is_hit.iter().enumerate().filter(|(_, is_hit)| **is_hit) {
            steps[cell] = 0;
            queue.push_back(cell);
        }
        while let Some(cell) = queue.pop_front() {
            let (row, col) = (cell / grid.n_cols, cell % grid.n_cols);
            let mut visit = |is_inside: bool, neighbour: usize| {
                if is_inside && steps[neighbour] == u32::MAX {
                    steps[neighbour] = steps[cell] + 1;
                    queue.push_back(neighbour);
                }
            };
            visit(col > 0, cell.wrapping_sub(1));
            visit(col + 1 < grid.n_cols, cell + 1);
            visit(row > 0, cell.wrapping_sub(grid.n_cols));
            visit(row + 1 < grid.n_rows, cell + grid.n_cols);
        }
        Self { steps, cell_m: grid.cell_m, disturbed }
    }

    /// True if a beam has hit the cell.
    #[must_use]
    pub fn is_hit(&self, cell: usize) -> bool {
        self.steps[cell] == 0
    }

    /// Shares of the volume over cells of these areas and thicknesses; by area where there is no
    /// volume. Cells below the base count as empty.
    #[must_use]
    pub fn shares(&self, areas_m2: &[f64], thickness_m: &[f64], range_m: f64) -> VolumeShares {
        let by_volume = self.sums(areas_m2, |cell| thickness_m[cell].max(0.0), range_m);
        let [measured, interpolated, unseen, disturbed] = if by_volume.iter().sum::<f64>() > 0.0 {
            by_volume
        } else {
            self.sums(areas_m2, |_| 1.0, range_m)
        };
        let total = measured + interpolated + unseen + disturbed;
        let share = |part: f64| if total > 0.0 { part / total } else { 0.0 };
        VolumeShares {
            measured_ratio: share(measured),
            interpolated_ratio: share(interpolated),
            unseen_ratio: share(unseen),
            disturbed_ratio: share(disturbed),
        }
    }

    fn sums(&self, areas_m2: &[f64], weight: impl Fn(usize) -> f64, range_m: f64) -> [f64; 4] {
        let mut sums = [0.0; 4];
        for (cell, area_m2) in areas_m2.iter().enumerate() {
            sums[self.state(cell, range_m) as usize] += area_m2 * weight(cell);
        }
        sums
    }

    /// How each cell is known, for a material with this practical range, m.
    #[must_use]
    pub fn coverage(&self, range_m: f64) -> Vec<CellCoverage> {
        (0..self.steps.len()).map(|cell| self.state(cell, range_m)).collect()
    }

    fn state(&self, cell: usize, range_m: f64) -> CellCoverage {
        if self.disturbed.contains(cell) {
            return CellCoverage::Disturbed;
        }
        match self.steps[cell] {
            0 => CellCoverage::Measured,
            u32::MAX => CellCoverage::Unseen,
            steps if f64::from(steps) * self.cell_m <= INTERPOLATED_RANGES * range_m => {
                CellCoverage::Interpolated
            }
            _ => CellCoverage::Unseen,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> GridGeometry {
        GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.5, n_cols: 9, n_rows: 1 }
    }

    #[test]
    fn shares_follow_the_distance_to_the_nearest_hit() {
        let mut is_hit = vec![false; 9];
        is_hit[0] = true;
        is_hit[1] = true;
        let seen = SeenCells::new(&grid(), &is_hit, Flagged::default());
        // Range 2 m: up to 1 m, two cells, counts as interpolated; five cells are unseen.
        let areas_m2 = vec![0.25; 9];
        let by_area = seen.shares(&areas_m2, &[0.0; 9], 2.0);
        assert!((by_area.measured_ratio - 2.0 / 9.0).abs() < 1e-12);
        assert!((by_area.interpolated_ratio - 2.0 / 9.0).abs() < 1e-12);
        assert!((by_area.unseen_ratio - 5.0 / 9.0).abs() < 1e-12);
        use CellCoverage::{Interpolated, Measured, Unseen};
        let known = [Measured, Measured, Interpolated, Interpolated];
        assert_eq!(seen.coverage(2.0)[..4], known);
        assert!(seen.coverage(2.0)[4..].iter().all(|state| *state == Unseen));
        // 3 m over the hit cells, 1 m elsewhere, a hole that counts as empty: 6 of 12.
        let thickness_m = [3.0, 3.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -4.0];
        let by_volume = seen.shares(&areas_m2, &thickness_m, 2.0);
        assert!((by_volume.measured_ratio - 0.5).abs() < 1e-12);
        assert!((by_volume.unseen_ratio - 4.0 / 12.0).abs() < 1e-12);
    }

    #[test]
    fn without_a_hit_nothing_is_seen() {
        let seen = SeenCells::new(&grid(), &[false; 9], Flagged::default());
        let shares = seen.shares(&[0.25; 9], &[1.0; 9], 2.0);
        assert!((shares.unseen_ratio - 1.0).abs() < 1e-12);
    }
}
