//! Seeded noise: every random stream has a name and a seed of its own.

use nalgebra::Vector3;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Hands out one independent seed for each named stream.
///
/// Adding a stream does not move the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SeedBook {
    seed: u64,
}

impl SeedBook {
    /// The book of one run.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self { seed }
    }

    /// The noise stream called `name`.
    #[must_use]
    pub fn stream(&self, name: &str) -> Noise {
        // FNV-1a keeps the mapping from name to stream fixed for ever, across compilers.
        let mut hash = 0xcbf2_9ce4_8422_2325_u64 ^ self.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        for byte in name.bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
        Noise { rng: ChaCha8Rng::seed_from_u64(hash) }
    }
}

/// A stream of pseudo-random numbers that is the same on every machine.
#[derive(Debug, Clone)]
pub struct Noise {
    rng: ChaCha8Rng,
}

impl Noise {
    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.rng.random::<f64>()
    }

    /// Uniform in [low, high).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.uniform() < probability
    }

    /// Normal with mean 0 and standard deviation 1, by Box and Muller 1958.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// Three independent standard normal numbers.
    pub fn normal3(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.rng.next_u64()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_depend_on_name_and_seed_only() {
        let book = SeedBook::new(7);
        let draw = |book: SeedBook, name| book.stream(name).bits();
        assert_eq!(draw(book, "imu"), draw(SeedBook::new(7), "imu"));
        assert_ne!(draw(book, "imu"), draw(book, "lidar"));
        assert_ne!(draw(book, "imu"), draw(SeedBook::new(8), "imu"));
    }

    #[test]
    fn normal_has_unit_variance() {
        let mut noise = SeedBook::new(1).stream("normal");
        let n = 100_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let x = noise.normal();
            sum += x;
            squares += x * x;
        }
        // The standard error of the mean is 0.0032 and of the variance 0.0045; 4 of them each.
        assert!((sum / f64::from(n)).abs() < 0.013);
        assert!((squares / f64::from(n) - 1.0).abs() < 0.018);
    }
}
