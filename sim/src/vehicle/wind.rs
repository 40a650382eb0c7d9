//! Air that moves: gusts and draughts as first-order coloured noise.

use nalgebra::Vector3;
use stockpilot::stats::{Noise, SeedBook};

/// How the air moves in a hall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindSettings {
    /// Mean air velocity in `Hall` axes, m/s.
    pub mean_mps: Vector3<f64>,
    /// Standard deviation of the gusts along x, y, z, m/s.
    pub gust_sigma_mps: Vector3<f64>,
    /// Correlation time of the gusts, s.
    pub gust_time_s: f64,
    /// Standard deviation of the slow draught along x, y, z, m/s.
    pub draught_sigma_mps: Vector3<f64>,
    /// Correlation time of the draught, s.
    pub draught_time_s: f64,
}

impl Default for WindSettings {
    fn default() -> Self {
        Self {
            mean_mps: Vector3::zeros(),
            gust_sigma_mps: Vector3::new(0.3, 0.3, 0.15),
            gust_time_s: 1.5,
            draught_sigma_mps: Vector3::new(0.15, 0.15, 0.05),
            draught_time_s: 20.0,
        }
    }
}

impl WindSettings {
    /// Still air.
    #[must_use]
    pub fn still() -> Self {
        let none = Vector3::zeros();
        Self { gust_sigma_mps: none, draught_sigma_mps: none, ..Self::default() }
    }
}

/// The air at the vehicle.
#[derive(Debug, Clone)]
pub struct Wind {
    settings: WindSettings,
    noise: Noise,
    gust_mps: Vector3<f64>,
    draught_mps: Vector3<f64>,
    blast_mps: Vector3<f64>,
    gust_kept: f64,
    draught_kept: f64,
}

impl Wind {
    /// Air from the stream `wind` of the book, moved in steps of `step_s`; starts in the
    /// stationary distribution.
    #[must_use]
    pub fn new(settings: WindSettings, seeds: SeedBook, step_s: f64) -> Self {
        let mut noise = seeds.stream("wind");
        let gust_mps = settings.gust_sigma_mps.component_mul(&noise.normal3());
        let draught_mps = settings.draught_sigma_mps.component_mul(&noise.normal3());
        let gust_kept = (-step_s / settings.gust_time_s).exp();
        let draught_kept = (-step_s / settings.draught_time_s).exp();
        let blast_mps = Vector3::zeros();
        Self { settings, noise, gust_mps, draught_mps, blast_mps, gust_kept, draught_kept }
    }

    /// From now on the air moves by this in addition, m/s: a door, a fan.
    pub const fn blast(&mut self, velocity_mps: Vector3<f64>) {
        self.blast_mps = velocity_mps;
    }

    /// Moves the air by one step; exact for a first-order process.
    ///
    /// ```text
    /// w⁺ = φ w + σ √(1 − φ²) n      φ = exp(−dt/τ)
    /// ```
    pub fn step(&mut self) {
        let gust = self.settings.gust_sigma_mps.component_mul(&self.noise.normal3());
        let draught = self.settings.draught_sigma_mps.component_mul(&self.noise.normal3());
        self.gust_mps = blended(&self.gust_mps, &gust, self.gust_kept);
        self.draught_mps = blended(&self.draught_mps, &draught, self.draught_kept);
    }

    /// Velocity of the air in `Hall` axes, m/s.
    #[must_use]
    pub fn velocity_mps(&self) -> Vector3<f64> {
        self.settings.mean_mps + self.gust_mps + self.draught_mps + self.blast_mps
    }
}

fn blended(old: &Vector3<f64>, drawn: &Vector3<f64>, kept: f64) -> Vector3<f64> {
    old * kept + drawn * (1.0 - kept * kept).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gusts_have_their_variance_and_correlation_time() {
        let settings =
            WindSettings { draught_sigma_mps: Vector3::zeros(), ..WindSettings::default() };
        let mut wind = Wind::new(settings, SeedBook::new(5), 0.02);
        let samples: Vec<f64> = (0..200_000)
            .map(|_| {
                wind.step();
                wind.velocity_mps().x
            })
            .collect();
        let mean_of = |lag: usize| {
            let pairs = samples.iter().zip(&samples[lag..]);
            pairs.map(|(a, b)| a * b).sum::<f64>() / 200_000.0
        };
        // 4000 s hold about 1300 independent gusts, so variances are known to 4 %; 3 of them.
        assert!((mean_of(0) / 0.09 - 1.0).abs() < 0.12);
        assert!((mean_of(75) / mean_of(0) - (-1.0_f64).exp()).abs() < 0.06);
    }
}
