//! The volume for the ground station: numbers that can be plotted, and a line to read.

use super::text::push_text;
use crate::messages::{Severity, VolumeAccount, VolumeEstimate};
use crate::pilot::VolumeReport;
use crate::time::{Mono, Stamp};
use mavlink::dialects::ardupilotmega::{MavMessage, NAMED_VALUE_FLOAT_DATA};
use std::time::Duration;

const VALUES_EVERY: Duration = Duration::from_secs(1);
const TEXT_EVERY: Duration = Duration::from_secs(15);
/// ODOMETRY leaves at 30 Hz while the position is known.
const FIX_LOST_AFTER: Duration = Duration::from_millis(500);
/// U = k σ covers 95 % of a normal distribution.
const COVERAGE_FACTOR: f64 = 2.0;
/// Letters in the name of a value: `NAMED_VALUE_FLOAT.name`.
const NAME_LETTERS: usize = 10;

/// When what was sent last, and the number of the next text.
#[derive(Debug, Clone, Default)]
pub(crate) struct Telemetry {
    values_at: Option<Stamp<Mono>>,
    text_at: Option<Stamp<Mono>>,
    fix_told_at: Option<Stamp<Mono>>,
    /// The quality of the last published pose, and when that was.
    fix: Option<(i8, Stamp<Mono>)>,
    next_text_id: u16,
    /// The newest volumes: of the whole region, then of its bays.
    accounts: Vec<VolumeAccount>,
    /// The bay whose numbers go out next.
    next_bay: usize,
}

impl Telemetry {
    /// Remembers the volumes that the next reports are about.
    pub(crate) fn note(&mut self, accounts: &[VolumeAccount]) {
        self.accounts = accounts.to_vec();
    }

    /// Remembers how good the pose is that was published just now, 1 to 100.
    pub(crate) const fn fixed(&mut self, quality: i8, now: Stamp<Mono>) {
        self.fix = Some((quality, now));
    }

    /// Appends the quality of the fix once a second, from the first fix on; 0 when it is lost.
    pub(crate) fn on_time(&mut self, now: Stamp<Mono>, messages: &mut Vec<MavMessage>) {
        let Some((quality, at)) = self.fix else { return };
        if is_due(self.fix_told_at, VALUES_EVERY, now) {
            self.fix_told_at = Some(now);
            let is_lost = now.since(at) > FIX_LOST_AFTER;
            let value = if is_lost { 0.0 } else { f64::from(quality) };
            push_value("FIX_Q", Some(value), now, messages);
        }
    }

    /// Appends the numbers and the line of `report`, as often as their turn comes; the final
    /// report always goes out.
    pub(crate) fn report(
        &mut self,
        report: &VolumeReport,
        now: Stamp<Mono>,
        messages: &mut Vec<MavMessage>,
    ) {
        if report.is_final || is_due(self.values_at, VALUES_EVERY, now) {
            self.values_at = Some(now);
            push_values(report, now, messages);
            self.push_next_bay(now, messages);
        }
        if report.is_final || is_due(self.text_at, TEXT_EVERY, now) {
            self.text_at = Some(now);
            let severity = if report.is_final { Severity::Notice } else { Severity::Info };
            self.say(severity, &volume_line(&report.estimate, report.is_final), messages);
        }
        if report.is_final {
            for line in self.bays().iter().map(bay_line).collect::<Vec<_>>() {
                self.say(Severity::Notice, &line, messages);
            }
        }
    }

    /// The bays beside the whole region, if there are several or it has a mass to tell.
    fn bays(&self) -> &[VolumeAccount] {
        match self.accounts.as_slice() {
            [only] if only.mass.is_none() => &[],
            [only] => std::slice::from_ref(only),
            [_, bays @ ..] => bays,
            [] => &[],
        }
    }

    /// Appends the numbers of one bay, another one each time: a hall of many bays must not fill
    /// the link.
    fn push_next_bay(&mut self, now: Stamp<Mono>, messages: &mut Vec<MavMessage>) {
        let n_bays = self.bays().len();
        if n_bays == 0 {
            return;
        }
        let index = self.next_bay % n_bays;
        self.next_bay = index + 1;
        let VolumeAccount { name, estimate, mass, .. } = &self.bays()[index];
        let number = index + 1;
        let values = [
            ('V', Some(estimate.volume_m3)),
            ('U', Some(COVERAGE_FACTOR * estimate.sigma_m3)),
            ('T', mass.map(|mass| mass.mass_t)),
        ];
        for (kind, value) in values {
            push_value(&value_name(kind, number, name), value, now, messages);
        }
    }

    /// Appends a line in its pieces.
    pub(crate) fn say(&mut self, severity: Severity, text: &str, messages: &mut Vec<MavMessage>) {
        self.next_text_id = self.next_text_id.checked_add(1).unwrap_or(1);
        push_text(severity, text, self.next_text_id, messages);
    }
}

fn is_due(last: Option<Stamp<Mono>>, every: Duration, now: Stamp<Mono>) -> bool {
    last.is_none_or(|last| now.since(last) >= every)
}

fn volume_line(estimate: &VolumeEstimate, is_final: bool) -> String {
    format!(
        "{}volume {:.1} +- {:.1} m3, coverage {:.0} %",
        if is_final { "final " } else { "" },
        estimate.volume_m3,
        COVERAGE_FACTOR * estimate.sigma_m3,
        // Not "-0 %".
        (100.0 * estimate.coverage_ratio).max(0.0) + 0.0
    )
}

fn push_values(report: &VolumeReport, now: Stamp<Mono>, messages: &mut Vec<MavMessage>) {
    let estimate = &report.estimate;
    let values = [
        ("VOLUME", Some(estimate.volume_m3)),
        ("VOL_U", Some(COVERAGE_FACTOR * estimate.sigma_m3)),
        ("COVERAGE", Some(estimate.coverage_ratio)),
        ("POS_SIGMA", report.position_sigma_m),
    ];
    for (name, value) in values {
        push_value(name, value, now, messages);
    }
}

fn push_value(name: &str, value: Option<f64>, now: Stamp<Mono>, messages: &mut Vec<MavMessage>) {
    if let Some(value) = value.and_then(super::outbound::finite_f32) {
        let time_boot_ms = super::outbound::wire_millis(now);
        let data = NAMED_VALUE_FLOAT_DATA { time_boot_ms, value, name: name.into() };
        messages.push(MavMessage::NAMED_VALUE_FLOAT(data));
    }
}

/// `V1_gravel`: the name of a bay's number, in the ten letters that there are for it.
fn value_name(kind: char, number: usize, bay: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let prefix = format!("{kind}{number}_");
    prefix.chars().chain(bay.chars().map(plain)).take(NAME_LETTERS).collect()
}

/// `final gravel 412.6 +- 5.1 m3, 660.2 +- 18.2 t`
fn bay_line(bay: &VolumeAccount) -> String {
    let VolumeAccount { name, estimate, mass, .. } = bay;
    let expanded_m3 = COVERAGE_FACTOR * estimate.sigma_m3;
    let mut line = format!("final {name} {:.1} +- {expanded_m3:.1} m3", estimate.volume_m3);
    if let Some(mass) = mass {
        line += &format!(", {:.1} +- {:.1} t", mass.mass_t, COVERAGE_FACTOR * mass.sigma_t);
    }
    line
}
