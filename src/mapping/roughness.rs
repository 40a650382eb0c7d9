//! Ground rougher than the cells can show: how rough it is, and what hides in its hollows.
//!
//! A beam ends at the first ground it meets, so grazing beams hit crests more often than hollows
//! and report the ground too high. For ground of roughness `σ_ε` below the cell size, whose slopes
//! there are about `2.2 σ_ε/cell`, beams that descend by `μ` per metre of way along the ground
//! report it too high by up to
//!
//! ```text
//! b(μ) = σ_ε / (1 + (μ cell / 3.4 σ_ε)²)
//! ```
//! a fit to beams cast on ridged fractal ground at two slopes, good to a quarter of itself for
//! `μ cell/σ_ε` from 2 to 15. Most of it averages out where squares weigh alike however often they
//! were hit: in simulated flights over ground one and a half to three times as steep as usual, a
//! quarter of it remained in the volume, give or take half as much again. Smooth piles show none.
//! Checked: `hidden_hollows_match_cast_beams` of the simulator.

use super::datum::Datum;

/// The share of [`hidden_m`] by which heights are corrected, and the share's σ.
pub const OCCLUSION_SHARE: (f64, f64) = (0.25, 0.15);

/// Roughness at the beams' own points over that of patches, which are means of a few beams: measured
/// on the same ground.
pub const POINT_PER_PATCH: f64 = 2.5;

/// By how much beams report the ground too high at most, m.
///
/// - `roughness_m`: standard deviation `σ_ε` of the ground within a cell, m
/// - `descent`: how much the beam comes nearer to the ground per metre along it; beams from straight
///   above have none of it: infinite. Not positive where the surface faces away from the beam.
#[must_use]
pub fn hidden_m(roughness_m: f64, cell_m: f64, descent: f64) -> f64 {
    const STEEPNESS: f64 = 3.4;
    let grazing = descent.max(0.0) * cell_m / (STEEPNESS * roughness_m.max(1e-9));
    roughness_m / (1.0 + grazing * grazing)
}

/// Collects what data differ from the surface by, square by square, to tell how rough the ground is.
#[derive(Debug, Clone)]
pub struct Residuals {
    squares: Vec<Square>,
}

/// The residuals of the patches in one square of nodes.
#[derive(Debug, Clone, Copy, Default)]
struct Square {
    n: f64,
    sum_m: f64,
    sum_m2: f64,
    known_var_m2: f64,
}

/// A square that is rougher than the middle one by more than this has an edge in it, not roughness.
const CLIP: f64 = 5.0;
/// Fewer squares with several patches tell nothing.
const LEAST_SQUARES: usize = 50;

impl Residuals {
    /// Nothing yet, for so many squares.
    #[must_use]
    pub fn new(n_squares: usize) -> Self {
        Self { squares: vec![Square::default(); n_squares] }
    }

    /// Takes in a datum beside the surface.
    pub fn push(&mut self, datum: &Datum, surface_m: f64) {
        let residual_m = datum.height_m - surface_m;
        let square = &mut self.squares[datum.row.nodes[0] as usize];
        square.n += 1.0;
        square.sum_m += residual_m;
        square.sum_m2 += residual_m * residual_m;
        square.known_var_m2 += datum.sensor_var_m2;
    }

    /// How far the patches of a square scatter about each other beyond the beams' noise, m, as
    /// the root mean square over the squares, those with edges clipped; `None` from too few squares
    /// with several patches.
    ///
    /// What a square's patches have in common does not count, so it does not matter how closely the
    /// surface follows them.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "counts of squares")]
    pub fn scatter_m(&self) -> Option<f64> {
        let mut vars_m2: Vec<f64> = self.squares.iter().filter_map(Square::scatter_m2).collect();
        if vars_m2.len() < LEAST_SQUARES {
            return None;
        }
        let middle = vars_m2.len() / 2;
        let (_, &mut median_m2, _) = vars_m2.select_nth_unstable_by(middle, f64::total_cmp);
        let clip_m2 = CLIP * CLIP * median_m2.max(0.0);
        let sum_m2: f64 = vars_m2.iter().map(|var| var.min(clip_m2)).sum();
        Some((sum_m2 / vars_m2.len() as f64).max(0.0).sqrt())
    }
}

impl Square {
    /// Variance of the patches about their mean without the beams' noise; `None` for one patch.
    fn scatter_m2(&self) -> Option<f64> {
        (self.n > 1.5).then(|| {
            let about_mean_m2 = self.sum_m2 - self.sum_m * self.sum_m / self.n;
            about_mean_m2 / (self.n - 1.0) - self.known_var_m2 / self.n
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::matern_field::Row;
    use super::*;
    use crate::stats::SeedBook;
    use nalgebra::Vector6;

    fn datum(square: u32, height_m: f64, sensor_var_m2: f64) -> Datum {
        Datum {
            row: Row { nodes: [square, square + 1, square + 2, square + 3], weights: [0.25; 4] },
            height_m,
            hidden_m: 0.0,
            sensor_var_m2,
            slope_var_m2: 0.0,
            roughness_var_m2: 0.0,
            pose_var_m2: 0.0,
            by_pose: Vector6::zeros(),
            by_mount: Vector6::zeros(),
            by_range: 1.0,
            range_m: 5.0,
            weight_per_m2: 1.0,
        }
    }

    #[test]
    fn scatter_is_found_beside_noise_offsets_and_edges() {
        let (scatter_m, noise_m, offset_m) = (0.03, 0.01, 0.2);
        let mut noise = SeedBook::new(5).stream("ground");
        let mut residuals = Residuals::new(2_000);
        for square in 0..2_000 {
            let common_m = offset_m * noise.normal();
            // Every hundredth square holds an edge of a metre.
            let edge_m = if square % 100 == 0 { 1.0 } else { 0.0 };
            for k in 0..4_u32 {
                let own_m = scatter_m * noise.normal() + noise_m * noise.normal();
                let height_m = common_m + own_m + edge_m * f64::from(k % 2);
                residuals.push(&datum(square, height_m, noise_m * noise_m), 0.0);
            }
        }
        let found_m = residuals.scatter_m().expect("enough squares");
        // Clipped edges still count 5 times the middle one: 1 % of 25 is an eighth of σ.
        assert!((0.97 * scatter_m..1.15 * scatter_m).contains(&found_m), "{found_m}");
    }

    #[test]
    fn single_patches_tell_nothing() {
        let mut residuals = Residuals::new(100);
        (0..100).for_each(|square| residuals.push(&datum(square, 0.1, 1e-4), 0.0));
        assert_eq!(residuals.scatter_m(), None);
    }

    #[test]
    fn nothing_hides_from_above_and_everything_behind() {
        assert!(hidden_m(0.04, 0.25, f64::INFINITY).abs() < 1e-15);
        assert!((hidden_m(0.04, 0.25, -0.3) - 0.04).abs() < 1e-15);
        assert!(hidden_m(0.0, 0.25, 0.5).abs() < 1e-15);
        // 0.04/(1 + (1 · 0.25/0.136)²)
        assert!((hidden_m(0.04, 0.25, 1.0) - 0.009_134).abs() < 1e-6);
    }
}
