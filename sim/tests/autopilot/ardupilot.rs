//! The stub of `ArduPilot` against what was observed on `ArduCopter` 4.7.

use crate::support::{Loop, Wish, origin, setpoint, single};
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavResult};
use stockpilot_sim::autopilot::{ApMode, ApParams, StubArduPilot, StubAutopilot};

const ACCEPTED: [MavResult; 1] = [MavResult::MAV_RESULT_ACCEPTED];
const FAILED: [MavResult; 1] = [MavResult::MAV_RESULT_FAILED];
const DENIED: [MavResult; 1] = [MavResult::MAV_RESULT_DENIED];

fn guided(flight: &mut Loop<StubArduPilot>) -> Vec<MavResult> {
    flight.command(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 4.0, 0.0])
}

fn take_off_command(flight: &mut Loop<StubArduPilot>, height_m: f32) -> Vec<MavResult> {
    let command = MavCmd::MAV_CMD_NAV_TAKEOFF;
    let message = MavMessage::COMMAND_LONG(m::COMMAND_LONG_DATA {
        command,
        param7: height_m,
        target_system: 1,
        target_component: 1,
        ..m::COMMAND_LONG_DATA::DEFAULT
    });
    flight.received.clear();
    flight.send(&message);
    flight.collect();
    flight.acks(command)
}

/// Ready to arm: started, warm, with an origin, fed with velocity.
fn ready(params: ApParams, seed: u64) -> Loop<StubArduPilot> {
    let mut flight = Loop::ardupilot(params, seed);
    flight.sends_velocity = true;
    flight.run(10.0);
    flight.send(&origin(0));
    flight.run(2.0);
    flight
}

fn hovering(params: ApParams, seed: u64, height_m: f64) -> Loop<StubArduPilot> {
    let mut flight = ready(params, seed);
    assert_eq!(guided(&mut flight), ACCEPTED);
    assert_eq!(flight.arm(), ACCEPTED, "{:?}", flight.texts());
    assert_eq!(take_off_command(&mut flight, single(height_m)), ACCEPTED);
    let goal_m = 0.15 + height_m;
    let is_up = flight.run_until(15.0, |l| (l.place()[2] - goal_m).abs() < 0.1);
    assert!(is_up, "still at {:?}", flight.place());
    flight.run(2.0);
    flight
}

fn says(flight: &Loop<StubArduPilot>, text: &str) -> bool {
    flight.texts().iter().any(|heard| heard == text)
}

#[test]
fn guided_arm_take_off_and_land_with_auto_disarm() {
    let mut flight = hovering(ApParams::indoor(), 31, 1.5);
    let [x, y, z] = flight.place();
    assert!((x - 3.0).hypot(y - 2.0) < 0.3 && (z - 1.65).abs() < 0.2, "{:?}", flight.place());
    assert_eq!(flight.command(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3]), ACCEPTED);
    assert!(flight.run_until(15.0, |l| l.stub.is_landed()));
    let landed_at = flight.now();
    assert!(flight.run_until(5.0, |l| !l.stub.is_armed()));
    let waited_s = flight.now().seconds_since(landed_at);
    assert!((1.9..2.3).contains(&waited_s), "disarmed after {waited_s} s");
    assert_eq!(flight.stub.mode(), ApMode::Land, "the mode stays");
}

#[test]
fn arming_is_refused_with_every_reason() {
    let mut flight = Loop::ardupilot(ApParams::indoor(), 32);
    flight.sends_odometry = false;
    flight.run(10.0);
    assert_eq!(flight.arm(), FAILED);
    assert!(says(&flight, "Arm: VisOdom: not healthy"), "{:?}", flight.texts());
    assert!(says(&flight, "Arm: AHRS: waiting for home"));
    assert_eq!(guided(&mut flight), ACCEPTED, "disarmed, any mode will do");
    // A forced arming leaves the mandatory checks.
    let forced = flight.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 21196.0, 0.0]);
    assert_eq!(forced, FAILED);
    assert!(says(&flight, "Arm: Need Position Estimate"));
    assert_eq!(flight.command(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 99.0, 0.0]), FAILED);
    assert!(says(&flight, "No such mode 99"));
}

#[test]
fn a_mode_from_before_ready_is_acknowledged_and_forgotten() {
    let mut flight = Loop::ardupilot(ApParams::indoor(), 33);
    flight.run(0.1);
    let now = flight.now();
    flight.stub.reboot(now);
    flight.run(3.0);
    assert_eq!(guided(&mut flight), ACCEPTED);
    assert_eq!(flight.stub.mode(), ApMode::Guided);
    flight.run(4.0);
    assert!(says(&flight, "ArduPilot Ready"));
    assert_eq!(flight.stub.mode(), ApMode::Stabilize, "the mode switch rules");
}

#[test]
fn an_odometry_in_another_frame_is_dropped_without_a_word() {
    let mut flight = Loop::ardupilot(ApParams::indoor(), 34);
    flight.odometry_frame = m::MavFrame::MAV_FRAME_LOCAL_NED;
    flight.run(12.0);
    assert!(!flight.stub.is_position_valid());
    assert!(!says(&flight, "EKF3 IMU0 is using external nav data"));
    flight.odometry_frame = m::MavFrame::MAV_FRAME_LOCAL_FRD;
    flight.run(2.0);
    assert!(flight.stub.is_position_valid());
    assert!(says(&flight, "EKF3 IMU0 is using external nav data"));
}

#[test]
fn a_setpoint_on_the_ground_calls_the_take_off_off() {
    let mut flight = ready(ApParams::indoor(), 35);
    guided(&mut flight);
    assert_eq!(flight.arm(), ACCEPTED);
    let armed_at = flight.now();
    assert_eq!(take_off_command(&mut flight, 1.5), ACCEPTED);
    flight.run(0.2);
    flight.send(&setpoint(&Wish::stay([3.0, 2.0, 2.0])));
    assert!(flight.run_until(12.0, |l| !l.stub.is_armed()), "stays down and disarms");
    let waited_s = flight.now().seconds_since(armed_at);
    assert!((9.7..10.2).contains(&waited_s), "disarmed after {waited_s} s");
    assert!(flight.place()[2] < 0.2, "never lifted: {:?}", flight.place());
}

#[test]
fn a_lone_position_holds_for_ever_and_a_lone_velocity_for_three_seconds() {
    let mut params = ApParams::indoor();
    params.set("GUID_TIMEOUT", 3.0);
    let mut flight = hovering(params, 36, 1.5);
    let [x, y, z] = flight.place();
    let mut lone = m::SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT;
    lone.coordinate_frame = m::MavFrame::MAV_FRAME_LOCAL_NED;
    (lone.x, lone.y, lone.z) = (single(x + 1.0), single(-y), single(-z));
    lone.type_mask = m::PositionTargetTypemask::from_bits_retain(0xDF8);
    flight.send(&MavMessage::SET_POSITION_TARGET_LOCAL_NED(lone.clone()));
    flight.run(15.0);
    assert!((flight.place()[0] - x - 1.0).abs() < 0.2, "{:?}", flight.place());
    // 0.4 m/s for 3 s, then braked within one: 1.2 + 0.2 m.
    lone.vy = -0.4;
    lone.type_mask = m::PositionTargetTypemask::from_bits_retain(0xDC7);
    let before_m = flight.place()[1];
    flight.send(&MavMessage::SET_POSITION_TARGET_LOCAL_NED(lone));
    flight.run(8.0);
    let moved_m = flight.place()[1] - before_m;
    assert!((moved_m - 1.4).abs() < 0.25, "moved by {moved_m} m");
    assert_eq!(flight.stub.mode(), ApMode::Guided);
}

#[test]
fn lost_vision_is_noticed_after_eight_seconds() {
    let mut flight = hovering(ApParams::indoor(), 37, 1.5);
    flight.sends_odometry = false;
    let lost_at = flight.now();
    assert!(flight.run_until(12.0, |l| l.stub.mode() == ApMode::Land));
    let waited_s = flight.now().seconds_since(lost_at);
    assert!((7.8..8.1).contains(&waited_s), "LAND after {waited_s} s");
    assert!(says(&flight, "EKF variance"));
    assert!(says(&flight, "EKF Failsafe: changed to LAND Mode"));
}

#[test]
fn nothing_but_the_heartbeat_flows_unasked() {
    let mut flight = Loop::ardupilot(ApParams::indoor(), 38);
    flight.run(5.0);
    let is_talk = |message: &MavMessage| {
        matches!(message, MavMessage::HEARTBEAT(_) | MavMessage::STATUSTEXT(_))
    };
    assert!(!flight.received.is_empty() && flight.received.iter().all(is_talk));
    let interval = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
    assert_eq!(flight.command(interval, [0.0, 33_333.0, 0.0]), ACCEPTED, "HEARTBEAT");
    assert_eq!(flight.command(interval, [9999.0, 10_000.0, 0.0]), DENIED);
    assert!(says(&flight, "No ap_message for mavlink id (9999)"));
    assert_eq!(flight.command(interval, [105.0, 1_000.0, 0.0]), DENIED, "1000 Hz");
    assert_eq!(flight.command(interval, [105.0, 4_000.0, 0.0]), ACCEPTED, "250 Hz");
    assert_eq!(flight.command(MavCmd::MAV_CMD_REQUEST_MESSAGE, [9999.0, 0.0, 0.0]), FAILED);
    // Known but not there yet: yes, and nothing comes.
    assert_eq!(flight.command(MavCmd::MAV_CMD_REQUEST_MESSAGE, [49.0, 0.0, 0.0]), ACCEPTED);
    assert!(!flight.received.iter().any(|m| matches!(m, MavMessage::GPS_GLOBAL_ORIGIN(_))));
}

#[test]
fn the_first_origin_counts() {
    let mut flight = Loop::ardupilot(ApParams::indoor(), 39);
    flight.run(3.0);
    for altitude_mm in [1_000, 2_000] {
        flight.send(&origin(altitude_mm));
        flight.run(0.1);
    }
    let origins: Vec<i32> = flight
        .received
        .iter()
        .filter_map(|message| match message {
            MavMessage::GPS_GLOBAL_ORIGIN(data) => Some(data.altitude),
            _ => None,
        })
        .collect();
    assert_eq!(origins, [1_000]);
}

#[test]
fn a_heading_by_compass_is_another_than_the_halls() {
    let of = |changes: &[(&str, f32)]| {
        let mut params = ApParams::indoor();
        for (name, value) in changes {
            assert!(params.set(name, *value), "{name}");
        }
        let mut flight = Loop::ardupilot(params, 7);
        flight.run(10.0);
        let belief = StubAutopilot::ArduPilot(flight.stub.clone());
        let (hall_from_body, _) = belief.believed_motion();
        (flight.stub.is_position_valid(), hall_from_body.rotation.yaw_rad())
    };
    let (is_valid, yaw_rad) = of(&[]);
    assert!(is_valid && (yaw_rad - 0.4).abs() < 0.02, "{yaw_rad}");
    let (is_valid, _) = of(&[("EK3_SRC1_YAW", 1.0)]);
    assert!(!is_valid, "no compass, no heading");
    let (is_valid, yaw_rad) = of(&[("EK3_SRC1_YAW", 1.0), ("COMPASS_ENABLE", 1.0)]);
    assert!(is_valid && (yaw_rad - (0.4 - 0.7)).abs() < 0.02, "{yaw_rad}");
}
