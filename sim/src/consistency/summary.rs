//! What the flights of one setting come to.

use super::GROUPS;
use super::band::{Band, design_effect, mean_band, mean_of_flights};
use super::flight::{FlownFlight, Look};
use serde::Serialize;

/// A pose counts towards the errors in metres and degrees with at least this many tags in view.
const ENOUGH_TAGS: usize = 4;

/// NEES of one group of states over all flights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GroupSummary {
    /// Mean over the flights of their means over time.
    pub nees_mean: f64,
    /// Lower end of the 95 % band.
    pub band_low: f64,
    /// Upper end of the 95 % band.
    pub band_high: f64,
    /// The mean lies inside.
    pub is_inside: bool,
    /// Number of states: what an honest filter's mean tends to.
    pub expected: f64,
    /// Independent looks that all looks are worth.
    pub n_effective: f64,
}

/// The three groups of states.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Groups {
    /// Position, hall axes.
    pub position: GroupSummary,
    /// Attitude, body axes.
    pub attitude: GroupSummary,
    /// Velocity, hall axes.
    pub velocity: GroupSummary,
}

/// NIS per degree of freedom over all attempts to fuse a frame in flight.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NisSummary {
    /// Mean of NIS over its degrees of freedom, gated attempts left out.
    pub per_dof_mean: f64,
    /// What an honest filter's mean tends to: a little below 1, because the gate cuts the tail.
    pub expected: f64,
    /// Lower end of the 95 % band.
    pub band_low: f64,
    /// Upper end of the 95 % band.
    pub band_high: f64,
    /// Attempts.
    pub n: usize,
    /// Share of the attempts that the gate refused; an honest filter's is 0.01.
    pub gated_ratio: f64,
}

/// All flights of one setting.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SettingReport {
    /// From exposure to arrival of a frame, ms.
    pub latency_ms: u64,
    /// How frames enter the filter.
    pub update: &'static str,
    /// Name of the world.
    pub world: String,
    /// Flights.
    pub n_runs: usize,
    /// Looks in flight, over all flights.
    pub n_looks: usize,
    /// Looks without a covariance that can be factored; they count in no mean.
    pub n_broken: usize,
    /// The groups of states.
    pub groups: Groups,
    /// Position, attitude and velocity together, nine states.
    pub pose_and_velocity: GroupSummary,
    /// The innovations.
    pub nis: NisSummary,
    /// Root mean square of the position error where four or more tags are in view, m.
    pub position_rms_m: f64,
    /// Root mean square of the yaw error where four or more tags are in view, °.
    pub yaw_rms_deg: f64,
    /// Looks with four or more tags in view.
    pub n_looks_enough_tags: usize,
}

impl SettingReport {
    /// Sums up the flights.
    #[must_use]
    pub fn new(
        latency_ms: u64,
        update: &'static str,
        world: &str,
        flights: &[FlownFlight],
    ) -> Self {
        let looks: Vec<&Look> =
            flights.iter().flat_map(|f| &f.looks).filter(|look| look.is_flying).collect();
        let enough: Vec<&Look> =
            looks.iter().copied().filter(|look| look.n_tags >= ENOUGH_TAGS).collect();
        let [position, attitude, velocity, pose_and_velocity] =
            [0, 1, 2, 3].map(|group| group_summary(flights, group));
        Self {
            latency_ms,
            update,
            world: world.to_owned(),
            n_runs: flights.len(),
            n_looks: looks.len(),
            n_broken: looks.iter().filter(|look| look.nees[3].is_nan()).count(),
            groups: Groups { position, attitude, velocity },
            pose_and_velocity,
            nis: nis_summary(flights),
            position_rms_m: rms(enough.iter().map(|look| look.position_error_m)),
            yaw_rms_deg: rms(enough.iter().map(|look| look.yaw_error_rad.to_degrees())),
            n_looks_enough_tags: enough.len(),
        }
    }

    /// The groups by name.
    #[must_use]
    pub const fn by_name(&self) -> [(&'static str, GroupSummary); 4] {
        [
            (GROUPS[0].0, self.groups.position),
            (GROUPS[1].0, self.groups.attitude),
            (GROUPS[2].0, self.groups.velocity),
            (GROUPS[3].0, self.pose_and_velocity),
        ]
    }
}

fn group_summary(flights: &[FlownFlight], group: usize) -> GroupSummary {
    let expected = GROUPS[group].1;
    let of_flight = |flight: &FlownFlight| {
        let flying = flight.looks.iter().filter(|look| look.is_flying);
        flying.map(|look| look.nees[group]).filter(|nees| nees.is_finite()).collect()
    };
    let values: Vec<Vec<f64>> = flights.iter().map(of_flight).collect();
    let (nees_mean, n_effective) = mean_and_worth(&values);
    let Band { low, high } = mean_band(expected, n_effective);
    GroupSummary {
        nees_mean,
        band_low: low,
        band_high: high,
        is_inside: (low..=high).contains(&nees_mean),
        expected,
        n_effective,
    }
}

/// The mean over the flights, and how many independent looks stand behind it.
fn mean_and_worth(flights: &[Vec<f64>]) -> (f64, f64) {
    let slices: Vec<&[f64]> = flights.iter().map(Vec::as_slice).collect();
    let n = slices.iter().filter(|looks| !looks.is_empty()).count();
    (mean_of_flights(&slices), count(n) / design_effect(flights))
}

/// E[χ² | χ² below its 99 % quantile] over the degrees of freedom: 1 minus what the tail takes.
///
/// ```text
/// E[χ²_n | χ²_n ≤ g] = n F_{n+2}(g)/F_n(g)
/// ```
/// For 6 degrees of freedom it is 0.978; more degrees lose less. The normal approximation of Wilson
/// and Hilferty gives F.
fn expected_below_gate(dof: f64) -> f64 {
    const Z_99: f64 = 2.326_347_874;
    let c = 2.0 / (9.0 * dof);
    let gate = dof * (1.0 - c + Z_99 * c.sqrt()).powi(3);
    let n = dof + 2.0;
    let d = 2.0 / (9.0 * n);
    let z = ((gate / n).cbrt() - (1.0 - d)) / d.sqrt();
    normal_cdf(z) / 0.99
}

/// Source: Abramowitz and Stegun 1964, 26.2.17; off by 7.5e-8 at most.
fn normal_cdf(z: f64) -> f64 {
    const B: [f64; 5] =
        [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let t = 1.0 / (1.0 + 0.231_641_9 * z.abs());
    let tail = B.iter().rev().fold(0.0, |sum, b| (sum + b) * t);
    let above = tail * (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
    if z >= 0.0 { 1.0 - above } else { above }
}

fn nis_summary(flights: &[FlownFlight]) -> NisSummary {
    let flying = |flight: &FlownFlight| -> Vec<_> {
        flight.fixes.iter().filter(|fix| fix.is_flying).copied().collect()
    };
    let fixes: Vec<Vec<_>> = flights.iter().map(flying).collect();
    let ratios: Vec<Vec<f64>> = fixes
        .iter()
        .map(|fixes| fixes.iter().filter(|f| !f.is_gated).map(|f| f.nis / f.dof).collect())
        .collect();
    let n = fixes.iter().map(Vec::len).sum::<usize>();
    let n_gated = fixes.iter().flatten().filter(|fix| fix.is_gated).count();
    let dof = fixes.iter().flatten().map(|fix| fix.dof).sum::<f64>() / count(n);
    let (per_dof_mean, n_effective) = mean_and_worth(&ratios);
    let expected = expected_below_gate(dof);
    let band = mean_band(dof, n_effective);
    NisSummary {
        per_dof_mean,
        expected,
        band_low: band.low / dof * expected,
        band_high: band.high / dof * expected,
        n,
        gated_ratio: count(n_gated) / count(n),
    }
}

fn rms(errors: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = count(errors.len());
    (errors.map(|e| e * e).sum::<f64>() / n).sqrt()
}

#[expect(clippy::cast_precision_loss, reason = "few looks")]
pub(super) fn count(n: usize) -> f64 {
    n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gate_takes_its_share_of_the_mean() {
        // Even degrees of freedom have F in closed form: F_6(g) = 1 − e^{−g/2}(1 + h + h²/2),
        // F_8 one term h³/6 more, h = g/2 = 8.40595: F_8 = 0.968 from F_6 = 0.99.
        let h: f64 = 8.405_95;
        let f8 = 1.0 - (-h).exp() * (1.0 + h + h * h / 2.0 + h * h * h / 6.0);
        assert!((expected_below_gate(6.0) - f8 / 0.99).abs() < 1e-3, "{f8}");
        assert!((normal_cdf(1.96) - 0.975_002_1).abs() < 1e-6);
        assert!((normal_cdf(-1.0) - 0.158_655_3).abs() < 1e-6);
    }

    fn look(at_s: f64, nees: f64, n_tags: usize) -> Look {
        Look {
            at_s,
            is_flying: true,
            nees: [nees, nees, nees, 3.0 * nees],
            position_error_m: if n_tags < ENOUGH_TAGS { 1.0 } else { 0.02 },
            yaw_error_rad: 0.001,
            n_tags,
        }
    }

    #[test]
    fn only_looks_in_flight_and_with_enough_tags_are_judged() {
        let mut on_ground = look(0.0, 1e6, 8);
        on_ground.is_flying = false;
        let flights = [3.2, 2.8].map(|nees| FlownFlight {
            seed: 0,
            looks: vec![on_ground, look(1.0, nees, 3), look(2.0, nees, 4), look(3.0, nees, 9)],
            fixes: Vec::new(),
        });
        let report = SettingReport::new(30, "loose", "flat", &flights);
        assert!((report.groups.position.nees_mean - 3.0).abs() < 1e-12);
        assert_eq!((report.n_looks, report.n_looks_enough_tags), (6, 4));
        assert!((report.position_rms_m - 0.02).abs() < 1e-12);
        // Looks at one flight are all alike: only the two flights count.
        assert!((report.groups.velocity.n_effective - 2.0).abs() < 1e-12);
    }
}
