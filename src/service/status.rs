//! What the service says of itself.

use crate::link::LinkStats;
use crate::link::transport::TransportStats;
use crate::messages::VehicleState;
use crate::mission::Phase;
use crate::pilot::{FlightSummary, VolumeReport};

/// A picture for displays.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ServiceStatus {
    /// The mission's phase; `None` before its first change.
    pub phase: Option<Phase>,
    /// The autopilot's last state.
    pub vehicle: Option<VehicleState>,
    /// The autopilot's clock is known, so its inertial samples are used.
    pub is_clock_known: bool,
    /// The last volume.
    pub volume: Option<VolumeReport>,
    /// Largest standard deviation of the own position, m; `None` before the first fix.
    pub position_sigma_m: Option<f64>,
    /// The last flight that ended.
    pub flight: Option<FlightSummary>,
    /// The service's counters.
    pub stats: ServiceStats,
}

/// Counters since the start; they only grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ServiceStats {
    /// Events the brain took in.
    pub events: u64,
    /// Ticks among them.
    pub ticks: u64,
    /// Ticks left out because the brain was late.
    pub ticks_skipped: u64,
    /// Jobs begun.
    pub jobs_started: u64,
    /// Jobs that died without a result.
    pub jobs_failed: u64,
    /// Records dropped at a full or failed recorder.
    pub records_lost: u64,
    /// Messages to the autopilot dropped at a full transport.
    pub outgoing_lost: u64,
    /// The MAVLink session's counters.
    pub link: LinkStats,
    /// The transport's counters.
    pub transport: TransportStats,
}

impl ServiceStats {
    /// Everything that was dropped anywhere.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.ticks_skipped
            + self.jobs_failed
            + self.records_lost
            + self.outgoing_lost
            + self.transport.received_lost
    }
}
