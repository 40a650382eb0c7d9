//! Ground that no beam reached: lower than the rays that passed over it.
//!
//! A field that knows hits alone takes the ground behind a crest to be as high as the line from the
//! crest to the next hit, which is the very ray that missed it. What is hidden is lower than that,
//! everywhere, so a volume over hidden ground comes out too high, and by more than its σ says. Each hidden
//! node i with rays over it, or half a metre beside it, therefore has a condition of its own,
//!
//! ```text
//! p(h | data, rays) ∝ p(h | data) Π_i Φ((u_i − h_i)/s_i)
//! ```
//! and the conditions become Gaussian data by expectation propagation: site i has information `τ_i` and
//! τ-weighted height `ν_i`, such that posterior and tilted marginal agree in mean and variance,
//!
//! ```text
//! 1/v = 1/V_ii − τ,   m = v (μ_i/V_ii − ν)                       the marginal without site i
//! z = (u − m)/√(s² + v),   r = φ(z)/Φ(z)
//! m̂ = m − v r/√(s² + v),   v̂ = v − v² r (z + r)/(s² + v)          with the condition itself
//! τ' = 1/v̂ − 1/v,   ν' = m̂/v̂ − m/v
//! ```
//! - `μ`, `V`: mean and covariance of the field with all sites, m, m²
//! - `u`: the ceiling over the node, m ([`super::ray_ceiling`]); `s`: how sharply it is known, m
//!
//! All sites are renewed at once, damped; the conditions are log-concave, so τ' is never negative.
//! A site is uncertain like a datum of variance 1/τ: the budget has it as `hidden_ground`, with what
//! [`super::unseen_patch`] adds.
//! Source: Minka 2001; for truncated Gaussians Cunningham, Hennig, Lacoste-Julien 2011.
//! Checked: `conditions_match_gibbs_sampling`, `a_single_condition_is_the_truncated_normal`.

use super::matern_field::Information;

/// A condition as a Gaussian datum of one node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    /// The node.
    pub node: usize,
    /// τ, 1/m².
    pub info_per_m2: f64,
    /// ν: τ times the height that it pulls to, 1/m.
    pub info_height_per_m: f64,
}

/// The conditions of all hidden nodes, by rising node.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct HiddenGround {
    sites: Vec<Site>,
}

/// How far each renewal goes: neighbouring sites pull at the same ground, all at once.
const DAMPING: f64 = 0.5;
/// Less information than this moves nothing, 1/m²: σ = 1 km.
const LEAST_INFO_PER_M2: f64 = 1e-6;

impl HiddenGround {
    /// The conditions of the nodes with a ceiling, one renewal after a field that had these ones;
    /// and how far a site's pull moved at most, in σ of its node.
    ///
    /// - `mean_m`, `var_m2`: that field, node by node
    /// - `ceiling`: `u` and `s` of a node, m; `None` where it rests on data, or nothing passed over it or beside
    #[must_use]
    pub fn renewed(
        &self,
        mean_m: &[f64],
        var_m2: &[f64],
        ceiling: impl Fn(usize) -> Option<(f64, f64)>,
    ) -> (Self, f64) {
        let mut old = self.sites.iter().copied().peekable();
        let (mut sites, mut largest_step) = (Vec::new(), 0.0_f64);
        for (node, (mean_m, var_m2)) in std::iter::zip(mean_m, var_m2).enumerate() {
            while old.next_if(|site| site.node < node).is_some() {}
            let Some((ceiling_m, softness_m)) = ceiling(node) else { continue };
            let none = Site { node, info_per_m2: 0.0, info_height_per_m: 0.0 };
            let site = old.next_if(|site| site.node == node).unwrap_or(none);
            let Some(aim) = site.aim(*mean_m, *var_m2, ceiling_m, softness_m) else { continue };
            let next = site.towards(&aim);
            largest_step = largest_step.max(site.step_to(&next, *mean_m, *var_m2));
            if next.info_per_m2 > LEAST_INFO_PER_M2 {
                sites.push(next);
            }
        }
        (Self { sites }, largest_step)
    }

    /// Adds the conditions to the data of a field.
    pub fn add_to(&self, information: &mut Information) {
        for site in &self.sites {
            information.add_condition(site.node, site.info_per_m2, site.info_height_per_m);
        }
    }

    /// Only those of nodes that still are hidden.
    #[must_use]
    pub fn among(&self, is_hidden: impl Fn(usize) -> bool) -> Self {
        let sites = self.sites.iter().copied().filter(|site| is_hidden(site.node));
        Self { sites: sites.collect() }
    }

    /// What the conditions add to the variance of a volume with this adjoint: Σ (τ q)²/τ, m⁶.
    #[must_use]
    pub fn var_m6(&self, q_m2: &[f64]) -> f64 {
        self.sites.iter().map(|site| site.info_per_m2 * q_m2[site.node].powi(2)).sum()
    }
}

impl Site {
    /// The undamped next site; `None` if the field's variance leaves nothing without this one, which is
    /// rounding.
    fn aim(&self, mean_m: f64, var_m2: f64, ceiling_m: f64, softness_m: f64) -> Option<Self> {
        let info_per_m2 = 1.0 / var_m2 - self.info_per_m2;
        if !(info_per_m2 > 0.0 && info_per_m2.is_finite() && mean_m.is_finite()) {
            return None;
        }
        let v = 1.0 / info_per_m2;
        let m = v * (mean_m / var_m2 - self.info_height_per_m);
        let total_m2 = softness_m * softness_m + v;
        let z = (ceiling_m - m) / total_m2.sqrt();
        let r = hazard(z);
        let mean_with_m = m - v * r / total_m2.sqrt();
        let var_with_m2 = v - v * v * r * (z + r) / total_m2;
        let info_with_per_m2 = 1.0 / var_with_m2;
        Some(Self {
            node: self.node,
            info_per_m2: (info_with_per_m2 - info_per_m2).max(0.0),
            info_height_per_m: mean_with_m * info_with_per_m2 - m * info_per_m2,
        })
    }

    fn towards(&self, aim: &Self) -> Self {
        let part = |from: f64, to: f64| from + DAMPING * (to - from);
        Self {
            node: self.node,
            info_per_m2: part(self.info_per_m2, aim.info_per_m2),
            info_height_per_m: part(self.info_height_per_m, aim.info_height_per_m),
        }
    }

    /// By how much the force on the node changes, in units that move it by one σ.
    fn step_to(&self, next: &Self, mean_m: f64, var_m2: f64) -> f64 {
        let force = |site: &Self| site.info_height_per_m - site.info_per_m2 * mean_m;
        (force(next) - force(self)).abs() * var_m2.sqrt()
    }
}

/// φ(z)/Φ(z) of the standard normal distribution.
fn hazard(z: f64) -> f64 {
    // Below, Φ runs out of exponents; Mills' ratio by its asymptotic series is exact to 1e-7 there.
    const TAIL: f64 = -25.0;
    if z < TAIL {
        let per_z2 = 1.0 / (z * z);
        return -z / (1.0 - per_z2 + 3.0 * per_z2 * per_z2);
    }
    let density = (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt();
    density / (0.5 * libm::erfc(-z * std::f64::consts::FRAC_1_SQRT_2))
}

#[cfg(test)]
mod tests;
