//! What has changed between two surveys of the same bay.
//!
//! ```text
//! Δ = V₂ − V₁
//! u²(Δ) = i₁ + i₂ + Σ_c (s₂,c − s₁,c)² σ_c²
//! ```
//! - `s_c`: ∂V/∂c of a constant error c with standard deviation `σ_c` that both surveys share
//! - `i`: the rest of each volume's variance, m⁶
//!
//! An error that moves both volumes alike, such as the height of the base, is gone from the
//! difference. Which sources are shared is for the caller to say: the same vehicle, the same
//! marker map, the same base.
//!
//! Checked: `variance_meets_drawn_errors`, `the_verdict_is_wrong_as_often_as_it_says`.

use super::density::Density;
use super::statement::{Statement, StatementError};
use crate::messages::Mass;
use crate::messages::{BudgetSource, VolumeBudget};
use std::collections::BTreeMap;

/// One survey of a bay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurveyVolume<'a> {
    /// Its volume, m³.
    pub volume_m3: f64,
    /// The variance of the volume by source.
    pub budget: &'a VolumeBudget,
}

/// Whether a change can be told from noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChangeVerdict {
    /// Without any change, so much would be seen more rarely than at the accepted risk.
    Significant,
    /// It may be noise.
    Noise,
}

/// The difference of two surveys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Later minus earlier, m³.
    pub change_m3: f64,
    /// Standard deviation of that, m³.
    pub sigma_m3: f64,
    /// What the standard deviation would be if nothing were shared, m³.
    pub unshared_sigma_m3: f64,
    /// The risk of the verdict "significant": how likely at least so large a difference, up or
    /// down, is seen although nothing has changed. 0 to 1.
    pub p_value: f64,
    /// Whether it can be told from noise at the accepted risk.
    pub verdict: ChangeVerdict,
    /// The accepted risk of calling noise significant, 0 to 1.
    pub risk: f64,
    /// The smallest true change that is called significant in 80 % of all pairs, m³.
    pub detectable_m3: f64,
}

impl ChangeVerdict {
    /// A short stable name, for tables and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Significant => "significant",
            Self::Noise => "noise",
        }
    }
}

impl Change {
    /// The change as y ± U in m³.
    ///
    /// # Errors
    /// Numbers that cannot be stated.
    pub fn statement(&self) -> Result<Statement, StatementError> {
        Statement::of_volume(self.change_m3, self.sigma_m3)
    }

    /// The change in tonnes, if the material has kept its density.
    #[must_use]
    pub fn mass(&self, density: &Density) -> Mass {
        density.mass(self.change_m3, self.sigma_m3)
    }
}

/// Why two surveys cannot be compared.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ChangeError {
    /// The accepted risk is none.
    #[error("a risk of {risk} is not between 1e-9 and 0.5")]
    Risk {
        /// What was asked for.
        risk: f64,
    },
    /// A volume or a variance is negative, infinite or no number.
    #[error("a volume or a variance of the surveys is not a finite number")]
    NotFinite,
    /// A source's constant errors have more variance than the source itself.
    #[error(
        "the shared errors of {} have {shared_m6} m⁶, the source itself {row_m6} m⁶",
        source_of_error.name()
    )]
    Inconsistent {
        /// The source.
        source_of_error: BudgetSource,
        /// Variance of its constant errors, m⁶.
        shared_m6: f64,
        /// Variance in its row, m⁶.
        row_m6: f64,
    },
    /// The same error has two standard deviations, so it is not the same error.
    #[error(
        "error {component} of {} has the standard deviations {before} and {after}; \
         the surveys do not share it",
        source_of_error.name()
    )]
    DifferentError {
        /// The source.
        source_of_error: BudgetSource,
        /// Which of its errors.
        component: usize,
        /// Standard deviation in the earlier survey.
        before: f64,
        /// Standard deviation in the later survey.
        after: f64,
    },
}

/// The usual risk of calling noise significant.
pub const USUAL_RISK: f64 = 0.05;
/// Normal quantile of the power of 80 %.
const Z_POWER: f64 = 0.841_621_234;

/// The change from `before` to `after`; `is_shared` says of which sources both surveys have the
/// same constant errors, `risk` how often noise may be called significant (1e-9 to 0.5,
/// [`USUAL_RISK`]).
///
/// # Errors
/// Budgets that contradict themselves or each other, or a risk out of range.
pub fn change(
    before: SurveyVolume<'_>,
    after: SurveyVolume<'_>,
    risk: f64,
    is_shared: impl Fn(BudgetSource) -> bool,
) -> Result<Change, ChangeError> {
    if !(1e-9..=0.5).contains(&risk) {
        return Err(ChangeError::Risk { risk });
    }
    let change_m3 = after.volume_m3 - before.volume_m3;
    let unshared_var_m6 = before.budget.var_m6() + after.budget.var_m6();
    let var_m6 = independent_var_m6(before.budget, &is_shared)?
        + independent_var_m6(after.budget, &is_shared)?
        + shared_var_m6(before.budget, after.budget, &is_shared)?;
    if !(change_m3.is_finite() && var_m6.is_finite() && unshared_var_m6.is_finite()) {
        return Err(ChangeError::NotFinite);
    }
    let sigma_m3 = var_m6.sqrt();
    let p_value = two_sided_p_value(change_m3, sigma_m3);
    Ok(Change {
        change_m3,
        sigma_m3,
        unshared_sigma_m3: unshared_var_m6.sqrt(),
        p_value,
        verdict: if p_value < risk { ChangeVerdict::Significant } else { ChangeVerdict::Noise },
        risk,
        detectable_m3: (two_sided_quantile(risk) + Z_POWER) * sigma_m3,
    })
}

/// The variance of a volume without the constant errors of the shared sources, m⁶.
fn independent_var_m6(
    budget: &VolumeBudget,
    is_shared: &impl Fn(BudgetSource) -> bool,
) -> Result<f64, ChangeError> {
    let mut sum = 0.0;
    for source in BudgetSource::ALL {
        let row_m6 = budget.var_of_m6(source);
        let shared_m6 = budget.shared_var_of_m6(source);
        if !(row_m6 >= 0.0 && row_m6.is_finite() && shared_m6.is_finite()) {
            return Err(ChangeError::NotFinite);
        }
        // Rows and items are sums of the same terms in another order.
        if shared_m6 > row_m6 * (1.0 + 1e-9) {
            return Err(ChangeError::Inconsistent { source_of_error: source, shared_m6, row_m6 });
        }
        if source != BudgetSource::Density {
            sum += if is_shared(source) { (row_m6 - shared_m6).max(0.0) } else { row_m6 };
        }
    }
    Ok(sum)
}

/// What the shared errors add to the difference, m⁶. An error that only one survey knows moves
/// the other not at all: a marker that it never saw.
fn shared_var_m6(
    before: &VolumeBudget,
    after: &VolumeBudget,
    is_shared: &impl Fn(BudgetSource) -> bool,
) -> Result<f64, ChangeError> {
    // By source and component: ∂Δ/∂c and σ.
    let mut errors: BTreeMap<(BudgetSource, usize), (f64, f64)> = BTreeMap::new();
    for (sign, budget) in [(-1.0, before), (1.0, after)] {
        for item in &budget.shared {
            if !is_shared(item.source) || item.source == BudgetSource::Density {
                continue;
            }
            let key = (item.source, item.component);
            let (sensitivity, sigma) = errors.entry(key).or_insert((0.0, item.sigma));
            if (*sigma - item.sigma).abs() > 1e-6 * sigma.abs() {
                return Err(ChangeError::DifferentError {
                    source_of_error: item.source,
                    component: item.component,
                    before: *sigma,
                    after: item.sigma,
                });
            }
            *sensitivity += sign * item.dv_dc;
        }
    }
    Ok(errors.values().map(|(sensitivity, sigma)| (sensitivity * sigma).powi(2)).sum())
}

/// How likely a normal number with mean 0 lies at least as far out.
fn two_sided_p_value(value: f64, sigma: f64) -> f64 {
    if value == 0.0 {
        return 1.0;
    }
    libm::erfc(value.abs() / (sigma * std::f64::consts::SQRT_2))
}

/// How far out a normal number with mean 0 and σ 1 lies with this probability, on either side.
fn two_sided_quantile(risk: f64) -> f64 {
    let (mut low, mut high) = (0.0, 10.0);
    // The interval halves until it has no number inside.
    for _ in 0..60 {
        let middle = f64::midpoint(low, high);
        if two_sided_p_value(middle, 1.0) > risk {
            low = middle;
        } else {
            high = middle;
        }
    }
    f64::midpoint(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::BudgetRow;
    use crate::stats::{Noise, SeedBook};

    /// Independent noise of `noise_m3`, two mounting errors, one of the base.
    fn budget(noise_m3: f64, mounting: [f64; 2], base: f64) -> VolumeBudget {
        let mut budget = VolumeBudget::default();
        let var_m6 = noise_m3.powi(2);
        budget.rows.push(BudgetRow { source: BudgetSource::BeamNoise, var_m6 });
        budget
            .push_shared(BudgetSource::LidarMounting, &[(mounting[0], 0.01), (mounting[1], 0.004)]);
        budget.push_shared(BudgetSource::Base, &[(base, 0.02)]);
        budget
    }

    /// Volumes of two surveys with a common draw of what they share.
    fn draw(noise: &mut Noise, budgets: [&VolumeBudget; 2], shares: bool) -> [f64; 2] {
        let common: Vec<f64> = (0..3).map(|_| noise.normal()).collect();
        budgets.map(|budget| {
            let own = budget.var_of_m6(BudgetSource::BeamNoise).sqrt() * noise.normal();
            let constant: f64 = std::iter::zip(&budget.shared, &common)
                .map(|(item, c)| {
                    let c = if shares { *c } else { noise.normal() };
                    item.dv_dc * item.sigma * c
                })
                .sum();
            own + constant
        })
    }

    fn compare(volumes: [f64; 2], budgets: [&VolumeBudget; 2], shares: bool) -> Change {
        let [before, after] =
            [0, 1].map(|i| SurveyVolume { volume_m3: volumes[i], budget: budgets[i] });
        change(before, after, USUAL_RISK, |_| shares).expect("comparable")
    }

    #[test]
    fn variance_meets_drawn_errors() {
        let first = budget(0.5, [300.0, 100.0], -400.0);
        let second = budget(0.8, [250.0, -50.0], -400.0);
        let budgets = [&first, &second];
        let n = 40_000;
        let mut noise = SeedBook::new(21).stream("surveys");
        for shares in [true, false] {
            let squares: f64 = (0..n)
                .map(|_| draw(&mut noise, budgets, shares))
                .map(|[before, after]| (after - before).powi(2))
                .sum();
            let drawn_m3 = (squares / f64::from(n)).sqrt();
            let claimed = compare([0.0; 2], budgets, shares);
            // The standard error of a σ is σ/√(2n) = 0.35 %; 4 of them.
            assert!((drawn_m3 / claimed.sigma_m3 - 1.0).abs() < 0.014, "{drawn_m3} {claimed:?}");
            // By hand: 0.5² + 0.8² + (50 · 0.01)² + (150 · 0.004)² = 1.5, and the base is gone.
            if shares {
                assert!((claimed.sigma_m3.powi(2) - 1.5).abs() < 1e-9);
                assert!(claimed.unshared_sigma_m3 > 10.0);
            }
        }
    }

    #[test]
    fn the_verdict_is_wrong_as_often_as_it_says() {
        let first = budget(0.5, [300.0, 100.0], -400.0);
        let second = budget(0.8, [250.0, -50.0], -420.0);
        let budgets = [&first, &second];
        let mut noise = SeedBook::new(22).stream("surveys");
        let detectable_m3 = compare([0.0; 2], budgets, true).detectable_m3;
        let n = 20_000;
        let mut share_significant = |true_change_m3: f64| {
            let hits = (0..n).filter(|_| {
                let [before, after] = draw(&mut noise, budgets, true);
                let volumes = [before, after + true_change_m3];
                compare(volumes, budgets, true).verdict == ChangeVerdict::Significant
            });
            hits.fold(0.0, |sum, _| sum + 1.0) / f64::from(n)
        };
        // Standard errors: √(0.05 · 0.95/n) = 0.0015 and √(0.8 · 0.2/n) = 0.0028; 4 of them.
        assert!((share_significant(0.0) - 0.05).abs() < 0.006);
        assert!((share_significant(detectable_m3) - 0.80).abs() < 0.0115);
        assert!((share_significant(-detectable_m3) - 0.80).abs() < 0.0115);
    }

    #[test]
    fn p_values_meet_the_published_table() {
        // Two-sided 5 %, 1 % and 0.1 % of the normal distribution: 1.95996, 2.57583, 3.29053.
        for (z, p) in [(1.959_964, 0.05), (2.575_829, 0.01), (3.290_527, 0.001)] {
            assert!((two_sided_p_value(-3.0 * z, 3.0) / p - 1.0).abs() < 1e-5);
        }
        for (risk, z) in [(0.05, 1.959_964), (0.01, 2.575_829), (0.001, 3.290_527)] {
            assert!((two_sided_quantile(risk) / z - 1.0).abs() < 1e-6, "{risk}");
        }
        assert!((two_sided_p_value(0.0, 0.0) - 1.0).abs() < 1e-15);
        assert!(two_sided_p_value(0.1, 0.0).abs() < 1e-15, "without noise any change is real");
    }

    #[test]
    fn a_marker_that_one_survey_never_saw_does_not_cancel() {
        let mut first = VolumeBudget::default();
        first.push_shared(BudgetSource::MarkerMap, &[(10.0, 0.1), (20.0, 0.1)]);
        let mut second = VolumeBudget::default();
        second.push_shared(BudgetSource::MarkerMap, &[(10.0, 0.1)]);
        let found = compare([5.0, 5.0], [&first, &second], true);
        assert!((found.sigma_m3 - 2.0).abs() < 1e-12);
        assert_eq!(found.verdict, ChangeVerdict::Noise);
        let grown = compare([5.0, 17.0], [&first, &second], true);
        assert_eq!(grown.verdict.name(), "significant");
        assert_eq!(grown.statement().expect("finite").to_string(), "(12.0 ± 4.0) m³ (k = 2)");
        let mass = grown.mass(&Density { mean_t_per_m3: 1.5, sigma_t_per_m3: 0.1 });
        // 18 t; (1.5 · 2)² + (12 · 0.1)² + (2 · 0.1)² = 10.48
        assert!((mass.mass_t - 18.0).abs() < 1e-12);
        assert!((mass.sigma_t.powi(2) - 10.48).abs() < 1e-9);
    }

    #[test]
    fn budgets_that_contradict_are_refused() {
        let good = budget(0.5, [300.0, 100.0], -400.0);
        let of = |budget| SurveyVolume { volume_m3: 1.0, budget };
        let mut recalibrated = good.clone();
        recalibrated.shared[1].sigma = 0.003;
        recalibrated.rows[1].var_m6 = recalibrated.shared_var_of_m6(BudgetSource::LidarMounting);
        let error = change(of(&good), of(&recalibrated), 0.05, |_| true).unwrap_err();
        assert!(matches!(error, ChangeError::DifferentError { component: 1, .. }), "{error}");
        let mounting_is_new = |source| source != BudgetSource::LidarMounting;
        assert!(change(of(&good), of(&recalibrated), 0.05, mounting_is_new).is_ok());
        let mut broken = good.clone();
        broken.rows[1].var_m6 *= 0.5;
        let error = change(of(&good), of(&broken), 0.05, |_| true).unwrap_err();
        assert!(matches!(error, ChangeError::Inconsistent { .. }), "{error}");
        let mut no_number = good.clone();
        no_number.rows[1].var_m6 = f64::NAN;
        let error = change(of(&good), of(&no_number), 0.05, |_| true).unwrap_err();
        assert_eq!(error, ChangeError::NotFinite);
        for risk in [0.0, 0.9, f64::NAN] {
            let error = change(of(&good), of(&good), risk, |_| true).unwrap_err();
            assert!(matches!(error, ChangeError::Risk { .. }), "{error}");
        }
    }

    #[test]
    fn a_stricter_risk_calls_less_significant() {
        let budget = budget(1.0, [0.0, 0.0], 0.0);
        let of = |volume_m3| SurveyVolume { volume_m3, budget: &budget };
        // σ = √2 m³, so 3.2 m³ are 2.26 σ: p = 2.4 %.
        let at = |risk| change(of(10.0), of(13.2), risk, |_| true).expect("comparable");
        assert_eq!(at(0.05).verdict, ChangeVerdict::Significant);
        assert_eq!(at(0.01).verdict, ChangeVerdict::Noise);
        assert!((at(0.01).p_value - 0.0237).abs() < 1e-3, "{:?}", at(0.01));
        // (2.575829 + 0.841621) √2
        assert!((at(0.01).detectable_m3 - 4.833).abs() < 1e-3);
    }
}
