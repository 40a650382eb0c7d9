//! Echoes that get lost little by little: with the distance, where beams graze, on dark ground.
//!
//! ```text
//! s = (R/r)² · cos ι · ρ        strength against a white surface, square on, at the farthest range R
//! chance of an echo = 1 / (1 + s⁻⁴)
//! ```
//! At s = 1 one echo of two is lost, at 1.7 one of ten, at 0.6 nine of ten. Data sheets state R for white
//! surfaces and two fifths of it, or a quarter, for black ones (RPLIDAR A3: 25 and 10 m, S1: 40 and 10 m).
//! What the strength is like is the diffuse reflector's law; how steeply echoes are lost is the simulator's own.

use stockpilot::stats::SeedBook;

/// Reflectivity of dark ground, as a ratio of white ground's: seen from half the distance.
const DARK_RATIO: f64 = 0.25;
/// Dark patches and what lies between them follow each other at this distance, m.
const PATCH_PERIOD_M: f64 = 6.0;

/// How echoes get lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fading {
    /// Hardly any within the range.
    #[default]
    None,
    /// Little by little, on white ground.
    White,
    /// Little by little, on white ground with dark patches.
    DarkPatches,
}

/// Where the ground is dark: about a quarter of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct DarkPatches {
    phases: [f64; 2],
}

impl DarkPatches {
    pub(super) fn drawn(seeds: SeedBook) -> Self {
        let mut noise = seeds.stream("lidar.dark_patches");
        Self { phases: [noise.uniform(), noise.uniform()].map(|u| std::f64::consts::TAU * u) }
    }

    /// Reflectivity of the ground at a place in the hall, 1 for white.
    pub(super) fn reflectivity(&self, x_m: f64, y_m: f64) -> f64 {
        let wave =
            |at_m: f64, phase: f64| (std::f64::consts::TAU * at_m / PATCH_PERIOD_M + phase).cos();
        let is_dark = wave(x_m, self.phases[0]) * wave(y_m, self.phases[1]) > 0.35;
        if is_dark { DARK_RATIO } else { 1.0 }
    }
}

/// How often an echo comes back from this share of the farthest range, from a surface of this reflectivity
/// whose normal has this cosine with the beam.
pub(super) fn chance_of_echo(reach_ratio: f64, square_on: f64, reflectivity: f64) -> f64 {
    let strength = square_on * reflectivity / (reach_ratio * reach_ratio);
    (1.0 + strength.powi(-4)).recip()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn echoes_fade_with_distance_slant_and_darkness_alike() {
        assert!((chance_of_echo(1.0, 1.0, 1.0) - 0.5).abs() < 1e-12);
        // A quarter of the light is that from twice as far, or at 75.5°.
        let faint = chance_of_echo(1.0, 1.0, DARK_RATIO);
        assert!((faint - 1.0 / 257.0).abs() < 1e-12, "{faint}");
        assert!((chance_of_echo(2.0, 1.0, 1.0) - faint).abs() < 1e-12);
        assert!((chance_of_echo(1.0, 0.25, 1.0) - faint).abs() < 1e-12);
        assert!(chance_of_echo(0.5, 1.0, 1.0) > 0.99);
    }

    #[test]
    fn patches_are_a_quarter_of_the_ground() {
        for seed in 0..5 {
            let patches = DarkPatches::drawn(SeedBook::new(seed));
            let cells = (0..240).flat_map(|i| (0..240).map(move |j| (f64::from(i), f64::from(j))));
            let is_dark = |(i, j): &(f64, f64)| patches.reflectivity(0.1 * i, 0.1 * j) < 1.0;
            let ratio = cells.filter(is_dark).count() as f64 / (240.0 * 240.0);
            assert!((0.2..0.3).contains(&ratio), "seed {seed}: {ratio}");
        }
    }
}
