//! Samples of the autopilot on this computer's clock, and the talk that compares the clocks.

use super::origin::Origin;
use super::{HeardAttitude, Session, SessionOutput};
use crate::geometry::{Body, Hall, Rotation};
use crate::link::autopilot_clock::ClockSample;
use crate::link::{AUTOPILOT_COMPONENT, inbound};
use crate::messages::{AutopilotPose, BatterySample, ImuSample};
use crate::pilot::Event;
use crate::time::{Boot, Mono, Stamp};
use mavlink::dialects::ardupilotmega::{
    ATTITUDE_QUATERNION_DATA, LOCAL_POSITION_NED_DATA, MavMessage, TIMESYNC_DATA,
};
use nalgebra::Vector3;
use std::time::Duration;

/// A sample's stamp further than this before its arrival is no stamp.
const MAX_STAMP_AGE: Duration = Duration::from_secs(1);
/// Nothing is measured after it arrived; this much is left to the comparison of clocks.
const MAX_STAMP_AHEAD: Duration = Duration::from_millis(20);
/// An attitude older than this does not belong to a position.
const MAX_ATTITUDE_AGE: Duration = Duration::from_millis(250);

impl HeardAttitude {
    /// The attitude at the instant of another message; `None` if that is too far away.
    ///
    /// Both come ten times a second, each in its own rhythm: in a turn of 1 rad/s they would be 6°
    /// apart by that alone.
    fn turned_to(&self, at: Stamp<Mono>) -> Option<Rotation<Hall, Body>> {
        let later_s = at.seconds_since(self.at);
        let is_near = later_s.abs() <= MAX_ATTITUDE_AGE.as_secs_f64();
        is_near.then(|| self.rotation.perturbed(&(self.rate_radps * later_s)))
    }
}

impl Session {
    pub(super) fn battery(&mut self, sample: Option<BatterySample>, out: &mut SessionOutput) {
        match sample {
            Some(sample) => out.events.push(Event::Battery(sample)),
            None => self.stats.refused_values += 1,
        }
    }

    /// An inertial sample: specific force (m/s²) and angular velocity (rad/s) in Body axes.
    pub(super) fn imu(
        &mut self,
        time_usec: u64,
        measured: Option<(Vector3<f64>, Vector3<f64>)>,
        arrived: Stamp<Mono>,
        out: &mut SessionOutput,
    ) {
        let boot = inbound::boot_from_micros(time_usec);
        let (Some(boot), Some((accel_mps2, gyro_radps))) = (boot, measured) else {
            self.stats.refused_values += 1;
            return;
        };
        self.watch_reboot(boot, arrived, out);
        let Some(at) = self.stamp(boot, arrived) else { return };
        let Some(autopilot) = &mut self.autopilot else { return };
        if autopilot.last_imu_at.is_some_and(|last| at <= last) {
            self.stats.stale_samples += 1;
            return;
        }
        autopilot.last_imu_at = Some(at);
        out.events.push(Event::Imu(ImuSample { at, accel_mps2, gyro_radps }));
    }

    pub(super) fn position(
        &mut self,
        data: &LOCAL_POSITION_NED_DATA,
        arrived: Stamp<Mono>,
        out: &mut SessionOutput,
    ) {
        let Some((position, velocity_mps)) = inbound::local_position(data) else {
            self.stats.refused_values += 1;
            return;
        };
        let boot = self.clock.boot_from_millis(data.time_boot_ms);
        let Some(at) = self.stamp(boot, arrived) else { return };
        let attitude = self.autopilot.as_ref().and_then(|autopilot| autopilot.attitude);
        let hall_from_body_rot = attitude.and_then(|attitude| attitude.turned_to(at));
        let pose = AutopilotPose { at, position, velocity_mps, hall_from_body_rot };
        out.events.push(Event::AutopilotPose(pose));
    }

    pub(super) fn attitude(&mut self, data: &ATTITUDE_QUATERNION_DATA, arrived: Stamp<Mono>) {
        let Some((rotation, rate_radps)) = inbound::attitude(data) else {
            self.stats.refused_values += 1;
            return;
        };
        let boot = self.clock.boot_from_millis(data.time_boot_ms);
        let Some(at) = self.stamp(boot, arrived) else { return };
        if let Some(autopilot) = &mut self.autopilot {
            autopilot.attitude = Some(HeardAttitude { at, rotation, rate_radps });
        }
    }

    /// The stamp on this computer's clock, if the offset is known and gives a credible one.
    fn stamp(&mut self, boot: Stamp<Boot>, arrived: Stamp<Mono>) -> Option<Stamp<Mono>> {
        let Some(at) = self.clock.mono_from_boot(boot) else {
            self.stats.unsynced_samples += 1;
            return None;
        };
        // A clock that has jumped ahead would put the filter where it refuses what follows.
        if at.since(arrived) > MAX_STAMP_AHEAD || arrived.since(at) > MAX_STAMP_AGE {
            self.stats.refused_values += 1;
            return None;
        }
        Some(at)
    }

    /// After a reboot everything that was asked of the autopilot has to be asked again, and
    /// nothing that was under way is repeated.
    fn watch_reboot(&mut self, boot: Stamp<Boot>, now: Stamp<Mono>, out: &mut SessionOutput) {
        if !self.clock.rebooted(boot) {
            return;
        }
        self.stats.autopilot_reboots += 1;
        self.stats.timesync_resets += 1;
        self.streams.forget();
        self.commands.abandon(now, out);
        if let Some(autopilot) = &mut self.autopilot {
            autopilot.origin = Origin::new();
            autopilot.attitude = None;
            autopilot.has_battery_status = false;
            autopilot.mode_heard_at = None;
        }
        out.events.push(Event::AutopilotRebooted(now));
    }

    /// Answers a request with the arrival on the clock that stamps ODOMETRY, or takes in an answer.
    pub(super) fn timesync_in(
        &mut self,
        data: &TIMESYNC_DATA,
        arrived: Stamp<Mono>,
        out: &mut SessionOutput,
    ) {
        if data.tc1 == 0 {
            out.messages.push(MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: arrived.nanos(),
                ts1: data.ts1,
                target_system: self.autopilot_system().unwrap_or(0),
                target_component: AUTOPILOT_COMPONENT,
            }));
            return;
        }
        let Some(boot) = inbound::boot_from_nanos(data.tc1) else {
            self.stats.refused_values += 1;
            return;
        };
        self.watch_reboot(boot, arrived, out);
        match self.clock.on_answer(Stamp::from_nanos(data.ts1), boot, arrived) {
            ClockSample::Fused => self.stats.timesync_accepted += 1,
            ClockSample::Refused | ClockSample::Outlier => self.stats.timesync_refused += 1,
            ClockSample::Reset => {
                self.stats.timesync_refused += 1;
                self.stats.timesync_resets += 1;
                // Perhaps a reboot behind a silent link; then its streams are forgotten too.
                self.streams.forget();
            }
        }
    }
}
