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
//! were hit. What remains is what hides from all sides: of 400 simulated flights, nothing over alps and a
//! seventh over alps twice as steep, seed by seed the more the rougher the ground. So
//!
//! ```text
//! (0.32 ± 0.14) · b(μ) · min(1, 2.2 σ_ε/cell)
//! ```
//! is taken off, fitted to both; its σ to 200 further flights over alps twice as steep. Smooth piles show none.
//! Checked: `hidden_hollows_match_cast_beams` of the simulator for `b(μ)`; the share by whole flights only.

use super::datum::Datum;
use crate::time::{Mono, Stamp};

/// The share of [`hidden_from_all_sides_m`] by which heights are corrected, and the share's σ.
pub const OCCLUSION_SHARE: (f64, f64) = (0.32, 0.14);

/// Roughness at the beams' own points over that of patches, which are means of a few beams: measured
/// on the same ground.
pub const POINT_PER_PATCH: f64 = 2.2;

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

/// What is left of that where the ground was seen from several sides, m, but for [`OCCLUSION_SHARE`]:
/// `b(μ) · min(1, 2.2 σ_ε/cell)`. A hollow hides from all of them if its flanks are steeper than the beams, and
/// the steeper the ground is below the cell size, the more of its hollows are like that.
#[must_use]
pub fn hidden_from_all_sides_m(roughness_m: f64, cell_m: f64, descent: f64) -> f64 {
    const SLOPE: f64 = 2.2;
    hidden_m(roughness_m, cell_m, descent) * (SLOPE * roughness_m / cell_m).min(1.0)
}

/// Collects what data differ from the surface by, square by square, to tell how rough the ground is.
#[derive(Debug, Clone)]
pub struct Residuals {
    squares: Vec<Square>,
}

/// The residuals of the patches in one square of nodes.
#[derive(Debug, Clone, Copy, Default)]
struct Square {
    pass: Pass,
    /// Of the passes before: Σ of squares about each pass's mean, less what the beams' noise gives.
    rough_m2: f64,
    /// Of the passes before: what the beams' noise gives.
    known_m2: f64,
    /// Of the passes before: patches less passes.
    freedom: f64,
}

/// The patches of turns that follow each other.
#[derive(Debug, Clone, Copy, Default)]
struct Pass {
    at_s: f64,
    n: f64,
    sum_m: f64,
    sum_m2: f64,
    known_var_m2: f64,
}

/// Turns that are further apart saw the square on different legs of the flight, s: constant errors of
/// the calibration differ between legs, and are no roughness.
const PASS_S: f64 = 2.0;

/// A square that scatters more than the middle one with the beams' noise by this factor has an edge in it,
/// not roughness. The noise counts, for the middle square may be bare floor.
const CLIP: f64 = 5.0;
/// Fewer squares with several patches tell nothing.
const LEAST_SQUARES: usize = 50;

impl Residuals {
    /// Nothing yet, for so many squares.
    #[must_use]
    pub fn new(n_squares: usize) -> Self {
        Self { squares: vec![Square::default(); n_squares] }
    }

    /// Takes in a datum beside the surface, in the order of time.
    pub fn push(&mut self, at: Stamp<Mono>, datum: &Datum, surface_m: f64) {
        let residual_m = datum.height_m - surface_m;
        let square = &mut self.squares[datum.row.nodes[0] as usize];
        if at.seconds() - square.pass.at_s > PASS_S {
            square.end_pass();
        }
        let pass = &mut square.pass;
        pass.at_s = at.seconds();
        pass.n += 1.0;
        pass.sum_m += residual_m;
        pass.sum_m2 += residual_m * residual_m;
        pass.known_var_m2 += datum.sensor_var_m2;
    }

    /// How far the patches of one pass over a square scatter about each other beyond the beams' noise, m, as
    /// the root mean square over the squares, those with edges clipped; `None` from too few squares
    /// with several patches.
    ///
    /// What a square's patches have in common does not count, so it does not matter how closely the
    /// surface follows them.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "counts of squares")]
    pub fn scatter_m(&self) -> Option<f64> {
        let squares = || self.squares.iter().filter_map(|square| square.scatter_m2());
        let mut vars_m2: Vec<f64> = squares().map(|(rough_m2, _)| rough_m2).collect();
        if vars_m2.len() < LEAST_SQUARES {
            return None;
        }
        let known_m2 = squares().map(|(_, known_m2)| known_m2).sum::<f64>() / vars_m2.len() as f64;
        let middle = vars_m2.len() / 2;
        let (_, &mut median_m2, _) = vars_m2.select_nth_unstable_by(middle, f64::total_cmp);
        let clip_m2 = CLIP * CLIP * (median_m2.max(0.0) + known_m2);
        let sum_m2: f64 = vars_m2.iter().map(|var| var.min(clip_m2)).sum();
        Some((sum_m2 / vars_m2.len() as f64).max(0.0).sqrt())
    }
}

impl Square {
    /// Adds the present pass to those before.
    fn end_pass(&mut self) {
        let Pass { n, sum_m, sum_m2, known_var_m2, .. } = std::mem::take(&mut self.pass);
        if n > 1.5 {
            let known_m2 = known_var_m2 * (n - 1.0) / n;
            self.rough_m2 += sum_m2 - sum_m * sum_m / n - known_m2;
            self.known_m2 += known_m2;
            self.freedom += n - 1.0;
        }
    }

    /// Variance of the patches about the means of their passes, without the beams' noise, and that of the
    /// noise; `None` without two patches of one pass.
    fn scatter_m2(mut self) -> Option<(f64, f64)> {
        self.end_pass();
        (self.freedom > 0.5).then(|| (self.rough_m2 / self.freedom, self.known_m2 / self.freedom))
    }
}

#[cfg(test)]
mod tests {
    use super::super::matern_field::Row;
    use super::*;
    use crate::stats::SeedBook;
    use nalgebra::Vector6;
    use std::time::Duration;

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
                residuals.push(Stamp::ZERO, &datum(square, height_m, noise_m * noise_m), 0.0);
            }
        }
        let found_m = residuals.scatter_m().expect("enough squares");
        // Clipped edges still count 5 times the middle one: 1 % of 25 is an eighth of σ.
        assert!((0.97 * scatter_m..1.15 * scatter_m).contains(&found_m), "{found_m}");
    }

    /// Squares of which this share is ground of this roughness, the others bare floor, under beams of 1 cm
    /// that are told as `told_m`.
    fn scatter_on_floor_with_heaps(rough_share: f64, rough_m: f64, told_m: f64) -> Option<f64> {
        let mut noise = SeedBook::new(7).stream("ground");
        let mut residuals = Residuals::new(4_000);
        for square in 0..4_000 {
            let own_m = if f64::from(square) < 4_000.0 * rough_share { rough_m } else { 0.0 };
            for _ in 0..4 {
                let height_m = own_m.hypot(0.01) * noise.normal();
                residuals.push(Stamp::ZERO, &datum(square, height_m, told_m * told_m), 0.0);
            }
        }
        residuals.scatter_m()
    }

    #[test]
    fn heaps_on_bare_floor_count_with_their_share() {
        let found_m = scatter_on_floor_with_heaps(0.3, 0.03, 0.01).expect("enough squares");
        // √0.3 · 0.03, to a few standard errors: √(2/(1200 · 3)) of the variance.
        assert!((found_m / (0.3_f64.sqrt() * 0.03) - 1.0).abs() < 0.06, "{found_m}");
    }

    #[test]
    fn bare_floor_is_found_smooth_and_not_unknown() {
        let found_m = scatter_on_floor_with_heaps(0.0, 0.0, 0.01).expect("enough squares");
        // The variance of 12,000 residuals of 1 cm is known to 1.3 %, which is 1.1 mm of roughness; twice.
        assert!(found_m < 0.0016, "{found_m}");
        // Beams that are better than told leave nothing, and that is known too.
        assert_eq!(scatter_on_floor_with_heaps(0.0, 0.0, 0.012), Some(0.0));
    }

    #[test]
    fn single_patches_of_several_legs_tell_nothing() {
        let mut residuals = Residuals::new(100);
        for leg in 0..3_u32 {
            // Legs that disagree by decimetres are no roughness.
            let at = Stamp::ZERO.plus(Duration::from_secs(10 * u64::from(leg)));
            let height_m = 0.1 * f64::from(leg);
            (0..100).for_each(|square| residuals.push(at, &datum(square, height_m, 1e-4), 0.0));
        }
        assert_eq!(residuals.scatter_m(), None);
    }

    #[test]
    fn nothing_hides_from_above_and_everything_behind() {
        assert!(hidden_m(0.04, 0.25, f64::INFINITY).abs() < 1e-15);
        assert!((hidden_m(0.04, 0.25, -0.3) - 0.04).abs() < 1e-15);
        assert!(hidden_m(0.0, 0.25, 0.5).abs() < 1e-15);
        // 0.04/(1 + (1 · 0.25/0.136)²)
        assert!((hidden_m(0.04, 0.25, 1.0) - 0.009_134).abs() < 1e-6);
        // Times 2.2 · 0.04/0.25; and never more than all of it.
        assert!((hidden_from_all_sides_m(0.04, 0.25, 1.0) - 0.003_215).abs() < 1e-6);
        let steepest = hidden_from_all_sides_m(0.2, 0.25, 1.0);
        assert!((steepest - hidden_m(0.2, 0.25, 1.0)).abs() < 1e-15);
    }
}
