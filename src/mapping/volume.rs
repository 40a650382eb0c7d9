//! From a surface to a volume.

use super::base::BaseError;

/// What the surface is measured against, and which part of each cell counts.
#[derive(Debug, Clone, PartialEq)]
pub struct Base {
    /// Area of each cell that counts, w, m².
    pub cell_areas_m2: Vec<f64>,
    /// Mean height of the base under the part of each cell that counts, m; 0 where none does.
    pub cell_base_m: Vec<f64>,
    /// The constant errors of the volume by the base: what
    /// [`push_shared`](crate::messages::VolumeBudget::push_shared) takes.
    pub errors: Vec<BaseError>,
}

impl Base {
    /// The same base height under every cell, m, known exactly.
    #[must_use]
    pub fn level(height_m: f64, cell_areas_m2: Vec<f64>) -> Self {
        let cell_base_m = vec![height_m; cell_areas_m2.len()];
        Self { cell_areas_m2, cell_base_m, errors: Vec::new() }
    }

    /// All bays together: areas added, heights averaged by area. Errors are left out, for bays
    /// may share them; see [`Region::whole_and_bays_on`](super::region::Region::whole_and_bays_on).
    #[must_use]
    pub fn total<'a>(bays: impl IntoIterator<Item = &'a Self>, n_cells: usize) -> Self {
        let mut total = Self::level(0.0, vec![0.0; n_cells]);
        for bay in bays {
            for (cell, (area, base_m)) in
                std::iter::zip(&bay.cell_areas_m2, &bay.cell_base_m).enumerate()
            {
                total.cell_areas_m2[cell] += area;
                total.cell_base_m[cell] += area * base_m;
            }
        }
        for (base, area) in std::iter::zip(&mut total.cell_base_m, &total.cell_areas_m2) {
            if *area > 0.0 {
                *base /= area;
            }
        }
        total
    }

    /// V = Σ `w_c` (`h_c` − `b_c`), m³. A surface below the base counts negative.
    #[must_use]
    pub fn volume_m3(&self, surface_m: &[f64]) -> f64 {
        std::iter::zip(std::iter::zip(&self.cell_areas_m2, &self.cell_base_m), surface_m)
            .filter(|((area_m2, _), _)| **area_m2 > 0.0)
            .map(|((area_m2, base_m), height_m)| area_m2 * (height_m - base_m))
            .sum()
    }

    /// What lies between the hall floor and the base, m³.
    #[must_use]
    pub fn above_floor_m3(&self) -> f64 {
        std::iter::zip(&self.cell_areas_m2, &self.cell_base_m).map(|(area, base)| area * base).sum()
    }

    /// Height of the surface over the base in every cell, m; negative below it.
    #[must_use]
    pub fn thickness_m(&self, surface_m: &[f64]) -> Vec<f64> {
        std::iter::zip(surface_m, &self.cell_base_m).map(|(height, base)| height - base).collect()
    }

    /// The area that counts, m².
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        self.cell_areas_m2.iter().sum()
    }

    /// The lowest base under what counts, m; none if nothing counts.
    #[must_use]
    pub fn lowest_m(&self) -> Option<f64> {
        std::iter::zip(&self.cell_areas_m2, &self.cell_base_m)
            .filter(|(area_m2, _)| **area_m2 > 0.0)
            .map(|(_, base_m)| *base_m)
            .reduce(f64::min)
    }

    /// Share of the counting area whose cells satisfy a condition, 0 to 1.
    #[must_use]
    pub fn area_share(&self, holds: impl Fn(usize) -> bool) -> f64 {
        let total = self.area_m2();
        let holding: f64 = self
            .cell_areas_m2
            .iter()
            .enumerate()
            .filter(|&(cell, _)| holds(cell))
            .map(|(_, area_m2)| area_m2)
            .sum();
        // A sum over nothing is −0, which people would read.
        if holding > 0.0 && total > 0.0 { holding / total } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn volume_counts_only_the_area_that_counts() {
        let base = Base::level(0.5, vec![0.25, 0.125, 0.0]);
        // 0.25 · 1.5 + 0.125 · 0.5
        assert!((base.volume_m3(&[2.0, 1.0, 9.0]) - 0.4375).abs() < 1e-12);
        assert!((base.area_share(|cell| cell == 0) - 2.0 / 3.0).abs() < 1e-12);
        assert_eq!(format!("{:.0}", base.area_share(|_| false)), "0");
    }

    #[test]
    fn bays_together_have_the_sum_of_their_volumes() {
        let left =
            Base { cell_base_m: vec![1.0, 0.5, 0.0], ..Base::level(0.0, vec![0.25, 0.1, 0.0]) };
        let right =
            Base { cell_base_m: vec![0.0, -1.0, 2.0], ..Base::level(0.0, vec![0.0, 0.15, 0.2]) };
        let total = Base::total([&left, &right], 3);
        let surface = [2.0, 0.25, 1.5];
        let sum = left.volume_m3(&surface) + right.volume_m3(&surface);
        assert!((total.volume_m3(&surface) - sum).abs() < 1e-12);
        assert!((total.area_m2() - 0.7).abs() < 1e-12);
        assert_eq!(left.lowest_m(), Some(0.5));
    }

    #[test]
    fn a_surface_below_its_base_counts_negative() {
        // Half the floor 1 cm up, half 1 cm down: an empty floor with noise holds nothing.
        let base = Base::level(0.0, vec![1.0; 4]);
        assert!(base.volume_m3(&[0.01, -0.01, 0.01, -0.01]).abs() < 1e-15);
        assert!(base.volume_m3(&[-0.01; 4]) < -0.039);
    }
}
