//! Seeded gradient noise and the ridged fractal made of it.

use stockpilot::stats::Noise;

/// Gradient noise on the unit lattice, in about −0.7 to 0.7, smooth, with mean 0.
///
/// Source: Perlin 1985, with the quintic blend of Perlin 2002; lattice gradients come from a hash
/// of the lattice point, so the field has no period.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GradientNoise {
    salt: u64,
    /// The lattice is moved by a part of its pitch: on its points the noise is always zero, and
    /// they must not lie at the same place in every field.
    shift: (f64, f64),
}

impl GradientNoise {
    /// A field of its own for each draw from the stream.
    pub(crate) fn from_stream(noise: &mut Noise) -> Self {
        let salt = noise.bits();
        let part = |bits: u64| (bits & 0xffff_ffff) as f64 / (1_u64 << 32) as f64;
        Self { salt, shift: (part(salt), part(salt >> 32)) }
    }

    /// The value at (x, y), in lattice units.
    pub(crate) fn at(&self, x: f64, y: f64) -> f64 {
        let (x, y) = (x + self.shift.0, y + self.shift.1);
        let (x0, y0) = (x.floor(), y.floor());
        let (u, v) = (x - x0, y - y0);
        let corner = |dx: f64, dy: f64| {
            let (gx, gy) = self.gradient(x0 + dx, y0 + dy);
            gx * (u - dx) + gy * (v - dy)
        };
        let (blend_u, blend_v) = (quintic(u), quintic(v));
        let low = lerp(corner(0.0, 0.0), corner(1.0, 0.0), blend_u);
        let high = lerp(corner(0.0, 1.0), corner(1.0, 1.0), blend_u);
        lerp(low, high, blend_v)
    }

    /// The unit gradient at a lattice point.
    fn gradient(&self, x: f64, y: f64) -> (f64, f64) {
        // SplitMix64's finaliser (Steele, Lea, Flood 2014) spreads neighbouring points.
        let mut hash = self.salt ^ x.to_bits() ^ y.to_bits().rotate_left(31);
        hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        hash ^= hash >> 31;
        let turn = (hash >> 11) as f64 / (1_u64 << 53) as f64;
        let (sin, cos) = (turn * std::f64::consts::TAU).sin_cos();
        (cos, sin)
    }
}

/// Sharp crests and wide valleys: a ridged multifractal, from about 0 to 1.
///
/// Each octave is weighted by the one above, so crests are rough and valley floors smooth, as
/// erosion leaves them. Source: Musgrave in Ebert et al. 2003, "Texturing and Modeling", ch. 16.
#[derive(Debug, Clone)]
pub(crate) struct RidgedFractal {
    octaves: Vec<GradientNoise>,
    wavelength_m: f64,
}

impl RidgedFractal {
    /// A fractal whose widest ridges are `wavelength_m` apart.
    pub(crate) fn new(noise: &mut Noise, n_octaves: usize, wavelength_m: f64) -> Self {
        let octaves = (0..n_octaves).map(|_| GradientNoise::from_stream(noise)).collect();
        Self { octaves, wavelength_m }
    }

    /// The value at (x, y), m in the plane.
    pub(crate) fn at(&self, x_m: f64, y_m: f64) -> f64 {
        const ROUGHNESS: f64 = 0.4;
        let (mut sum, mut total) = (0.0, 0.0);
        let (mut weight, mut amplitude, mut scale) = (1.0, 1.0, 1.0 / self.wavelength_m);
        for octave in &self.octaves {
            let crest = 1.0 - 1.4 * octave.at(x_m * scale, y_m * scale).abs();
            let signal = (crest * crest * weight).clamp(0.0, 1.0);
            sum += signal * amplitude;
            total += amplitude;
            weight = (2.0 * signal).clamp(0.0, 1.0);
            amplitude *= ROUGHNESS;
            scale *= 2.07;
        }
        sum / total
    }
}

fn quintic(t: f64) -> f64 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}
