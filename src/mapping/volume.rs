//! From a surface to a volume.

/// What the surface is measured against, and which part of each cell counts.
#[derive(Debug, Clone, PartialEq)]
pub struct Base {
    /// Height of the base under every cell, m.
    pub height_m: f64,
    /// Area of each cell that counts, m².
    pub cell_areas_m2: Vec<f64>,
}

impl Base {
    /// V = Σ `A_ij` (`h_ij` − base), m³.
    #[must_use]
    pub fn volume_m3(&self, surface_m: &[f64]) -> f64 {
        std::iter::zip(&self.cell_areas_m2, surface_m)
            .map(|(area_m2, height_m)| area_m2 * (height_m - self.height_m))
            .sum()
    }

    /// Share of the counting area whose cells satisfy a condition, 0 to 1.
    #[must_use]
    pub fn area_share(&self, holds: impl Fn(usize) -> bool) -> f64 {
        let total: f64 = self.cell_areas_m2.iter().sum();
        let holding: f64 = self
            .cell_areas_m2
            .iter()
            .enumerate()
            .filter(|&(cell, _)| holds(cell))
            .map(|(_, area_m2)| area_m2)
            .sum();
        if total > 0.0 { holding / total } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn volume_counts_only_the_area_that_counts() {
        let base = Base { height_m: 0.5, cell_areas_m2: vec![0.25, 0.125, 0.0] };
        // 0.25 · 1.5 + 0.125 · 0.5
        assert!((base.volume_m3(&[2.0, 1.0, 9.0]) - 0.4375).abs() < 1e-12);
        assert!((base.area_share(|cell| cell == 0) - 2.0 / 3.0).abs() < 1e-12);
    }
}
