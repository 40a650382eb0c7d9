//! What holds in every case, at every step.

use super::bench::Seen;
use crate::campaign::DirectFlight;
use mavlink::dialects::ardupilotmega::MavMessage;
use stockpilot::geometry::{Hall, Point};
use stockpilot::mission::Phase;
use stockpilot::time::{Mono, Stamp};

/// The vehicle lags its setpoint by half a metre at 2 m/s in gusts; twice that is no lag.
const LARGEST_OFF_M: f64 = 1.2;
/// A setpoint older than this steers nothing, s.
const STEERED_WITHIN_S: f64 = 0.15;
/// A landing touches the ground no faster, m/s.
const LARGEST_TOUCHDOWN_MPS: f64 = 1.0;
/// Its contact is with the ground, no higher over it than this, m.
const LARGEST_OVER_GROUND_M: f64 = 0.3;
/// A landing without a position drifts: PX4 and ArduPilot were seen to go 2 to 2.5 m in the simulators of
/// their makers, in calm air. More than twice that is no landing any more, m.
const LARGEST_LANDING_DRIFT_M: f64 = 6.0;
/// Faster than any trajectory of the survey, m/s.
const LARGEST_SPEED_MPS: f64 = 3.5;
/// Complaints that are kept: one fault may be seen at every step.
const MOST_COMPLAINTS: usize = 6;

/// The demands of all cases and what was found wanting.
#[derive(Debug)]
pub(super) struct Expectations {
    pub(super) may_touch: bool,
    pub(super) largest_off_m: f64,
    complaints: Vec<String>,
    complained_of_motion_at: Option<Stamp<Mono>>,
    has_touched: bool,
    /// Where the present landing began.
    landing_from: Option<Point<Hall>>,
}

impl Default for Expectations {
    fn default() -> Self {
        Self {
            may_touch: false,
            largest_off_m: LARGEST_OFF_M,
            complaints: Vec::new(),
            complained_of_motion_at: None,
            has_touched: false,
            landing_from: None,
        }
    }
}

impl Expectations {
    /// Looks at the flight after a step.
    pub(super) fn watch(&mut self, flight: &DirectFlight, seen: &Seen) {
        let vehicle = flight.rig.vehicle();
        let autopilot = flight.rig.autopilot();
        if let Some(collision) = vehicle.collision()
            && !self.may_touch
            && !self.has_touched
        {
            self.has_touched = true;
            // Who lands where he is may come down on the slope of a pile, but into no wall.
            let place = collision.place.coords;
            let over_ground_m = place.z - flight.rig.world().height_at(place.x, place.y);
            let is_touchdown = autopilot.is_landing()
                && collision.speed_mps < LARGEST_TOUCHDOWN_MPS
                && over_ground_m.abs() < LARGEST_OVER_GROUND_M;
            if !is_touchdown {
                self.complain(format!("touched something: {collision:?}"));
            }
        }
        if autopilot.is_landed() || self.may_touch || self.complained_of_motion_at.is_some() {
            return;
        }
        let now = flight.rig.now();
        let speed_mps = vehicle.velocity_mps().coords.norm();
        if speed_mps > LARGEST_SPEED_MPS {
            self.complained_of_motion_at = Some(now);
            self.complain(format!("{speed_mps:.1} m/s at {now:?}"));
        }
        self.watch_landing(flight);
        let Some((at, place)) = seen.setpoint else { return };
        // In the take-off the trajectory waits for nobody: rotors spool up first.
        let is_on_its_way = matches!(flight.phase(), Phase::Survey | Phase::Return | Phase::Hold);
        let is_steered = is_on_its_way
            && !flight.link.is_cut
            && autopilot.follows_companion()
            && now.seconds_since(at) < STEERED_WITHIN_S;
        let off_m = (vehicle.hall_from_body().origin.coords - place).norm();
        if is_steered && off_m > self.largest_off_m {
            self.complained_of_motion_at = Some(now);
            self.complain(format!("{off_m:.2} m off its setpoint at {now:?}"));
        }
    }

    /// A landing comes down near where it began.
    fn watch_landing(&mut self, flight: &DirectFlight) {
        if !flight.rig.autopilot().is_landing() {
            self.landing_from = None;
            return;
        }
        let place = flight.rig.vehicle().hall_from_body().origin;
        let from = *self.landing_from.get_or_insert(place);
        let drift_m = (place - from).coords.xy().norm();
        if drift_m > LARGEST_LANDING_DRIFT_M {
            self.complained_of_motion_at = Some(flight.rig.now());
            self.complain(format!("drifts {drift_m:.1} m in a landing"));
        }
    }

    pub(super) fn complain(&mut self, text: String) {
        if self.complaints.len() < MOST_COMPLAINTS {
            self.complaints.push(text);
        }
    }

    pub(super) fn into_complaints(self) -> Vec<String> {
        self.complaints
    }
}

/// True if every number of a message that steers or informs the autopilot is finite.
pub(super) fn finite_numbers(message: &MavMessage) -> bool {
    let all = |numbers: &[f32]| numbers.iter().all(|number| number.is_finite());
    match message {
        MavMessage::SET_POSITION_TARGET_LOCAL_NED(d) => {
            all(&[d.x, d.y, d.z, d.vx, d.vy, d.vz, d.afx, d.afy, d.afz, d.yaw, d.yaw_rate])
        }
        MavMessage::ODOMETRY(d) => {
            all(&[d.x, d.y, d.z, d.vx, d.vy, d.vz, d.rollspeed, d.pitchspeed, d.yawspeed])
                && all(&d.q)
                && all(&d.pose_covariance)
                && all(&d.velocity_covariance)
        }
        MavMessage::COMMAND_LONG(d) => {
            all(&[d.param1, d.param2, d.param3, d.param4, d.param5, d.param6, d.param7])
        }
        MavMessage::NAMED_VALUE_FLOAT(d) => d.value.is_finite(),
        MavMessage::PARAM_VALUE(d) => d.param_value.is_finite(),
        _ => true,
    }
}
