//! The prior: a Matérn field with ν = 1 on a lattice.

use super::FieldError;
use super::lattice::{EAST, Lattice, NORTH, SOUTH, WEST};
use super::stencil::{E, EE, HERE, N, NE, NN, NW, Stencil};

/// Prior of the surface: a Matérn field with ν = 1 around a level that may itself be unknown.
///
/// ```text
/// h(s) = mean + β + x(s),   β ~ N(0, mean_sigma²),   cov x(s), x(t) = σ² (κ d) K₁(κ d)
/// ```
/// with κ = √8/ρ and d the distance of s and t; K₁ is the modified Bessel function. Module page, section 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Practical range ρ, m: there the correlation is 0.14.
    pub range_m: f64,
    /// Standard deviation σ of the surface around its level, m.
    pub sigma_m: f64,
    /// Expected level, m over the hall floor.
    pub mean_m: f64,
    /// Standard deviation of the level, m; 0 if it is known, infinite if nothing is known of it.
    pub mean_sigma_m: f64,
}

impl Prior {
    /// κ = √(8ν)/ρ with ν = 1, 1/m.
    #[must_use]
    pub fn kappa_per_m(&self) -> f64 {
        8.0_f64.sqrt() / self.range_m
    }

    /// Padding that keeps the variance at the edge of the map within a few percent of σ², m.
    #[must_use]
    pub fn padding_m(&self) -> f64 {
        0.4 * self.range_m
    }

    /// # Errors
    /// [`FieldError::Prior`] for numbers that describe no field.
    pub(super) fn check(&self) -> Result<(), FieldError> {
        let is_sound = self.range_m > 0.0
            && self.range_m.is_finite()
            && self.sigma_m > 0.0
            && self.sigma_m.is_finite()
            && self.mean_m.is_finite()
            && self.mean_sigma_m >= 0.0;
        if is_sound { Ok(()) } else { Err(FieldError::Prior { prior: *self }) }
    }
}

/// The Robin boundary ∂x/∂n = −(κ/1.42) x keeps the variance at an edge within a tenth of σ².
///
/// Source: module page, section 2, after [Roininen 2014], who give λ = 1.42/κ.
const ROBIN: f64 = 1.42;

/// Q0 = s K K in the stencil's form: the precision of x.
#[derive(Debug, Clone)]
pub(super) struct Operator {
    /// s = τ²/A, 1/m².
    pub(super) scale: f64,
    /// Diagonal of K; its other entries are −1 along open links.
    pub(super) diagonal: Vec<f64>,
}

impl Operator {
    pub(super) fn new(lattice: &Lattice, prior: &Prior) -> Self {
        let kappa_step = prior.kappa_per_m() * lattice.spacing_m();
        let mass = kappa_step * kappa_step;
        let robin = kappa_step / ROBIN;
        let of_node = |links: &u8| {
            let n_open = f64::from(links.count_ones());
            mass + n_open + (4.0 - n_open) * robin
        };
        Self {
            scale: lattice_variance(mass) / (prior.sigma_m * prior.sigma_m),
            diagonal: lattice.links().iter().map(of_node).collect(),
        }
    }

    /// Q0 by its stencil.
    pub(super) fn stencil(&self, lattice: &Lattice) -> Stencil {
        let (links, d, s) = (lattice.links(), &self.diagonal, self.scale);
        let n_cols = lattice.size().0;
        let mut q = Stencil::zeros(lattice.size());
        let is_open = |node: usize, way: u8| f64::from(u8::from(links[node] & way != 0));
        for i in 0..links.len() {
            let n_open = f64::from(links[i].count_ones());
            q.parts[HERE][i] = s * (d[i] * d[i] + n_open);
            if links[i] & EAST != 0 {
                let east = i + 1;
                q.parts[E][i] = -s * (d[i] + d[east]);
                q.parts[EE][i] = s * is_open(east, EAST);
                q.parts[NE][i] += s * is_open(east, NORTH);
            }
            if links[i] & NORTH != 0 {
                let north = i + n_cols;
                q.parts[N][i] = -s * (d[i] + d[north]);
                q.parts[NN][i] = s * is_open(north, NORTH);
                q.parts[NE][i] += s * is_open(north, EAST);
                q.parts[NW][i] += s * is_open(north, WEST);
            }
            if links[i] & WEST != 0 {
                q.parts[NW][i] += s * is_open(i - 1, NORTH);
            }
        }
        q
    }

    /// K x.
    pub(super) fn half(&self, lattice: &Lattice, x: &[f64]) -> Vec<f64> {
        let (links, n_cols) = (lattice.links(), lattice.size().0);
        let of_node = |i: usize| {
            let mut sum = self.diagonal[i] * x[i];
            if links[i] & EAST != 0 {
                sum -= x[i + 1];
            }
            if links[i] & WEST != 0 {
                sum -= x[i - 1];
            }
            if links[i] & NORTH != 0 {
                sum -= x[i + n_cols];
            }
            if links[i] & SOUTH != 0 {
                sum -= x[i - n_cols];
            }
            sum
        };
        (0..x.len()).map(of_node).collect()
    }

    /// Q0 x = s K (K x).
    pub(super) fn apply(&self, lattice: &Lattice, x: &[f64]) -> Vec<f64> {
        let mut y = self.half(lattice, &self.half(lattice, x));
        y.iter_mut().for_each(|y| *y *= self.scale);
        y
    }

    /// xᵀ Q0 x = s |K x|², never negative.
    pub(super) fn energy(&self, lattice: &Lattice, x: &[f64]) -> f64 {
        self.scale * self.half(lattice, x).iter().map(|k| k * k).sum::<f64>()
    }
}

/// Variance of a node of the endless lattice whose precision is K K, with K's diagonal m + 4.
///
/// ```text
/// v(m) = (2π)⁻² ∬ (m + 4 − 2 cos a − 2 cos b)⁻² da db = 2 E(k)/(π (z² − 16)),   z = m + 4, k = 4/z
/// ```
/// `E` is the complete elliptic integral of the second kind. For m → 0 it tends to 1/(4π m), which
/// is the continuous field's; the quotient is what the lattice adds. Module page, section 2.
pub(super) fn lattice_variance(mass: f64) -> f64 {
    let z = mass + 4.0;
    // z² − 16 without cancellation.
    let gap = mass * (mass + 8.0);
    2.0 * complete_elliptic_e(4.0 / z) / (std::f64::consts::PI * gap)
}

/// E(k) by the arithmetic-geometric mean; Abramowitz and Stegun 1964, 17.6.
fn complete_elliptic_e(k: f64) -> f64 {
    let (mut a, mut b) = (1.0, ((1.0 - k) * (1.0 + k)).sqrt());
    let (mut sum, mut power) = (k * k / 2.0, 0.5);
    // Each step doubles the digits; eight are more than enough.
    for _ in 0..8 {
        let c = (a - b) / 2.0;
        (a, b) = ((a + b) / 2.0, (a * b).sqrt());
        power *= 2.0;
        sum += power * c * c;
    }
    std::f64::consts::PI / (2.0 * a) * (1.0 - sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elliptic_integral_matches_published_values() {
        // Abramowitz and Stegun 1964, table 17.1: m = k² = 0, 0.5, 0.9.
        for (m, published) in
            [(0.0, std::f64::consts::FRAC_PI_2), (0.5, 1.350_643_881_0), (0.9, 1.104_774_732_7)]
        {
            let m: f64 = m;
            assert!((complete_elliptic_e(m.sqrt()) - published).abs() < 1e-9, "m = {m}");
        }
    }

    #[test]
    fn lattice_variance_matches_its_integral() {
        // Midpoints converge exponentially for a smooth periodic integrand.
        let n = 400;
        for mass in [0.02, 0.3, 2.0] {
            let at = |i: i32| (f64::from(i) + 0.5) / f64::from(n) * std::f64::consts::TAU;
            let mut sum = 0.0;
            for i in 0..n {
                for j in 0..n {
                    let symbol: f64 = mass + 4.0 - 2.0 * at(i).cos() - 2.0 * at(j).cos();
                    sum += symbol.powi(-2);
                }
            }
            let integral = sum / f64::from(n * n);
            assert!((lattice_variance(mass) / integral - 1.0).abs() < 1e-10, "mass {mass}");
        }
    }
}
