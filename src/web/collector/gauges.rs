//! What is counted over the last seconds.

use crate::messages::{FixRecord, FixSource, HitCounts, Verdict};
use crate::pilot::Outlook;
use crate::time::{Mono, Stamp};
use std::collections::VecDeque;
use std::time::Duration;

/// Shares and rates are those of this span.
const SPAN: Duration = Duration::from_secs(5);

/// Sliding counts.
#[derive(Debug, Default)]
pub(super) struct Gauges {
    /// Frames: when, and whether they were used.
    frames: VecDeque<(Stamp<Mono>, bool)>,
    hits: VecDeque<(Stamp<Mono>, HitCounts)>,
    pub(super) newest: Option<NewestFix>,
    /// When the survey's pace was first looked at, and how far the vehicle had flown.
    pace_from: Option<(Stamp<Mono>, f64)>,
    pub(super) pace_mps: Option<f64>,
}

/// The newest frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct NewestFix {
    pub(super) markers: [usize; 2],
    pub(super) residual_px: Option<f64>,
    pub(super) latency_s: f64,
    pub(super) used_at: Option<Stamp<Mono>>,
}

/// A pace of less flight than this is not known.
const LEAST_PACED: Duration = Duration::from_secs(10);

impl Gauges {
    /// Forgets the last flight.
    pub(super) fn restart(&mut self) {
        *self = Self { newest: self.newest, ..Self::default() };
    }

    /// A frame was treated; a standstill is none.
    pub(super) fn fix(&mut self, record: &FixRecord) {
        if record.source == FixSource::Standstill {
            return;
        }
        let is_used = matches!(record.verdict, Verdict::Fused | Verdict::Initialized);
        let used_before = self.newest.and_then(|newest| newest.used_at);
        let residual_before = self.newest.and_then(|newest| newest.residual_px);
        self.newest = Some(NewestFix {
            markers: [record.n_tags, record.n_tags_used],
            residual_px: record.fix.as_ref().map(|fix| fix.residual_rms_px).or(residual_before),
            latency_s: record.age_s,
            used_at: if is_used { Some(record.at) } else { used_before },
        });
        self.frames.push_back((record.at, is_used));
        keep_span(&mut self.frames, record.at);
    }

    /// The brain was looked at.
    pub(super) fn look(&mut self, outlook: &Outlook) {
        self.hits.push_back((outlook.at, outlook.hits));
        keep_span(&mut self.hits, outlook.at);
        keep_span(&mut self.frames, outlook.at);
        let (from, flown_m) = *self.pace_from.get_or_insert((outlook.at, outlook.flown_m));
        if outlook.at.since(from) >= LEAST_PACED {
            let mps = (outlook.flown_m - flown_m) / outlook.at.seconds_since(from);
            self.pace_mps = Some(mps).filter(|mps| *mps > 0.05);
        }
        if outlook.steps_done == 0 {
            self.pace_from = None;
        }
    }

    /// Share of the frames that were used, and frames per second.
    pub(super) fn frames(&self) -> (Option<f64>, f64) {
        let n_used = self.frames.iter().filter(|(_, is_used)| *is_used).count();
        (
            ratio(n_used as u64, self.frames.len() as u64),
            self.frames.len() as f64 / SPAN.as_secs_f64(),
        )
    }

    /// Share of the beams beside the own body that came back from a trusted range.
    pub(super) fn return_ratio(&self) -> Option<f64> {
        let (first, last) = (self.hits.front()?.1, self.hits.back()?.1);
        let count = |of: fn(&HitCounts) -> u64| of(&last).saturating_sub(of(&first));
        let n_looked = count(|h| h.received).saturating_sub(count(|h| h.own_body + h.on_ground));
        ratio(n_looked.saturating_sub(count(|h| h.no_return)), n_looked)
    }

    /// Share of the mapped beams of the flight that were of dust, edges or machines.
    pub(super) fn dust_ratio(&self) -> Option<f64> {
        let hits = self.hits.back()?.1;
        ratio(hits.refused, hits.used)
    }
}

fn keep_span<T>(samples: &mut VecDeque<(Stamp<Mono>, T)>, now: Stamp<Mono>) {
    while samples.front().is_some_and(|(at, _)| now.since(*at) > SPAN) {
        samples.pop_front();
    }
}

#[expect(clippy::cast_precision_loss, reason = "a share of counts below 2^53")]
fn ratio(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}
