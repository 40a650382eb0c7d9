//! How long it still takes until a volume's U meets what is aimed at.
//!
//! ```text
//! var(t) = var(now) − r·(t − now)
//! left   = (var(now) − var_aim) / r
//! ```
//! - `var`: variance of the volume, m⁶
//! - `var_aim`: the same when U (k = 2) is what is aimed at, m⁶
//! - `r`: least-squares slope of the variance over the last minute, m⁶/s
//!
//! Ground that nobody has seen yet is many patches whose errors know little of each other, so every metre
//! of the survey takes off its share of the variance. That holds while the survey goes on over ground like
//! that of the last minute; no further is said. What flying does not take off (base, mounting, map of the
//! markers and the like) stays, and an aim below it is never met.
//!
//! Checked: `each_bay_has_a_time_of_its_own_until_its_target`.

use crate::mapping::statement::COVERAGE_FACTOR;
use crate::messages::{BudgetSource, VolumeAccount};
use crate::time::{Mono, Stamp};
use std::collections::VecDeque;
use std::time::Duration;

/// The slope is that of this span …
const SPAN: Duration = Duration::from_secs(60);
/// … of which at least so much must be known …
const LEAST_SPAN_S: f64 = 20.0;
/// … by so many accounts …
const LEAST_ACCOUNTS: usize = 5;
/// … over which the variance has fallen by more than this share.
const LEAST_FALL_RATIO: f64 = 0.02;
/// Nothing is said of times further ahead than this many spans that were looked at.
const FARTHEST_SPANS: f64 = 10.0;
/// What does not fall however much is flown.
const STAYING: [BudgetSource; 7] = [
    BudgetSource::Occlusion,
    BudgetSource::LidarMounting,
    BudgetSource::RangeBias,
    BudgetSource::RangeScale,
    BudgetSource::ClockOffset,
    BudgetSource::MarkerMap,
    BudgetSource::Base,
];

/// The variances of the last minute.
#[derive(Debug, Default)]
pub(super) struct Remaining {
    /// When, and the variances of the accounts in their order, m⁶.
    vars_m6: VecDeque<(Stamp<Mono>, Vec<f64>)>,
}

impl Remaining {
    /// Takes in the accounts of a moment.
    pub(super) fn account(&mut self, at: Stamp<Mono>, accounts: &[VolumeAccount]) {
        // Another flight, or another set of bays, is another story.
        let is_other = |(before, vars): &(Stamp<Mono>, Vec<f64>)| {
            *before >= at || vars.len() != accounts.len() || at.since(*before) > SPAN
        };
        if self.vars_m6.back().is_some_and(is_other) {
            self.vars_m6.clear();
        }
        while self.vars_m6.front().is_some_and(|(before, _)| at.since(*before) > SPAN) {
            self.vars_m6.pop_front();
        }
        let vars = accounts.iter().map(|account| account.estimate.sigma_m3.powi(2));
        self.vars_m6.push_back((at, vars.collect()));
    }

    /// Time from `now` until U of the `nth` account is `percent` of its volume, s; nothing where that is not known,
    /// is the case already, or is not to be expected.
    pub(super) fn until_s(
        &self,
        now: Stamp<Mono>,
        (nth, account): (usize, &VolumeAccount),
        percent: f64,
    ) -> Option<f64> {
        let (newest_at, newest) = self.vars_m6.back()?;
        let var_m6 = *newest.get(nth)?;
        let aim_m6 = (percent / 100.0 / COVERAGE_FACTOR * account.estimate.volume_m3).powi(2);
        let staying = STAYING.iter().map(|source| account.budget.var_of_m6(*source));
        if var_m6 <= aim_m6 || aim_m6 <= staying.sum() {
            return None;
        }
        let span_s = newest_at.seconds_since(self.vars_m6.front()?.0);
        let rate_m6ps = -self.slope_m6ps(nth)?;
        let has_fallen = rate_m6ps * span_s > LEAST_FALL_RATIO * var_m6;
        if span_s < LEAST_SPAN_S || !has_fallen {
            return None;
        }
        let left_s = (var_m6 - aim_m6) / rate_m6ps;
        let age_s = now.seconds_since(*newest_at);
        (left_s < FARTHEST_SPANS * span_s && age_s < SPAN.as_secs_f64())
            .then(|| (left_s - age_s).max(0.0))
    }

    /// Least-squares slope, m⁶/s; nothing of too few accounts.
    fn slope_m6ps(&self, nth: usize) -> Option<f64> {
        let from = self.vars_m6.front()?.0;
        let points: Vec<(f64, f64)> = self
            .vars_m6
            .iter()
            .filter_map(|(at, vars)| Some((at.seconds_since(from), *vars.get(nth)?)))
            .collect();
        if points.len() < LEAST_ACCOUNTS {
            return None;
        }
        #[expect(clippy::cast_precision_loss, reason = "accounts of a minute")]
        let n = points.len() as f64;
        let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / n;
        let (t_mean, var_mean) = (mean(|p| p.0), mean(|p| p.1));
        let above: f64 = points.iter().map(|(t, var)| (t - t_mean) * (var - var_mean)).sum();
        let below: f64 = points.iter().map(|(t, _)| (t - t_mean).powi(2)).sum();
        (below > 0.0).then(|| above / below)
    }
}
