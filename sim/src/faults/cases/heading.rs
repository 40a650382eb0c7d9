//! The autopilot takes its place from vision and its heading from elsewhere.

use super::Lab;
use crate::autopilot::{Flavour, ParamValue, StubAutopilot};
use crate::faults::bench::Bench;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use stockpilot::mission::Phase;
use stockpilot::time::{Mono, Stamp};

/// How fast the heading in ODOMETRY drifts, °/s.
const DRIFT_DEGPS: f64 = 10.0;
/// Where the drift ends, °: a landing by a heading that goes on turning would not end on its place.
const DRIFTED_DEG: f64 = 40.0;
/// In flight it lands beyond this, °; a start is refused beyond [`STANDS_DEG`].
const FLIES_DEG: f64 = 15.0;
const STANDS_DEG: f64 = 10.0;

pub(super) fn disagreement(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(drift_in_flight)?;
    lab.fly(drift_in_a_hold)?;
    lab.fly(by_compass)?;
    if lab.flavour == Flavour::Px4 {
        lab.fly(without_any)?;
    }
    Ok(())
}

/// Flying, a wrong heading turns the velocity that is fused: the place may be wrong sooner than the
/// heading that is believed.
fn drift_in_flight(bench: &mut Bench) {
    bench.survey();
    drifting_heading(bench);
    bench.safe_within(6.0, "lands", |b| b.phase() == Phase::Land);
    let is_down = bench.until(40.0, Bench::is_down);
    bench.demand(is_down, "on the ground in the end");
}

/// The heading that reaches the autopilot drifts away from now on.
fn drifting_heading(bench: &mut Bench) {
    bench.strike();
    let struck_at = bench.now();
    bench.flight.link.tamper_with(move |_, now, (header, mut message)| {
        if let MavMessage::ODOMETRY(data) = &mut message {
            data.q = turned(data.q, drifted_rad(struck_at, now));
        }
        vec![(header, message)]
    });
}

/// Standing in the air, nothing but the heading is wrong.
fn drift_in_a_hold(bench: &mut Bench) {
    bench.survey();
    bench.flight.operator_mut().ask(MavCmd::MAV_CMD_USER_2);
    let is_held = bench.until(3.0, |b| b.phase() == Phase::Hold);
    bench.demand(is_held, "holds when asked");
    bench.run(3.0);
    drifting_heading(bench);
    // The belief follows the drift late: it has gyroscopes.
    let mut largest_deg = 0.0_f64;
    while bench.since_s() < 12.0 && bench.phase() != Phase::Land {
        bench.step();
        largest_deg = largest_deg.max(turned_deg(bench));
    }
    bench.safe_within(12.0, "lands", |b| b.phase() == Phase::Land);
    // What the drift adds in half a second, and in a tenth until it is told.
    let most_deg = FLIES_DEG + 0.6 * DRIFT_DEGPS;
    let is_seen = FLIES_DEG < largest_deg && largest_deg < most_deg;
    bench.demand(is_seen, &format!("{largest_deg:.1} deg turned"));
    let is_down = bench.until(40.0, Bench::is_down);
    bench.demand(is_down, "on the ground in the end");
    bench.demand(bench.said("autopilot's heading"), "people are told");
}

/// Its place is vision's, its heading a compass's: it could be armed, and would fly away.
fn by_compass(bench: &mut Bench) {
    set(
        bench,
        &[("EKF2_EV_CTRL", 7), ("EKF2_MAG_TYPE", 0), ("SYS_HAS_MAG", 1)],
        &[("EK3_SRC1_YAW", 1.0), ("COMPASS_ENABLE", 1.0)],
    );
    bench.strike();
    bench.safe_already();
    bench.run(30.0);
    let has_place = bench.flight.rig.autopilot().is_position_valid();
    bench.demand(has_place, "the autopilot itself is content");
    bench.demand(turned_deg(bench) > STANDS_DEG, "its heading is the compass's");
    bench.run(42.0);
    bench.demand(bench.seen.commands.is_empty(), "nothing is asked of it");
    bench.demand(bench.said("the autopilot's heading is 40"), "people are told what to do");
}

/// Neither vision's heading nor a compass: PX4 never aligns, and takes no place.
fn without_any(bench: &mut Bench) {
    set(bench, &[("EKF2_EV_CTRL", 7)], &[]);
    bench.strike();
    bench.safe_already();
    let mut was_valid = false;
    for _ in 0..72 {
        bench.run(1.0);
        was_valid |= bench.flight.rig.autopilot().is_position_valid();
    }
    bench.demand(!was_valid, "no position without a heading");
    bench.demand(!bench.flight.rig.autopilot().is_armed(), "never armed");
    bench.demand(bench.said("no take-off"), "people are told");
}

/// Degrees between the autopilot's heading and the brain's.
fn turned_deg(bench: &Bench) -> f64 {
    let (autopilot, _) = bench.flight.rig.autopilot().believed_motion();
    let own = bench.flight.estimate();
    own.map_or(0.0, |own| {
        let apart = own.hall_from_body.rotation.inverse() * autopilot.rotation;
        apart.yaw_rad().to_degrees().abs()
    })
}

fn drifted_rad(since: Stamp<Mono>, now: Stamp<Mono>) -> f64 {
    (DRIFT_DEGPS * now.seconds_since(since)).min(DRIFTED_DEG).to_radians()
}

/// An attitude of ODOMETRY, (w, x, y, z), turned about the vertical.
fn turned(wxyz: [f32; 4], by_rad: f64) -> [f32; 4] {
    let [w, x, y, z] = wxyz.map(f64::from);
    let attitude = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let q = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), by_rad) * attitude;
    #[expect(clippy::cast_possible_truncation, reason = "a quaternion on the wire")]
    [q.w, q.i, q.j, q.k].map(|c| c as f32)
}

/// Sets parameters of whichever family is flown.
fn set(bench: &mut Bench, px4: &[(&str, i32)], ardupilot: &[(&str, f32)]) {
    let mut are_known = true;
    match bench.autopilot() {
        StubAutopilot::Px4(stub) => {
            for (name, value) in px4 {
                are_known &= stub.params_mut().set(name, ParamValue::Int(*value));
            }
        }
        StubAutopilot::ArduPilot(stub) => {
            for (name, value) in ardupilot {
                are_known &= stub.params_mut().set(name, *value);
            }
        }
    }
    bench.demand(are_known, "the parameters exist");
}
