//! The Matérn correlation for any smoothness ν > 0.
//!
//! ```text
//! M_ν(a) = 2^{1−ν}/Γ(ν) a^ν K_ν(a),   a = √(2ν) s/l,   M_ν(0) = 1
//! K_ν(a) = ∫₀^∞ exp(−a cosh t) cosh(νt) dt
//! ```
//! - `s`: distance, m; `l`: length scale, m
//! - `K_ν`: modified Bessel function of the second kind
//!
//! Half-integers up to 7/2 have closed forms. Otherwise the integral is summed at equal steps: its
//! integrand is analytic and falls off doubly exponentially, so the trapezoidal rule converges to
//! rounding with a few hundred terms. All factors stay in one exponent, so nothing overflows.
//!
//! Sources: Rasmussen and Williams 2006, eq. (4.14) to (4.17); DLMF 10.32.9 for the integral;
//! Trefethen and Weideman 2014 for the rule.
//! Checked: `bessel_meets_published_tables`, `closed_forms_and_integral_agree`.

/// `M_ν` of a distance in units of the length scale, s/l ≥ 0.
///
/// ν must be positive; what is not a number stays so.
#[must_use]
pub fn matern(nu: f64, s_over_l: f64) -> f64 {
    let a = (2.0 * nu).sqrt() * s_over_l;
    matern_of(nu, a)
}

/// `M_ν` as a function of a = √(2ν) s/l; for a field from a stochastic differential equation
/// a = κ s.
#[must_use]
pub fn matern_of(nu: f64, a: f64) -> f64 {
    if a == 0.0 {
        return 1.0;
    }
    closed_form(nu, a).unwrap_or_else(|| {
        let log_factor = nu * a.ln() - (nu - 1.0) * std::f64::consts::LN_2 - libm::lgamma(nu);
        let correlation = bessel_integral(nu, a, log_factor);
        // Rounding may lift it over 1; `min` would make a number of what is none.
        if correlation > 1.0 { 1.0 } else { correlation }
    })
}

/// The closed forms of ν = 1/2, 3/2, 5/2, 7/2.
fn closed_form(nu: f64, a: f64) -> Option<f64> {
    let is = |half: f64| (nu - half).abs() < 1e-12;
    let polynomial = if is(0.5) {
        1.0
    } else if is(1.5) {
        1.0 + a
    } else if is(2.5) {
        1.0 + a + a * a / 3.0
    } else if is(3.5) {
        1.0 + a + 0.4 * a * a + a * a * a / 15.0
    } else {
        return None;
    };
    Some(polynomial * (-a).exp())
}

/// Modified Bessel function of the second kind, `K_ν(x)` for x > 0 and any real ν.
#[must_use]
pub fn bessel_k(nu: f64, x: f64) -> f64 {
    bessel_integral(nu.abs(), x, 0.0)
}

/// Step of the sum; its error falls as exp(−π²/step).
const STEP: f64 = 1.0 / 16.0;
/// Terms e^{this} below the largest no longer count.
const NEGLIGIBLE: f64 = 45.0;

/// e^{`log_factor`} `K_ν(x)`.
fn bessel_integral(nu: f64, x: f64, log_factor: f64) -> f64 {
    if x == f64::INFINITY {
        return 0.0;
    }
    // ln of e^{νt − x cosh t}, whose largest value is at sinh t = ν/x.
    let exponent = |t: f64| log_factor + nu * t - x * t.cosh();
    let peak_t = (nu / x).asinh();
    let lowest = exponent(peak_t) - NEGLIGIBLE;
    let mut sum = 0.5 * exponent(0.0).exp();
    let mut t = STEP;
    loop {
        let e = exponent(t);
        if t > peak_t && e < lowest {
            return sum * STEP;
        }
        // cosh νt = e^{νt} (1 + e^{−2νt})/2
        sum += e.exp() * 0.5 * (1.0 + (-2.0 * nu * t).exp());
        t += STEP;
        if !t.is_finite() || !e.is_finite() {
            return f64::NAN;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(value: f64, expected: f64, relative: f64) -> bool {
        (value / expected - 1.0).abs() < relative
    }

    #[test]
    fn bessel_meets_published_tables() {
        // Abramowitz and Stegun 1964, table 9.8: e^x K_0(x) and e^x K_1(x).
        let table: [(f64, f64, f64); 5] = [
            (0.1, 2.682_326_102_3, 10.890_182_683_0),
            (1.0, 1.144_463_079_7, 1.636_153_486_3),
            (2.0, 0.841_568_215_1, 1.033_476_847_1),
            (5.0, 0.547_807_564_3, 0.600_273_858_8),
            (10.0, 0.391_631_934_4, 0.410_766_570_6),
        ];
        for (x, k0, k1) in table {
            assert!(close(x.exp() * bessel_k(0.0, x), k0, 1e-9), "K_0({x})");
            assert!(close(x.exp() * bessel_k(1.0, x), k1, 1e-9), "K_1({x})");
        }
        // Airy's function, DLMF 9.6.2: Ai(z) = π⁻¹ √(z/3) K_{1/3}(2 z^{3/2}/3), and A&S table
        // 10.11: Ai(1) = 0.13529242, Ai(0.5) = 0.23169361.
        for (z, airy) in [(1.0_f64, 0.135_292_42), (0.5, 0.231_693_61)] {
            let zeta = 2.0 / 3.0 * z.powf(1.5);
            let ours = (z / 3.0).sqrt() / std::f64::consts::PI * bessel_k(1.0 / 3.0, zeta);
            assert!(close(ours, airy, 5e-8), "Ai({z}) = {ours}");
        }
    }

    #[test]
    fn bessel_obeys_its_recurrence() {
        // DLMF 10.29.1: K_{ν+1} = K_{ν−1} + (2ν/x) K_ν
        for nu in [0.3, 1.0, 1.7, 4.2, 11.9] {
            for x in [1e-3, 0.05, 0.7, 3.0, 22.0] {
                let up = bessel_k(nu - 1.0, x) + 2.0 * nu / x * bessel_k(nu, x);
                assert!(close(bessel_k(nu + 1.0, x), up, 1e-12), "ν = {nu}, x = {x}");
            }
        }
    }

    #[test]
    fn closed_forms_and_integral_agree() {
        for nu in [0.5_f64, 1.5, 2.5, 3.5] {
            for a in [1e-6_f64, 0.01, 0.4, 1.0, 3.3, 12.0, 60.0] {
                let log_factor =
                    nu * a.ln() - (nu - 1.0) * std::f64::consts::LN_2 - libm::lgamma(nu);
                let integral = bessel_integral(nu, a, log_factor);
                let closed = closed_form(nu, a).expect("half-integer");
                assert!(close(integral, closed, 1e-12), "ν = {nu}, a = {a}");
            }
        }
        // (1 + √3) e^{−√3} by hand.
        assert!((matern(1.5, 1.0) - 0.483_36).abs() < 1e-5);
    }

    #[test]
    fn correlation_of_a_two_dimensional_field_meets_the_table() {
        // ν = 1: M = a K_1(a), with a = √2 s/l; A&S: K_1(2) = e^{−2} 1.0334768471.
        let s_over_l = 2.0 / 2.0_f64.sqrt();
        assert!(close(matern(1.0, s_over_l), 2.0 * (-2.0_f64).exp() * 1.033_476_847_1, 1e-9));
    }

    #[test]
    fn correlation_starts_at_one_falls_and_ends_at_the_gaussian() {
        for nu in [0.05, 0.31, 1.0, 2.2, 8.0, 50.0] {
            assert!((matern(nu, 0.0) - 1.0).abs() < 1e-15);
            // The behaviour near zero, DLMF 10.30.2: 1 − M falls as s^{2ν} for ν < 1, as s² else.
            let near = 1.0 - matern(nu, 1e-9);
            assert!((0.0..0.2).contains(&near), "ν = {nu}: {near}");
            let mut last = 1.0;
            for k in 1..200 {
                let now = matern(nu, f64::from(k) * 0.05);
                assert!(now < last && now > 0.0, "ν = {nu}");
                last = now;
            }
        }
        // M is the mean of exp(−s²/2 · ν/G) over G ~ Gamma(ν, 1); ν/G has mean 1 + 1/ν and
        // variance 1/ν, so M = e^{−s²/2} (1 + (s⁴/8 − s²/2)/ν + O(1/ν²)).
        for s in [0.3_f64, 1.0, 2.0, 3.0] {
            let nu = 400.0;
            let first_order = nu * (matern(nu, s) * (s * s / 2.0).exp() - 1.0);
            let expected = s.powi(4) / 8.0 - s * s / 2.0;
            assert!((first_order - expected).abs() < 20.0 / nu, "s = {s}: {first_order}");
        }
    }

    #[test]
    fn what_is_no_number_stays_so() {
        assert!(matern(1.2, f64::NAN).is_nan());
        assert!(matern(f64::NAN, 1.0).is_nan());
        assert!(matern(1.2, 1e300).abs() < 1e-300);
        assert!(matern(1.2, f64::INFINITY).abs() < 1e-300);
    }
}
