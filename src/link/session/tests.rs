//! The session with a scripted other side.

use super::*;
use crate::geometry::{Direction, Point};
use crate::link::Address;
use crate::messages::{
    CommandOutcome, FlightMode, OperatorAnswer, OperatorCommand, OperatorRequest, OperatorVerb,
    Setpoint, VehicleCommand, VolumeEstimate,
};
use crate::mission::Phase;
use crate::pilot::{Action, VolumeReport};
use crate::time::Boot;
use mavlink::dialects::ardupilotmega as wire;
use mavlink::dialects::ardupilotmega::{MavCmd, MavResult};

/// Offset of the scripted autopilot's clock.
const BOOT_AT_NS: i64 = 30_000_000_000;
const AUTOPILOT: (u32, u8) = (7, 1);
const PEOPLE: (u32, u8) = (255, 190);

fn at_ms(ms: i64) -> Stamp<Mono> {
    Stamp::from_nanos(60_000_000_000 + ms * 1_000_000)
}

fn boot_at(at: Stamp<Mono>) -> Stamp<Boot> {
    Stamp::from_nanos(at.nanos() - BOOT_AT_NS)
}

struct Scene {
    session: Session,
    out: SessionOutput,
}

impl Scene {
    fn new() -> Self {
        let address: Address = "udpin:127.0.0.1:0".parse().unwrap();
        Self { session: Session::new(Settings::new(address)), out: SessionOutput::default() }
    }

    /// A session that has heard its autopilot at 0 ms and has made its first requests.
    fn heard() -> Self {
        let mut scene = Self::new();
        scene.hears(AUTOPILOT, heartbeat(0x1d, 0x0304_0000), 0);
        scene.tick(0);
        scene.out.clear();
        scene
    }

    /// As [`Self::heard`], with the clocks compared ten times; now is 1000 ms.
    fn synced() -> Self {
        let mut scene = Self::heard();
        scene.sync(100, 0);
        scene.out.clear();
        scene
    }

    /// Ten exchanges of TIMESYNC from `from_ms` on, with an autopilot that booted `shift_ns` later.
    fn sync(&mut self, from_ms: i64, shift_ns: i64) {
        for step in 0..10 {
            let now_ms = from_ms + step * 100;
            self.tick(now_ms);
            let asked = self.sent().into_iter().find_map(|message| match message {
                MavMessage::TIMESYNC(data) if data.tc1 == 0 => Some(data),
                _ => None,
            });
            let ts1 = asked.expect("a request every 100 ms").ts1;
            assert_eq!(ts1, at_ms(now_ms).nanos());
            let tc1 = boot_at(at_ms(now_ms)).nanos() - shift_ns + 200_000;
            let answer = TIMESYNC_DATA { tc1, ts1, ..Default::default() };
            let arrived = Stamp::from_nanos(ts1 + 400_000);
            self.hears_at(AUTOPILOT, &MavMessage::TIMESYNC(answer), arrived);
            self.out.clear();
        }
    }

    #[expect(clippy::needless_pass_by_value, reason = "messages are built in the call")]
    fn hears(&mut self, from: (u32, u8), message: MavMessage, ms: i64) {
        self.hears_at(from, &message, at_ms(ms));
    }

    fn hears_at(&mut self, from: (u32, u8), message: &MavMessage, arrived: Stamp<Mono>) {
        let header = MavHeader { system_id: from.0, component_id: from.1, sequence: 0 };
        self.session.on_message(&header, message, arrived, &mut self.out);
    }

    fn tick(&mut self, ms: i64) {
        self.session.on_time(at_ms(ms), &mut self.out);
    }

    fn acts(&mut self, action: &Action, ms: i64) {
        self.session.on_action(action, at_ms(ms), &mut self.out);
    }

    fn sent(&mut self) -> Vec<MavMessage> {
        std::mem::take(&mut self.out.messages)
    }

    fn told(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.out.events)
    }

    /// Outcomes among the events so far.
    fn outcomes(&mut self) -> Vec<(VehicleCommand, bool)> {
        let outcome = |event| match event {
            Event::CommandAnswered(CommandOutcome { command, is_accepted, .. }) => {
                Some((command, is_accepted))
            }
            _ => None,
        };
        self.told().into_iter().filter_map(outcome).collect()
    }
}

fn heartbeat(base_mode: u8, custom_mode: u32) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode,
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
        base_mode: MavModeFlag::from_bits_retain(base_mode),
        system_status: MavState::MAV_STATE_STANDBY,
        mavlink_version: 3,
    })
}

fn highres_imu(at: Stamp<Mono>) -> wire::HIGHRES_IMU_DATA {
    wire::HIGHRES_IMU_DATA {
        time_usec: u64::try_from(boot_at(at).nanos() / 1_000).unwrap(),
        xacc: 0.5,
        yacc: -0.25,
        zacc: -9.75,
        xgyro: 0.125,
        ygyro: 0.25,
        zgyro: -0.5,
        ..Default::default()
    }
}

fn ack(command: MavCmd, result: MavResult) -> MavMessage {
    MavMessage::COMMAND_ACK(wire::COMMAND_ACK_DATA {
        command,
        result,
        target_system: 7,
        target_component: OWN_COMPONENT,
        ..Default::default()
    })
}

fn user_command(target: (u8, u8), command: MavCmd) -> MavMessage {
    MavMessage::COMMAND_LONG(wire::COMMAND_LONG_DATA {
        command,
        target_system: target.0,
        target_component: target.1,
        ..Default::default()
    })
}

#[test]
fn takes_its_place_beside_the_first_autopilot() {
    let mut scene = Scene::new();
    scene.tick(-1_000);
    assert!(scene.sent().is_empty(), "silent before the autopilot is heard");
    scene.hears(AUTOPILOT, heartbeat(0x9d, 0x0304_0000), 0);
    let told = scene.told();
    let [Event::Vehicle(state)] = told.as_slice() else { panic!("{told:?}") };
    assert!(state.is_armed && state.mode == FlightMode::Hold && !state.in_failsafe);
    let header = scene.session.header();
    assert_eq!((header.system_id, header.component_id), (7, 191));
    scene.tick(0);
    let sent = scene.sent();
    let heartbeat = sent.iter().find_map(|message| match message {
        MavMessage::HEARTBEAT(data) => Some(data),
        _ => None,
    });
    let heartbeat = heartbeat.expect("a heartbeat");
    assert_eq!(heartbeat.mavtype, MavType::MAV_TYPE_ONBOARD_CONTROLLER);
    assert_eq!(heartbeat.autopilot, MavAutopilot::MAV_AUTOPILOT_INVALID);
    assert!(heartbeat.base_mode.is_empty(), "never claims to be armed");
}

#[test]
fn heartbeats_and_clock_requests_keep_their_rates_at_60_hz_ticks() {
    let mut scene = Scene::heard();
    let mut counts = (0, 0);
    for tick in 1..=600_i64 {
        scene.hears(AUTOPILOT, heartbeat(0x1d, 0), tick * 1000 / 60);
        scene.tick(tick * 1000 / 60);
        for message in scene.sent() {
            match message {
                MavMessage::HEARTBEAT(_) => counts.0 += 1,
                MavMessage::TIMESYNC(_) => counts.1 += 1,
                _ => {}
            }
        }
    }
    assert_eq!(counts, (10, 100), "in 10 s");
}

#[test]
fn a_second_autopilot_is_refused_and_counted() {
    let mut scene = Scene::heard();
    scene.hears((8, 1), heartbeat(0x91, 0x0006_0000), 10);
    assert!(scene.told().is_empty());
    assert_eq!(scene.session.autopilot_system(), Some(7));
    assert_eq!(scene.session.stats().refused_autopilots, 1);
    // A ground station and a camera are no autopilots.
    let mut ground = heartbeat(0, 0);
    if let MavMessage::HEARTBEAT(data) = &mut ground {
        data.autopilot = MavAutopilot::MAV_AUTOPILOT_INVALID;
    }
    scene.hears(PEOPLE, ground, 20);
    assert_eq!(scene.session.stats().refused_autopilots, 1);
    assert_eq!(scene.session.stats().foreign_messages, 1);
}

#[test]
fn answers_clock_requests_with_the_arrival() {
    let mut scene = Scene::heard();
    let request = TIMESYNC_DATA { tc1: 0, ts1: 123_456, ..Default::default() };
    scene.hears(AUTOPILOT, MavMessage::TIMESYNC(request), 50);
    let sent = scene.sent();
    let [MavMessage::TIMESYNC(answer)] = sent.as_slice() else { panic!("{sent:?}") };
    assert_eq!((answer.tc1, answer.ts1), (at_ms(50).nanos(), 123_456));
}

#[test]
fn inertial_samples_come_in_body_axes_on_the_own_clock() {
    let mut scene = Scene::synced();
    let measured = at_ms(1_100);
    let data = highres_imu(measured);
    scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(data.clone()), 1_103);
    let told = scene.told();
    let [Event::Imu(sample)] = told.as_slice() else { panic!("{told:?}") };
    // FRD (0.5, −0.25, −9.75) is FLU (0.5, 0.25, 9.75).
    assert_eq!(sample.accel_mps2.as_slice(), [0.5, 0.25, 9.75]);
    assert_eq!(sample.gyro_radps.as_slice(), [0.125, -0.25, 0.5]);
    assert!(sample.at.nanos_since(measured).abs() < 2_000, "{:?}", sample.at);
    // The same sample again is stale.
    scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(data), 1_104);
    assert!(scene.told().is_empty());
    assert_eq!(scene.session.stats().stale_samples, 1);
}

#[test]
fn no_inertial_sample_before_the_clocks_are_compared() {
    let mut scene = Scene::heard();
    scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(highres_imu(at_ms(10))), 12);
    assert!(scene.told().is_empty() && !scene.session.is_clock_known());
    assert_eq!(scene.session.stats().unsynced_samples, 1);
}

#[test]
fn no_broken_number_passes() {
    let mut scene = Scene::synced();
    for broken in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e9] {
        let mut data = highres_imu(at_ms(1_100));
        data.zgyro = broken;
        scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(data), 1_103);
        let mut data = highres_imu(at_ms(1_100));
        data.yacc = broken;
        scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(data), 1_103);
        let time_boot_ms = u32::try_from(boot_at(at_ms(1_100)).nanos() / 1_000_000).unwrap();
        let place =
            wire::LOCAL_POSITION_NED_DATA { time_boot_ms, vx: broken, ..Default::default() };
        scene.hears(AUTOPILOT, MavMessage::LOCAL_POSITION_NED(place), 1_103);
        let attitude = wire::ATTITUDE_QUATERNION_DATA { q1: broken, ..Default::default() };
        scene.hears(AUTOPILOT, MavMessage::ATTITUDE_QUATERNION(attitude), 1_103);
    }
    let mut from_the_future = highres_imu(at_ms(1_100));
    from_the_future.time_usec = u64::MAX;
    scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(from_the_future.clone()), 1_103);
    from_the_future.time_usec = highres_imu(at_ms(9_000)).time_usec;
    scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(from_the_future), 1_103);
    assert!(scene.told().is_empty());
    assert_eq!(scene.session.stats().refused_values, 4 * 4 + 2);
}

#[test]
fn positions_come_in_hall_axes_with_the_attitude() {
    let mut scene = Scene::synced();
    // 90° to the right in NED: the body looks along −y of the hall.
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let attitude = wire::ATTITUDE_QUATERNION_DATA { q1: half, q4: half, ..Default::default() };
    scene.hears(AUTOPILOT, MavMessage::ATTITUDE_QUATERNION(attitude), 1_090);
    let place = wire::LOCAL_POSITION_NED_DATA {
        time_boot_ms: u32::try_from(boot_at(at_ms(1_100)).nanos() / 1_000_000).unwrap(),
        x: 1.5,
        y: -2.0,
        z: -3.25,
        vx: 0.5,
        vy: 0.25,
        vz: 1.0,
    };
    scene.hears(AUTOPILOT, MavMessage::LOCAL_POSITION_NED(place), 1_102);
    let told = scene.told();
    let [Event::AutopilotPose(pose)] = told.as_slice() else { panic!("{told:?}") };
    assert_eq!(pose.position, Point::new(1.5, 2.0, 3.25));
    assert_eq!(pose.velocity_mps, Direction::new(0.5, -0.25, -1.0));
    assert!(pose.at.nanos_since(at_ms(1_100)).abs() < 2_000);
    let rotation = pose.hall_from_body_rot.expect("the attitude is 10 ms old");
    assert!((rotation.yaw_rad() + std::f64::consts::FRAC_PI_2).abs() < 1e-6);
}

#[test]
fn a_reboot_of_the_autopilot_starts_clock_and_streams_anew() {
    let mut scene = Scene::synced();
    scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(highres_imu(at_ms(1_000))), 1_002);
    assert_eq!(scene.told().len(), 1);
    // Its clock begins again at 1 s: it booted 30 s later than before.
    let shift_ns = 30_000_000_000;
    let mut sample = highres_imu(at_ms(1_100));
    sample.time_usec -= 30_000_000;
    scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(sample), 1_102);
    assert!(scene.told().is_empty(), "its stamps mean nothing now");
    assert_eq!(scene.session.stats().autopilot_reboots, 1);
    let requests_before = scene.session.stats().stream_requests;
    scene.sync(1_200, shift_ns);
    assert_eq!(scene.session.stats().stream_requests, requests_before + 5);
    let mut sample = highres_imu(at_ms(2_200));
    sample.time_usec -= 30_000_000;
    scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(sample), 2_202);
    let told = scene.told();
    let [Event::Imu(sample)] = told.as_slice() else { panic!("{told:?}") };
    assert!(sample.at.nanos_since(at_ms(2_200)).abs() < 2_000);
}

#[test]
fn streams_that_stay_away_are_asked_for_again() {
    let mut scene = Scene::new();
    scene.hears(AUTOPILOT, heartbeat(0x1d, 0), 0);
    scene.tick(0);
    let asked = |scene: &mut Scene| -> Vec<(i64, i64)> {
        let interval = |message| match message {
            MavMessage::COMMAND_LONG(data)
                if data.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL =>
            {
                assert_eq!((data.target_system, data.target_component), (7, 1));
                #[expect(clippy::cast_possible_truncation, reason = "small whole numbers")]
                Some((data.param1 as i64, data.param2 as i64))
            }
            _ => None,
        };
        scene.sent().into_iter().filter_map(interval).collect()
    };
    // HIGHRES_IMU at 200 Hz, LOCAL_POSITION_NED and ATTITUDE_QUATERNION at 10 Hz,
    // EXTENDED_SYS_STATE at 5 Hz, BATTERY_STATUS at 1 Hz.
    let all = [(105, 5_000), (32, 100_000), (31, 100_000), (245, 200_000), (147, 1_000_000)];
    assert_eq!(asked(&mut scene), all);
    // Inertial samples flow at 160 Hz, the rest does not.
    for step in 1..=320_i64 {
        let ms = step * 2_000 / 320;
        scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(highres_imu(at_ms(ms))), ms);
    }
    scene.hears(AUTOPILOT, heartbeat(0x1d, 0), 1_900);
    scene.tick(2_000);
    assert_eq!(asked(&mut scene), all[1..]);
}

#[test]
fn silence_of_three_seconds_is_told_once_and_heals() {
    let mut scene = Scene::heard();
    scene.tick(3_000);
    assert!(scene.told().is_empty());
    scene.tick(3_001);
    assert_eq!(scene.told(), [Event::AutopilotLost(at_ms(3_001))]);
    scene.tick(4_000);
    assert!(scene.told().is_empty());
    scene.hears(AUTOPILOT, heartbeat(0x1d, 0), 5_000);
    assert_eq!(scene.told().len(), 1);
    scene.sent();
    scene.tick(5_010);
    assert!(scene.sent().iter().any(|m| matches!(m, MavMessage::COMMAND_LONG(_))), "streams");
}

#[test]
fn of_two_acks_for_a_mode_the_second_counts() {
    let set_mode = MavCmd::MAV_CMD_DO_SET_MODE;
    let accepted = MavResult::MAV_RESULT_ACCEPTED;
    let enter = VehicleCommand::EnterCompanionMode;
    // Refused in the air: 0, then 1.
    let mut scene = Scene::heard();
    scene.acts(&Action::Command(enter), 100);
    let sent = scene.sent();
    let [MavMessage::COMMAND_LONG(command)] = sent.as_slice() else { panic!("{sent:?}") };
    assert_eq!((command.param1, command.param2, command.param3), (1.0, 6.0, 0.0));
    scene.hears(AUTOPILOT, ack(set_mode, accepted), 110);
    assert_eq!(scene.outcomes(), []);
    scene.hears(AUTOPILOT, ack(set_mode, MavResult::MAV_RESULT_TEMPORARILY_REJECTED), 120);
    assert_eq!(scene.outcomes(), [(enter, false)]);
    // Accepted twice.
    scene.acts(&Action::Command(enter), 200);
    scene.hears(AUTOPILOT, ack(set_mode, accepted), 210);
    scene.hears(AUTOPILOT, ack(set_mode, accepted), 220);
    assert_eq!(scene.outcomes(), [(enter, true)]);
    // Accepted once only: good after a while.
    scene.acts(&Action::Command(enter), 300);
    scene.hears(AUTOPILOT, ack(set_mode, accepted), 310);
    scene.tick(600);
    assert_eq!(scene.outcomes(), []);
    scene.tick(620);
    assert_eq!(scene.outcomes(), [(enter, true)]);
    // Arming is acknowledged once.
    scene.acts(&Action::Command(VehicleCommand::Arm), 700);
    scene.hears(AUTOPILOT, ack(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, accepted), 710);
    assert_eq!(scene.outcomes(), [(VehicleCommand::Arm, true)]);
}

#[test]
fn unanswered_commands_are_repeated_with_confirmation_and_given_up() {
    let mut scene = Scene::heard();
    scene.acts(&Action::Command(VehicleCommand::Arm), 0);
    let mut confirmations = Vec::new();
    for step in 0..=30 {
        scene.hears(AUTOPILOT, heartbeat(0x1d, 0), step * 100);
        scene.tick(step * 100);
        for message in scene.sent() {
            match message {
                MavMessage::COMMAND_LONG(data)
                    if data.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM =>
                {
                    confirmations.push(data.confirmation);
                }
                _ => {}
            }
        }
    }
    assert_eq!(confirmations, [0, 1, 2, 3, 4]);
    assert_eq!(scene.outcomes(), [(VehicleCommand::Arm, false)]);
    assert_eq!(scene.session.stats().commands_unanswered, 1);
    // A late answer finds nobody.
    let late = ack(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavResult::MAV_RESULT_ACCEPTED);
    scene.hears(AUTOPILOT, late, 3_200);
    assert_eq!(scene.outcomes(), []);
}

#[test]
fn a_newer_mode_replaces_an_older_one_under_way() {
    let mut scene = Scene::heard();
    scene.acts(&Action::Command(VehicleCommand::EnterCompanionMode), 0);
    scene.acts(&Action::Command(VehicleCommand::EnterLand), 50);
    assert_eq!(scene.outcomes(), [(VehicleCommand::EnterCompanionMode, false)]);
    let last = scene.sent().pop();
    let Some(MavMessage::COMMAND_LONG(data)) = last else { panic!("{last:?}") };
    assert_eq!((data.param2, data.param3), (4.0, 6.0));
}

#[test]
fn answers_meant_for_others_do_not_count() {
    let mut scene = Scene::heard();
    scene.acts(&Action::Command(VehicleCommand::Arm), 0);
    let mut foreign = ack(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavResult::MAV_RESULT_ACCEPTED);
    if let MavMessage::COMMAND_ACK(data) = &mut foreign {
        data.target_system = 255;
        data.target_component = 190;
    }
    scene.hears(AUTOPILOT, foreign, 10);
    let spoofed = ack(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavResult::MAV_RESULT_ACCEPTED);
    scene.hears((9, 1), spoofed, 20);
    assert_eq!(scene.outcomes(), []);
}

#[test]
fn people_are_heard_and_answered() {
    let mut scene = Scene::heard();
    for (command, verb) in [
        (MavCmd::MAV_CMD_USER_1, OperatorVerb::Start),
        (MavCmd::MAV_CMD_USER_2, OperatorVerb::Hold),
        (MavCmd::MAV_CMD_USER_3, OperatorVerb::Resume),
        (MavCmd::MAV_CMD_USER_4, OperatorVerb::Return),
        (MavCmd::MAV_CMD_USER_5, OperatorVerb::Land),
    ] {
        scene.hears(PEOPLE, user_command((7, OWN_COMPONENT), command), 10);
        let from = OperatorRequest { system: 255, component: 190 };
        let told = Event::Operator(OperatorCommand { at: at_ms(10), verb, from });
        assert_eq!(scene.told(), [told]);
        assert!(scene.sent().is_empty(), "the brain answers");
        let answer = OperatorAnswer { verb, to: from, is_accepted: verb == OperatorVerb::Hold };
        scene.acts(&Action::Answer(answer), 20);
        let sent = scene.sent();
        let [MavMessage::COMMAND_ACK(data)] = sent.as_slice() else { panic!("{sent:?}") };
        assert_eq!(data.command, command);
        assert_eq!((data.target_system, data.target_component), (255, 190));
        assert_eq!(data.result == MavResult::MAV_RESULT_ACCEPTED, answer.is_accepted);
    }
}

#[test]
fn commands_to_others_are_ignored_and_unknown_ones_unsupported() {
    let mut scene = Scene::heard();
    for target in [(7, 1), (7, 192), (7, 0), (0, 0), (8, OWN_COMPONENT)] {
        scene.hears(PEOPLE, user_command(target, MavCmd::MAV_CMD_USER_1), 10);
    }
    assert!(scene.told().is_empty() && scene.sent().is_empty());
    assert_eq!(scene.session.stats().foreign_messages, 5);
    let arm = user_command((7, OWN_COMPONENT), MavCmd::MAV_CMD_COMPONENT_ARM_DISARM);
    scene.hears(PEOPLE, arm, 20);
    assert!(scene.told().is_empty());
    let sent = scene.sent();
    let [MavMessage::COMMAND_ACK(data)] = sent.as_slice() else { panic!("{sent:?}") };
    assert_eq!(data.result, MavResult::MAV_RESULT_UNSUPPORTED);
}

#[test]
fn the_landed_state_is_told_at_each_change() {
    let mut scene = Scene::heard();
    let state = |landed_state| {
        MavMessage::EXTENDED_SYS_STATE(wire::EXTENDED_SYS_STATE_DATA {
            landed_state,
            ..Default::default()
        })
    };
    scene.hears(AUTOPILOT, state(wire::MavLandedState::MAV_LANDED_STATE_ON_GROUND), 10);
    scene.hears(AUTOPILOT, state(wire::MavLandedState::MAV_LANDED_STATE_ON_GROUND), 20);
    scene.hears(AUTOPILOT, state(wire::MavLandedState::MAV_LANDED_STATE_IN_AIR), 30);
    scene.hears(AUTOPILOT, heartbeat(0x91, 0x0006_0000), 40);
    let landed = scene.told().into_iter().map(|event| match event {
        Event::Vehicle(state) => (state.at, state.landed),
        other => panic!("{other:?}"),
    });
    let expected = [
        (at_ms(10), crate::messages::LandedState::OnGround),
        (at_ms(30), crate::messages::LandedState::InAir),
        (at_ms(40), crate::messages::LandedState::InAir),
    ];
    assert!(landed.eq(expected));
}

#[test]
fn the_battery_says_what_it_knows_and_nothing_else() {
    let mut scene = Scene::heard();
    let mut voltages = [u16::MAX; 10];
    voltages[..4].copy_from_slice(&[4_100, 4_110, 4_090, 4_100]);
    let data = wire::BATTERY_STATUS_DATA {
        voltages,
        current_battery: 1_250,
        battery_remaining: 73,
        ..Default::default()
    };
    scene.hears(AUTOPILOT, MavMessage::BATTERY_STATUS(data.clone()), 10);
    let told = scene.told();
    let [Event::Battery(sample)] = told.as_slice() else { panic!("{told:?}") };
    assert!((sample.voltage_v - 16.4).abs() < 1e-9);
    assert!((sample.current_a - 12.5).abs() < 1e-9);
    assert!((sample.remaining_ratio - 0.73).abs() < 1e-9);
    for battery_remaining in [-1, 101] {
        let broken = wire::BATTERY_STATUS_DATA { battery_remaining, ..data.clone() };
        scene.hears(AUTOPILOT, MavMessage::BATTERY_STATUS(broken), 20);
    }
    assert!(scene.told().is_empty());
    assert_eq!(scene.session.stats().refused_values, 2);
}

#[test]
fn no_broken_number_leaves() {
    let mut scene = Scene::heard();
    let good = Setpoint {
        at: at_ms(0),
        position: Point::new(1.0, 2.0, 3.0),
        velocity_mps: Direction::zero(),
        accel_mps2: Direction::zero(),
        yaw_rad: 0.0,
        yaw_rate_radps: 0.0,
    };
    for broken in [f64::NAN, f64::INFINITY, 1e300] {
        let far = Setpoint { position: Point::new(1.0, broken, 3.0), ..good };
        scene.acts(&Action::Steer(far), 10);
        scene.acts(&Action::Steer(Setpoint { yaw_rad: broken * 1e10, ..good }), 10);
    }
    let sent = scene.sent();
    let yaws = sent.iter().filter_map(|message| match message {
        MavMessage::SET_POSITION_TARGET_LOCAL_NED(data) => Some(data.yaw),
        _ => None,
    });
    // 1e310 is infinite already, so only finite yaws can have left.
    assert!(yaws.into_iter().all(f32::is_finite));
    assert_eq!(scene.session.stats().outbound_refused, 6);
    scene.acts(&Action::Steer(good), 20);
    assert_eq!(scene.sent().len(), 1);
}

fn volume_report(is_final: bool) -> VolumeReport {
    let estimate =
        VolumeEstimate { at: at_ms(0), volume_m3: 412.6, sigma_m3: 2.55, coverage_ratio: 0.731 };
    VolumeReport {
        estimate,
        hits: crate::messages::HitCounts::default(),
        phase: Phase::Survey,
        steps_done: 3,
        battery_ratio: None,
        position_sigma_m: Some(0.04),
        is_final,
    }
}

#[test]
fn the_volume_is_told_in_numbers_and_words() {
    let mut scene = Scene::heard();
    let mut values = Vec::new();
    let mut lines = Vec::new();
    for step in 0..=40 {
        scene.acts(&Action::ReportVolume(volume_report(step == 40)), step * 500);
        for message in scene.sent() {
            match message {
                MavMessage::NAMED_VALUE_FLOAT(data) => {
                    values.push((data.name.to_str().unwrap().to_owned(), data.value));
                }
                MavMessage::STATUSTEXT(data) => {
                    lines.push((step * 500, data.text.to_str().unwrap().to_owned()));
                }
                other => panic!("{other:?}"),
            }
        }
    }
    // 0 to 20 s at 1 Hz: 21 times four numbers.
    assert_eq!(values.len(), 21 * 4);
    let expected =
        [("VOLUME", 412.6), ("VOL_U", 5.1), ("COVERAGE", 0.731), ("POS_SIGMA", 0.04_f32)];
    for ((name, value), (expected_name, expected_value)) in values.iter().zip(expected) {
        assert_eq!(name, expected_name);
        assert!((value - expected_value).abs() < 1e-4, "{name} {value}");
    }
    let line = "volume 412.6 +- 5.1 m3, coverage 73 %".to_owned();
    let last = format!("final {line}");
    assert_eq!(lines, [(0, line.clone()), (15_000, line), (20_000, last)]);
}

#[test]
fn nothing_is_said_before_an_autopilot_is_there() {
    let mut scene = Scene::new();
    scene.acts(&Action::ReportVolume(volume_report(true)), 0);
    scene.acts(&Action::Command(VehicleCommand::Arm), 0);
    assert!(scene.sent().is_empty());
    assert_eq!(scene.outcomes(), [(VehicleCommand::Arm, false)]);
}
