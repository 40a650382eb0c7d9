//! What the page knows: news in, one picture out.

mod gauges;
mod picture;

use super::feed::{News, Pulse};
use super::maps::Maps;
use super::scene::Scene;
use super::series::{Series, VolumePoint};
use super::state::{Level, Line};
use super::verdict::Verdict;
use crate::mapping::statement::COVERAGE_FACTOR;
use crate::messages::{Severity, VolumeAccount};
use crate::mission::Phase;
use crate::pilot::{Action, FlightSummary, Outlook, PlanChoice};
use crate::time::{Mono, Stamp};
use gauges::Gauges;
pub(super) use picture::Beside;
use std::collections::VecDeque;
use tokio::time::Instant;

/// Lines for people that are kept.
const LINES_KEPT: usize = 40;

/// Everything the page knows.
#[derive(Debug)]
pub(super) struct Collector {
    pub(super) scene: Scene,
    pub(super) maps: Maps,
    pub(super) series: Series,
    /// Counts the states, five a second.
    pub(super) seq: u64,
    /// U (k = 2) that is wished for, % of each volume.
    target_percent: f64,
    log: String,
    outlook: Option<Outlook>,
    pulse: Pulse,
    heard_at: Option<Instant>,
    phase_reason: String,
    took_off_at: Option<Stamp<Mono>>,
    landed_at: Option<Stamp<Mono>>,
    accounts: Vec<VolumeAccount>,
    /// The accounts before the newest, for the trend.
    earlier_accounts: Vec<VolumeAccount>,
    /// The newest plan.
    plan: Option<PlanChoice>,
    ended: Option<FlightSummary>,
    verdict: Option<Verdict>,
    gauges: Gauges,
    lines: VecDeque<Line>,
}

impl Collector {
    pub(super) fn new(scene: Scene, maps: Maps, target_percent: f64, log: String) -> Self {
        Self {
            scene,
            maps,
            series: Series::default(),
            seq: 0,
            target_percent,
            log,
            outlook: None,
            pulse: Pulse::default(),
            heard_at: None,
            phase_reason: String::new(),
            took_off_at: None,
            landed_at: None,
            accounts: Vec::new(),
            earlier_accounts: Vec::new(),
            plan: None,
            ended: None,
            verdict: None,
            gauges: Gauges::default(),
            lines: VecDeque::new(),
        }
    }

    /// Takes in news that arrived at `now`.
    pub(super) fn take(&mut self, news: News, now: Instant) {
        match news {
            News::Outlook(outlook, pulse) => self.look(*outlook, *pulse, now),
            News::Coverage(coverage) => self.maps.cover(coverage),
            News::Action(at, action) => self.act(at, action),
        }
    }

    fn look(&mut self, outlook: Outlook, pulse: Pulse, now: Instant) {
        self.heard_at = Some(now);
        self.pulse = pulse;
        self.gauges.look(&outlook);
        let is_flying =
            !matches!(outlook.phase, Phase::Idle | Phase::Preflight) && outlook.has_position;
        if let Some(estimate) = outlook.estimate.as_ref().filter(|_| is_flying) {
            self.series.fly_to(estimate.hall_from_body.origin.coords.into());
        }
        self.outlook = Some(outlook);
    }

    fn act(&mut self, at: Stamp<Mono>, action: Action) {
        match action {
            Action::PhaseChanged(change) => {
                match change.to {
                    Phase::Preflight if !self.is_into_gaps() => self.restart(),
                    Phase::TakeOff if change.from == Phase::Preflight => {
                        self.ended = None;
                        self.verdict = None;
                        self.landed_at = None;
                        self.took_off_at = Some(change.at);
                    }
                    Phase::Idle => self.landed_at = Some(change.at),
                    _ => {}
                }
                self.phase_reason = change.reason;
            }
            Action::FixTreated(record) => self.gauges.fix(&record),
            Action::VolumesAccounted(accounts) => self.account(at, accounts),
            Action::PlanChosen(choice) => self.plan = Some(*choice),
            Action::SurfaceSolved(surface) => self.maps.surface(surface),
            Action::Say(line) => self.say(at, line.severity, line.text),
            Action::Ended(summary) => {
                self.accounts.clone_from(&summary.accounts);
                self.ended = Some(*summary);
            }
            _ => {}
        }
    }

    /// The flight goes on with the survey before it: the brain shows where it stands before it tells of
    /// the step that led there.
    fn is_into_gaps(&self) -> bool {
        self.outlook.as_ref().is_some_and(|outlook| outlook.is_into_gaps)
    }

    /// The next flight measures anew.
    fn restart(&mut self) {
        self.series = Series::default();
        self.maps.restart();
        self.accounts.clear();
        self.earlier_accounts.clear();
        self.plan = None;
        self.took_off_at = None;
        self.landed_at = None;
        self.ended = None;
        self.verdict = None;
        self.gauges.restart();
    }

    fn account(&mut self, at: Stamp<Mono>, accounts: Vec<VolumeAccount>) {
        if let Some(whole) = accounts.first() {
            let estimate = &whole.estimate;
            self.series.push(VolumePoint {
                at_s: at.seconds(),
                volume_m3: estimate.volume_m3,
                expanded_m3: COVERAGE_FACTOR * estimate.sigma_m3,
                coverage: estimate.coverage_ratio,
            });
        }
        self.earlier_accounts = std::mem::replace(&mut self.accounts, accounts);
    }

    fn say(&mut self, at: Stamp<Mono>, severity: Severity, text: String) {
        let level = match severity {
            Severity::Critical | Severity::Error => Level::Bad,
            Severity::Warning => Level::Degraded,
            Severity::Notice | Severity::Info => Level::Good,
        };
        if self.lines.len() == LINES_KEPT {
            self.lines.pop_front();
        }
        self.lines.push_back(Line { at_s: at.seconds(), level, text });
    }

    /// The flight that waits for a decision.
    pub(super) const fn ended(&self) -> Option<&FlightSummary> {
        self.ended.as_ref()
    }

    /// People have decided of the last flight.
    pub(super) const fn decide(&mut self, verdict: Verdict) {
        self.verdict = Some(verdict);
    }

    /// Newest accounts: the whole region, then its bays.
    pub(super) fn accounts(&self) -> &[VolumeAccount] {
        &self.accounts
    }

    /// Counters of the brain.
    pub(super) const fn pulse(&self) -> &Pulse {
        &self.pulse
    }
}

#[cfg(test)]
pub(super) mod tests;
