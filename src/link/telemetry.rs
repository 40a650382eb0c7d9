//! The volume for the ground station: numbers that can be plotted, and a line to read.

use super::text::push_text;
use crate::messages::{Severity, VolumeEstimate};
use crate::pilot::VolumeReport;
use crate::time::{Mono, Stamp};
use mavlink::dialects::ardupilotmega::{MavMessage, NAMED_VALUE_FLOAT_DATA};
use std::time::Duration;

const VALUES_EVERY: Duration = Duration::from_secs(1);
const TEXT_EVERY: Duration = Duration::from_secs(15);
/// U = k σ covers 95 % of a normal distribution.
const COVERAGE_FACTOR: f64 = 2.0;

/// When what was sent last, and the number of the next text.
#[derive(Debug, Default)]
pub(crate) struct Telemetry {
    values_at: Option<Stamp<Mono>>,
    text_at: Option<Stamp<Mono>>,
    next_text_id: u16,
}

impl Telemetry {
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
        }
        if report.is_final || is_due(self.text_at, TEXT_EVERY, now) {
            self.text_at = Some(now);
            let severity = if report.is_final { Severity::Notice } else { Severity::Info };
            self.say(severity, &volume_line(&report.estimate, report.is_final), messages);
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
        100.0 * estimate.coverage_ratio
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
        if let Some(value) = value.and_then(super::outbound::finite_f32) {
            let time_boot_ms = super::outbound::wire_millis(now);
            let data = NAMED_VALUE_FLOAT_DATA { time_boot_ms, value, name: name.into() };
            messages.push(MavMessage::NAMED_VALUE_FLOAT(data));
        }
    }
}
