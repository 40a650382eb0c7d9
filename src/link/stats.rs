//! What the link counted.

/// Counters since the start; they only grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LinkStats {
    /// Messages of the autopilot that were looked at.
    pub messages_in: u64,
    /// Frames of the autopilot that its numbering skips: lost on the way.
    pub messages_missed: u64,
    /// Messages handed out to be sent.
    pub messages_out: u64,
    /// Messages of systems or components that are not listened to.
    pub foreign_messages: u64,
    /// Heartbeats of a second autopilot, or of a kind that is not spoken.
    pub refused_autopilots: u64,
    /// Messages with a number that is NaN, infinite or out of range.
    pub refused_values: u64,
    /// Samples that came twice or out of order.
    pub stale_samples: u64,
    /// Samples that came before the autopilot's clock was known.
    pub unsynced_samples: u64,
    /// Clock samples that were fused.
    pub timesync_accepted: u64,
    /// Clock samples that took too long, deviated, or answer nothing that was asked.
    pub timesync_refused: u64,
    /// Restarts of the clock estimate: reboots of the autopilot and repeated deviations.
    pub timesync_resets: u64,
    /// Reboots of the autopilot.
    pub autopilot_reboots: u64,
    /// Silences of the autopilot of more than 3 s.
    pub autopilot_losses: u64,
    /// Origins of the map at a dangerous altitude that were set to 0.
    pub origins_levelled: u64,
    /// Looks at the streams, every 2 s, that found the second time in a row less than three quarters
    /// of the inertial samples that were asked for, on a serial line.
    pub thin_imu_windows: u64,
    /// Requests for a stream of messages.
    pub stream_requests: u64,
    /// Repetitions of unanswered commands.
    pub command_retries: u64,
    /// Commands given up on.
    pub commands_unanswered: u64,
    /// Commands of people that were passed to the brain.
    pub operator_commands: u64,
    /// Commands to this component that it does not know.
    pub unsupported_commands: u64,
    /// Messages that were not sent, for a number in them was NaN or infinite.
    pub outbound_refused: u64,
}

impl LinkStats {
    /// Share of the autopilot's frames that were lost on the way, 0 to 1; 0 before the first.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a share of counts below 2^53")]
    pub fn missed_ratio(&self) -> f64 {
        let all = self.messages_in + self.messages_missed;
        if all == 0 { 0.0 } else { self.messages_missed as f64 / all as f64 }
    }
}
