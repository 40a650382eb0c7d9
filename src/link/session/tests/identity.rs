//! Who is who, and what is asked of the autopilot unprompted.

use super::*;

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
    // HEARTBEAT at 30 Hz for the mode, EXTENDED_SYS_STATE at 5 Hz, BATTERY_STATUS at 1 Hz.
    let all =
        [(105, 5_000), (32, 100_000), (31, 100_000), (0, 33_333), (245, 200_000), (147, 1_000_000)];
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
