//! What PX4 v1.16.1 refuses, and the words and numbers it uses.

use crate::support::{Loop, OPERATOR, Wish, command_long, heartbeat, origin, setpoint};
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavResult};
use mavlink::types::CharArray;
use stockpilot_sim::autopilot::{COMPANION_COMPONENT, ParamTable, ParamValue, Px4Mode};

const ACCEPTED: MavResult = MavResult::MAV_RESULT_ACCEPTED;
const REJECTED: MavResult = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;

fn on_pad() -> Loop {
    let mut flight = Loop::new(ParamTable::indoor(), 7);
    flight.run(2.0);
    flight
}

fn bits(flight: &mut Loop) -> (u32, u8, m::MavState) {
    flight.received.clear();
    flight.run(1.1);
    let heartbeat = flight.last_heartbeat().expect("a heartbeat each second");
    (heartbeat.custom_mode, heartbeat.base_mode.bits(), heartbeat.system_status)
}

#[test]
fn heartbeat_shows_mode_arming_and_health() {
    let mut flight = on_pad();
    // Boots into Hold, which needs a global position that nobody gave.
    assert_eq!(bits(&mut flight), (0x0304_0000, 0x1d, m::MavState::MAV_STATE_UNINIT));
    assert_eq!(flight.set_mode(6.0, 0.0), [ACCEPTED, ACCEPTED]);
    assert_eq!(bits(&mut flight), (0x0006_0000, 0x01, m::MavState::MAV_STATE_UNINIT));
    flight.wish = Some(Wish::stay(flight.place()));
    assert_eq!(bits(&mut flight), (0x0006_0000, 0x11, m::MavState::MAV_STATE_STANDBY));
    assert_eq!(flight.arm(), [ACCEPTED]);
    assert_eq!(bits(&mut flight), (0x0006_0000, 0x91, m::MavState::MAV_STATE_ACTIVE));
}

#[test]
fn arming_is_refused_without_position_or_setpoints() {
    let mut flight = Loop::new(ParamTable::indoor(), 7);
    flight.sends_odometry = false;
    flight.wish = Some(Wish::stay([3.0, 2.0, 0.15]));
    flight.run(2.0);
    flight.set_mode(6.0, 0.0);
    assert_eq!(flight.arm(), [REJECTED]);
    let text = "Arming denied: Resolve system health failures first";
    assert!(flight.heard_text(text), "{:?}", flight.texts());
    // 52 characters with the tab: "…firs" and "t\t".
    let chunks = flight.ground.iter().filter(|(_, message)| match message {
        MavMessage::STATUSTEXT(data) => data.id != 0,
        _ => false,
    });
    assert_eq!(chunks.count(), 2);
    assert!(!flight.received.iter().any(|message| matches!(message, MavMessage::STATUSTEXT(_))));

    flight.sends_odometry = true;
    flight.run(2.0);
    flight.wish = None;
    flight.run(1.1);
    assert_eq!(flight.arm(), [REJECTED], "no setpoints for more than a second");
    let forced = [1.0, 21196.0, 0.0];
    let acks = flight.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, forced);
    assert_eq!(acks, [REJECTED], "checks run even for a forced arming");
}

#[test]
fn commands_are_answered_as_in_the_table() {
    let mut flight = on_pad();
    let disarm = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
    assert_eq!(flight.command(disarm, [0.0; 3]), [ACCEPTED], "disarm when disarmed");
    assert_eq!(flight.set_mode(4.0, 99.0), [ACCEPTED, REJECTED]);
    assert_eq!(flight.set_mode(77.0, 0.0), [ACCEPTED, ACCEPTED]);
    assert_eq!(flight.stub.mode(), Px4Mode::Loiter, "an unknown main mode changes nothing");
    let interval = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
    assert_eq!(flight.command(interval, [105.0, 5000.0, 0.0]), [ACCEPTED]);
    assert_eq!(flight.command(interval, [9999.0, 5000.0, 0.0]), [MavResult::MAV_RESULT_FAILED]);
    // `set_message_interval` begins with a refusal for HEARTBEAT.
    assert_eq!(flight.command(interval, [0.0, 33_333.0, 0.0]), [MavResult::MAV_RESULT_FAILED]);
    assert_eq!(flight.command(interval, [436.0, 20_000.0, 0.0]), [ACCEPTED]);
    let request = MavCmd::MAV_CMD_REQUEST_MESSAGE;
    assert_eq!(flight.command(request, [148.0, 0.0, 0.0]), [ACCEPTED]);
    for unset in [242.0, 49.0, 9999.0] {
        let acks = flight.command(request, [unset, 0.0, 0.0]);
        assert_eq!(acks, [MavResult::MAV_RESULT_DENIED], "message {unset}");
    }
    let unknown = MavCmd::MAV_CMD_USER_1;
    assert_eq!(flight.command(unknown, [0.0; 3]), [MavResult::MAV_RESULT_UNSUPPORTED]);
    flight.received.clear();
    flight.send(&command_long(disarm, [1.0, 0.0, 0.0], 77));
    flight.collect();
    assert!(flight.acks(disarm).is_empty(), "another component's command is met with silence");
}

#[test]
fn the_heartbeat_keeps_its_second_and_current_mode_tells_changes_at_once() {
    let mut flight = on_pad();
    let interval = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
    let modes = |flight: &Loop| -> Vec<(u32, u32)> {
        let mode = |message: &MavMessage| match message {
            MavMessage::CURRENT_MODE(data) => Some((data.custom_mode, data.intended_custom_mode)),
            _ => None,
        };
        flight.received.iter().filter_map(mode).collect()
    };
    let heartbeats = |flight: &Loop| {
        flight.received.iter().filter(|m| matches!(m, MavMessage::HEARTBEAT(_))).count()
    };
    flight.command(interval, [0.0, 33_333.0, 0.0]);
    flight.received.clear();
    flight.run(10.0);
    assert_eq!((modes(&flight).len(), heartbeats(&flight)), (5, 10), "the defaults");
    assert_eq!(flight.command(interval, [436.0, 20_000.0, 0.0]), [ACCEPTED]);
    flight.received.clear();
    flight.run(10.0);
    let n_modes = modes(&flight).len();
    assert!(n_modes.abs_diff(20) <= 1, "published twice a second while nothing changes: {n_modes}");
    assert_eq!(heartbeats(&flight), 10);
    flight.received.clear();
    flight.stub.pilot_switches_to(Px4Mode::Stabilized);
    flight.run(0.025);
    assert_eq!(modes(&flight).last(), Some(&(0x0007_0000, 0x0007_0000)));
}

/// External vision's bits: 1 horizontal, 2 vertical, 4 velocity, 8 heading.
#[test]
fn without_a_heading_no_place_is_taken_and_a_compass_gives_a_wrong_one() {
    // The vehicle stands 0.4 rad to the left of the hall's x axis.
    let of = |changes: &[(&str, i32)]| {
        let mut params = ParamTable::indoor();
        for (name, value) in changes {
            assert!(params.set(name, ParamValue::Int(*value)), "{name}");
        }
        let mut flight = Loop::new(params, 7);
        flight.run(10.0);
        let (hall_from_body, _) = flight.stub.believed_motion();
        (flight.stub.is_position_valid(), hall_from_body.rotation.yaw_rad())
    };
    let (is_valid, yaw_rad) = of(&[]);
    assert!(is_valid && (yaw_rad - 0.4).abs() < 0.02, "{yaw_rad}");
    let (is_valid, _) = of(&[("EKF2_EV_CTRL", 7)]);
    assert!(!is_valid, "yaw is never aligned");
    // The hall's x axis points 0.7 rad east of magnetic north, and nobody has told the autopilot.
    let (is_valid, yaw_rad) = of(&[("EKF2_EV_CTRL", 7), ("EKF2_MAG_TYPE", 0), ("SYS_HAS_MAG", 1)]);
    assert!(is_valid && (yaw_rad - (0.4 - 0.7)).abs() < 0.02, "{yaw_rad}");
    // Vision's heading displaces it.
    let (is_valid, yaw_rad) = of(&[("EKF2_MAG_TYPE", 0), ("SYS_HAS_MAG", 1)]);
    assert!(is_valid && (yaw_rad - 0.4).abs() < 0.02, "{yaw_rad}");
}

#[test]
fn modes_and_disarming_in_the_air() {
    let mut flight = on_pad();
    flight.take_off(2.0);
    let disarm = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
    assert_eq!(flight.command(disarm, [0.0; 3]), [REJECTED]);
    assert!(flight.heard_text("Disarming denied: not landed"));
    // Hold needs an origin.
    assert_eq!(flight.set_mode(4.0, 3.0), [ACCEPTED, REJECTED]);
    assert_eq!(flight.stub.mode(), Px4Mode::Offboard);
    assert!(!flight.texts().iter().any(|text| text.contains("not available")));
    let now = flight.now();
    let hold = command_long(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 4.0, 3.0], 1);
    flight.stub.forward(now, OPERATOR, &hold);
    flight.collect();
    assert!(flight.heard_text("Switching to Hold is currently not available"));

    flight.send(&origin(0));
    flight.collect();
    assert!(flight.received.iter().any(|m| matches!(m, MavMessage::GPS_GLOBAL_ORIGIN(_))));
    assert_eq!(flight.set_mode(4.0, 3.0), [ACCEPTED, ACCEPTED]);
    flight.wish = None;
    let before = flight.place();
    flight.run(10.0);
    let after = flight.place();
    assert_eq!(flight.stub.mode(), Px4Mode::Loiter);
    assert!((0..3).all(|i| (after[i] - before[i]).abs() < 0.15), "{before:?} to {after:?}");
    // Back to OFFBOARD without setpoints is refused by the second answer.
    assert_eq!(flight.set_mode(6.0, 0.0), [ACCEPTED, REJECTED]);
}

#[test]
fn setpoints_with_a_wrong_frame_or_nothing_in_them_do_not_count() {
    let mut flight = on_pad();
    let MavMessage::SET_POSITION_TARGET_LOCAL_NED(good) = setpoint(&Wish::stay([3.0, 2.0, 0.15]))
    else {
        panic!("a setpoint is a setpoint");
    };
    let mut wrong_frame = good.clone();
    wrong_frame.coordinate_frame = m::MavFrame::MAV_FRAME_LOCAL_FRD;
    let mut empty = good;
    empty.type_mask = m::PositionTargetTypemask::from_bits_retain(0xDFF);
    for bad in [wrong_frame, empty] {
        flight.send(&MavMessage::SET_POSITION_TARGET_LOCAL_NED(bad));
    }
    flight.set_mode(6.0, 0.0);
    assert_eq!(flight.arm(), [REJECTED]);
    let frame = "SET_POSITION_TARGET_LOCAL_NED coordinate frame 20 unsupported";
    assert!(flight.heard_text(frame), "{:?}", flight.texts());
    assert!(flight.heard_text("SET_POSITION_TARGET_LOCAL_NED invalid"));
}

#[test]
fn odometry_counts_by_estimator_and_rate() {
    let mut lidar = Loop::new(ParamTable::indoor(), 7);
    lidar.estimator = m::MavEstimatorType::MAV_ESTIMATOR_TYPE_LIDAR;
    lidar.run(3.0);
    assert!(!lidar.stub.is_position_valid());
    // PX4 fuses from 5 Hz upwards and not at 3 Hz.
    for (hz, is_fused) in [(3, false), (4, false), (6, true), (30, true)] {
        let mut flight = Loop::new(ParamTable::indoor(), 7);
        flight.odometry_hz = hz;
        flight.run(4.0);
        assert_eq!(flight.stub.is_position_valid(), is_fused, "{hz} Hz");
    }
    let mut defaults = Loop::new(ParamTable::defaults(), 7);
    defaults.run(3.0);
    assert!(!defaults.stub.is_position_valid(), "EKF2_EV_CTRL is off by default");
}

#[test]
fn parameters_travel_bytewise_and_errors_stay_unanswered() {
    let mut flight = on_pad();
    let set = |name: &str, value: f32, param_type| {
        MavMessage::PARAM_SET(m::PARAM_SET_DATA {
            param_value: value,
            target_system: 1,
            target_component: 1,
            param_id: CharArray::from(name),
            param_type,
        })
    };
    let answers = |flight: &mut Loop, message: &MavMessage| {
        flight.received.clear();
        flight.send(message);
        flight.collect();
        let values = flight.received.iter().filter_map(|message| match message {
            MavMessage::PARAM_VALUE(data) => Some((data.param_value.to_bits(), data.param_type)),
            _ => None,
        });
        values.collect::<Vec<_>>()
    };
    let int = m::MavParamType::MAV_PARAM_TYPE_INT32;
    let real = m::MavParamType::MAV_PARAM_TYPE_REAL32;
    let eleven = f32::from_bits(11);
    assert_eq!(answers(&mut flight, &set("EKF2_EV_CTRL", eleven, int)), [(11, int)]);
    assert_eq!(flight.stub.params().get("EKF2_EV_CTRL"), Some(ParamValue::Int(11)));
    assert!(answers(&mut flight, &set("EKF2_EV_CTRL", 1.0, real)).is_empty(), "wrong type");
    assert!(answers(&mut flight, &set("NO_SUCH_NAME", 1.0, real)).is_empty(), "unknown name");

    flight.received.clear();
    flight.send(&MavMessage::PARAM_REQUEST_LIST(m::PARAM_REQUEST_LIST_DATA {
        target_system: 1,
        target_component: 1,
    }));
    flight.run(2.0);
    let names = flight.received.iter().filter_map(|message| match message {
        MavMessage::PARAM_VALUE(data) => Some(data.param_id.to_str().unwrap().to_owned()),
        _ => None,
    });
    let names: Vec<String> = names.collect();
    assert_eq!(names.len(), flight.stub.params().len() + 1);
    assert_eq!(names.last().map(String::as_str), Some("_HASH_CHECK"));
}

#[test]
fn messages_pass_between_the_links() {
    let mut flight = on_pad();
    let now = flight.now();
    flight.received.clear();
    let start = command_long(MavCmd::MAV_CMD_USER_1, [0.0; 3], COMPANION_COMPONENT);
    flight.stub.forward(now, OPERATOR, &start);
    flight.stub.forward(now, OPERATOR, &heartbeat(m::MavType::MAV_TYPE_GCS));
    flight.collect();
    assert!(flight.received.contains(&start));
    assert!(flight.received.contains(&heartbeat(m::MavType::MAV_TYPE_GCS)));
    assert!(flight.acks(MavCmd::MAV_CMD_USER_1).is_empty(), "the stub answers for itself only");

    let value = MavMessage::NAMED_VALUE_FLOAT(m::NAMED_VALUE_FLOAT_DATA {
        time_boot_ms: 1,
        value: 412.6,
        name: CharArray::from("VOLUME"),
    });
    flight.send(&value);
    flight.collect();
    let heard = flight.ground.iter().find(|(_, message)| *message == value);
    assert_eq!(heard.map(|(header, _)| header.component_id), Some(COMPANION_COMPONENT));
}

#[test]
fn a_key_in_the_clear_goes_nowhere() {
    let mut flight = on_pad();
    let setup = MavMessage::SETUP_SIGNING(m::SETUP_SIGNING_DATA {
        secret_key: [0xA5; 32],
        ..m::SETUP_SIGNING_DATA::DEFAULT
    });
    flight.received.clear();
    let now = flight.now();
    flight.stub.forward(now, OPERATOR, &setup);
    flight.send(&setup);
    flight.collect();
    assert!(!flight.received.contains(&setup));
    assert!(!flight.ground.iter().any(|(_, message)| *message == setup));
}

#[test]
fn sys_status_says_whether_it_could_be_armed() {
    const AHRS: u32 = 0x0020_0000;
    const PREARM: u32 = 0x1000_0000;
    let health = |flight: &mut Loop| {
        flight.received.clear();
        flight.run(1.1);
        let status = flight.received.iter().find_map(|message| match message {
            MavMessage::SYS_STATUS(data) => Some(data.onboard_control_sensors_health.bits()),
            _ => None,
        });
        status.expect("one a second")
    };
    let mut flight = on_pad();
    // Vision is there, so the place is known; Hold wants a global one.
    assert_eq!(health(&mut flight) & (AHRS | PREARM), AHRS);
    flight.set_mode(6.0, 0.0);
    flight.wish = Some(Wish::stay(flight.place()));
    assert_eq!(health(&mut flight) & (AHRS | PREARM), AHRS | PREARM);
}
