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

/// What is told of rivals after the frames of `sequences`, 5 ms apart, and a heartbeat.
fn is_contested_after(sequences: impl Iterator<Item = u8>) -> bool {
    let mut scene = Scene::heard();
    let imu = |at| MavMessage::HIGHRES_IMU(highres_imu(at));
    let mut ms = 0;
    for sequence in sequences {
        ms += 5;
        let header = MavHeader { system_id: 7, component_id: 1, sequence };
        scene.session.on_message(&header, &imu(at_ms(ms)), at_ms(ms), &mut scene.out);
    }
    scene.hears(AUTOPILOT, heartbeat(0x1d, 0), ms + 1);
    let told = scene.told();
    let state = told.iter().rev().find_map(|event| match event {
        Event::Vehicle(state) => Some(state.is_contested),
        _ => None,
    });
    state.expect("a heartbeat is told")
}

#[test]
fn two_autopilots_with_one_number_are_noticed_by_their_numbering() {
    let plain = |n: u32| u8::try_from(n % 256).unwrap();
    assert!(!is_contested_after((0..400).map(plain)));
    // Overtaking, losses and a restart are no second one.
    assert!(!is_contested_after((0..400).map(|n| plain(if n % 4 == 3 { n - 3 } else { n }))));
    assert!(!is_contested_after((0..400).map(|n| plain(7 * n))));
    assert!(!is_contested_after((0..400).map(|n| plain(if n < 200 { 100 + n } else { n - 200 }))));
    // Another one, whose numbering stands elsewhere.
    for apart in [40, 128, 200] {
        let two = (0..200).flat_map(|n| [plain(n), plain(n + apart)]);
        assert!(is_contested_after(two), "{apart} apart");
    }
}

#[test]
fn only_copters_are_spoken_to() {
    for mavtype in [MavType::MAV_TYPE_FIXED_WING, MavType::MAV_TYPE_GROUND_ROVER] {
        let mut scene = Scene::new();
        let mut other = heartbeat(0x1d, 0x0304_0000);
        if let MavMessage::HEARTBEAT(data) = &mut other {
            data.mavtype = mavtype;
        }
        scene.hears(AUTOPILOT, other, 0);
        assert_eq!(scene.session.autopilot_system(), None, "{mavtype:?}");
    }
}

#[test]
fn streams_that_stay_away_are_asked_for_again() {
    let mut scene = Scene::new();
    scene.hears(AUTOPILOT, heartbeat(0x1d, 0), 0);
    scene.tick(0);
    // HIGHRES_IMU at 200 Hz, LOCAL_POSITION_NED and ATTITUDE_QUATERNION at 10 Hz,
    // EXTENDED_SYS_STATE at 5 Hz, BATTERY_STATUS at 1 Hz, CURRENT_MODE at 50 Hz at most.
    let all = [
        (105, 5_000),
        (32, 100_000),
        (31, 100_000),
        (245, 200_000),
        (147, 1_000_000),
        (436, 20_000),
    ];
    assert_eq!(asked(&mut scene), all);
    // Inertial samples flow at 160 Hz, the rest does not.
    for step in 1..=320_i64 {
        let ms = step * 2_000 / 320;
        scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(highres_imu(at_ms(ms))), ms);
    }
    scene.hears(AUTOPILOT, heartbeat(0x1d, 0), 1_900);
    scene.tick(2_000);
    assert_eq!(asked(&mut scene), all[1..]);
    // The mode comes at changes and twice a second, however often it may come. Once in two seconds is
    // the default: it was not granted.
    for (news_ms, is_granted) in [(500, true), (2_000, false)] {
        scene = Scene::new();
        scene.hears(AUTOPILOT, heartbeat(0x1d, 0), 0);
        scene.tick(0);
        scene.sent();
        for ms in (news_ms..=2_000).step_by(news_ms) {
            scene.hears(AUTOPILOT, current_mode(0x0304_0000), i64::try_from(ms).unwrap());
        }
        scene.tick(2_000);
        assert_eq!(!asked(&mut scene).contains(&(436, 20_000)), is_granted, "{news_ms} ms");
    }
}

#[test]
fn ardupilots_heartbeats_are_counted_as_the_stream_that_they_are() {
    let mut scene = Scene::new();
    scene.hears(AUTOPILOT, ardupilot_heartbeat(4, MavState::MAV_STATE_STANDBY), 0);
    scene.tick(0);
    assert!(asked(&mut scene).contains(&(0, 33_333)));
    for step in 1..=60_i64 {
        let ms = step * 2_000 / 60;
        scene.hears(AUTOPILOT, ardupilot_heartbeat(4, MavState::MAV_STATE_STANDBY), ms);
    }
    scene.tick(2_000);
    assert!(!asked(&mut scene).iter().any(|(id, _)| *id == 0), "it flows");
    for step in 1..=2_i64 {
        let ms = 2_000 + step * 1_000;
        scene.hears(AUTOPILOT, ardupilot_heartbeat(4, MavState::MAV_STATE_STANDBY), ms);
    }
    scene.tick(4_000);
    assert!(asked(&mut scene).contains(&(0, 33_333)), "1 Hz is not what was asked for");
}

#[test]
fn on_a_line_of_its_own_px4_is_told_to_leave_out_what_nobody_reads() {
    let unasked: [(i64, i64); 3] = [(30, -1), (331, -1), (33, -1)];
    for (address, is_own_line) in [("serial:/dev/ttyAMA0:921600", true), ("tcpout:[::1]:1", false)]
    {
        let mut scene = Scene::at(address);
        scene.hears(AUTOPILOT, heartbeat(0x1d, 0), 0);
        scene.tick(0);
        let first = asked(&mut scene);
        assert!(unasked.iter().all(|off| first.contains(off) == is_own_line), "{first:?}");
        // ATTITUDE comes all the same: that command was lost.
        let attitude = wire::ATTITUDE_DATA::default();
        scene.hears(AUTOPILOT, MavMessage::ATTITUDE(attitude), 1_000);
        scene.tick(2_000);
        let again: Vec<_> = asked(&mut scene).into_iter().filter(|(_, us)| *us < 0).collect();
        assert_eq!(again, if is_own_line { vec![(30, -1)] } else { vec![] });
    }
}

/// The intervals that were asked for: id, µs.
fn asked(scene: &mut Scene) -> Vec<(i64, i64)> {
    let interval = |message| match message {
        MavMessage::COMMAND_LONG(data) if data.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
            assert_eq!((data.target_system, data.target_component), (7, 1));
            #[expect(clippy::cast_possible_truncation, reason = "small whole numbers")]
            Some((data.param1 as i64, data.param2 as i64))
        }
        _ => None,
    };
    scene.sent().into_iter().filter_map(interval).collect()
}

fn current_mode(custom_mode: u32) -> MavMessage {
    MavMessage::CURRENT_MODE(wire::CURRENT_MODE_DATA { custom_mode, ..Default::default() })
}

#[test]
fn the_mode_is_told_between_heartbeats_and_whichever_word_is_newest_counts() {
    let mut scene = Scene::heard();
    // What the modes become, and whether they are told when they change.
    let mut told = |message, ms| -> Vec<(FlightMode, bool, bool)> {
        scene.hears(AUTOPILOT, message, ms);
        let events = scene.told().into_iter().map(|event| match event {
            Event::Vehicle(state) => {
                assert_eq!(state.at, at_ms(ms));
                (state.mode, state.is_mode_prompt, state.is_armed)
            }
            other => panic!("{other:?}"),
        });
        events.collect()
    };
    use FlightMode::{Companion, Hold, Pilot};
    // One word alone may be the default's one in two seconds.
    assert_eq!(told(current_mode(0x0006_0000), 100), [(Companion, false, false)]);
    assert_eq!(told(heartbeat(0x9d, 0x0304_0000), 200), [(Hold, true, true)], "newer");
    // Arming stays the heartbeat's.
    assert_eq!(told(current_mode(0x0006_0000), 600), [(Companion, true, true)]);
    assert_eq!(told(current_mode(0x0006_0000), 1_100), [], "nothing new");
    assert_eq!(told(current_mode(0x0003_0000), 1_120), [(Pilot, true, true)]);
    assert_eq!(told(heartbeat(0xd1, 0x0003_0000), 1_200), [(Pilot, true, true)]);
    // It stays away: from the next heartbeat on it is told that the mode comes late.
    assert_eq!(told(heartbeat(0xd1, 0x0003_0000), 2_400), [(Pilot, false, true)]);
    // From somebody else it is no word at all.
    let mut scene = Scene::heard();
    scene.hears((8, 1), current_mode(0x0003_0000), 100);
    scene.hears((7, 191), current_mode(0x0003_0000), 100);
    assert!(scene.told().is_empty());
    // A silent autopilot is back with its heartbeat only; that the pilot has it is told at once.
    scene.tick(3_001);
    assert_eq!(scene.told(), [Event::AutopilotLost(at_ms(3_001))]);
    scene.hears(AUTOPILOT, current_mode(0x0006_0000), 3_100);
    assert!(scene.told().is_empty());
    scene.hears(AUTOPILOT, current_mode(0x0003_0000), 3_200);
    let told = scene.told();
    assert!(matches!(&told[..], [Event::Vehicle(v), Event::AutopilotLost(_)] if v.mode == Pilot));
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

fn ardupilot_heartbeat(mode: u32, state: MavState) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: mode,
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
        base_mode: MavModeFlag::from_bits_retain(0x59),
        system_status: state,
        mavlink_version: 3,
    })
}

#[test]
fn the_first_heartbeat_decides_the_family_and_another_one_is_a_rival() {
    let mut scene = Scene::new();
    scene.hears(AUTOPILOT, ardupilot_heartbeat(4, MavState::MAV_STATE_BOOT), 0);
    let told = scene.told();
    let [Event::Vehicle(state)] = told.as_slice() else { panic!("{told:?}") };
    assert_eq!((state.mode, state.takes_off), (FlightMode::Companion, TakeOff::ByCommand));
    assert!(!state.is_ready, "it still starts");
    // The same system id with another family's numbers is somebody else.
    scene.hears(AUTOPILOT, heartbeat(0x91, 0x0006_0000), 100);
    assert!(scene.told().is_empty());
    assert_eq!(scene.session.stats().refused_autopilots, 1);
    for (ms, is_contested) in [(1_000, true), (10_000, true), (10_200, false)] {
        scene.hears(AUTOPILOT, ardupilot_heartbeat(4, MavState::MAV_STATE_STANDBY), ms);
        let told = scene.told();
        let [Event::Vehicle(state)] = told.as_slice() else { panic!("{told:?}") };
        assert!(state.is_ready);
        assert_eq!(state.is_contested, is_contested, "{ms} ms");
    }
}

#[test]
fn a_plane_of_ardupilot_is_not_spoken_to() {
    let mut scene = Scene::new();
    let MavMessage::HEARTBEAT(mut plane) = ardupilot_heartbeat(4, MavState::MAV_STATE_STANDBY)
    else {
        panic!("a heartbeat")
    };
    plane.mavtype = MavType::MAV_TYPE_FIXED_WING;
    scene.hears(AUTOPILOT, MavMessage::HEARTBEAT(plane), 0);
    assert!(scene.told().is_empty());
    assert_eq!(scene.session.autopilot_system(), None);
}

/// Altitudes of the origins that were sent, mm.
#[expect(deprecated, reason = "both families listen to it")]
fn origins(scene: &mut Scene) -> Vec<i32> {
    let origin = |message| match message {
        MavMessage::SET_GPS_GLOBAL_ORIGIN(data) => Some(data.altitude),
        _ => None,
    };
    scene.sent().into_iter().filter_map(origin).collect()
}

#[test]
fn ardupilot_gets_an_origin_until_it_has_one() {
    let mut scene = Scene::new();
    scene.hears(AUTOPILOT, ardupilot_heartbeat(0, MavState::MAV_STATE_STANDBY), 0);
    scene.tick(0);
    assert!(origins(&mut scene).is_empty(), "it may have one: first it is asked");
    scene.tick(2_000);
    assert_eq!(origins(&mut scene), [0]);
    let origin = wire::GPS_GLOBAL_ORIGIN_DATA { altitude: 489_400, ..Default::default() };
    scene.hears(AUTOPILOT, MavMessage::GPS_GLOBAL_ORIGIN(origin), 2_100);
    assert!(origins(&mut scene).is_empty(), "its altitude does no harm there");
    for second in 3..30 {
        scene.hears(AUTOPILOT, ardupilot_heartbeat(0, MavState::MAV_STATE_STANDBY), second * 1_000);
        scene.tick(second * 1_000);
        assert!(origins(&mut scene).is_empty());
    }
}

#[test]
fn an_origin_of_px4_at_an_altitude_is_put_level_and_told() {
    let mut scene = Scene::heard();
    scene.sent();
    let origin = wire::GPS_GLOBAL_ORIGIN_DATA {
        latitude: 471_000_000,
        longitude: 81_000_000,
        altitude: 489_400,
        time_usec: 0,
    };
    scene.hears(AUTOPILOT, MavMessage::GPS_GLOBAL_ORIGIN(origin.clone()), 100);
    let is_told = scene.out.messages.iter().any(|m| matches!(m, MavMessage::STATUSTEXT(_)));
    assert!(is_told);
    assert_eq!(origins(&mut scene), [0]);
    let level = wire::GPS_GLOBAL_ORIGIN_DATA { altitude: 0, ..origin };
    scene.hears(AUTOPILOT, MavMessage::GPS_GLOBAL_ORIGIN(level), 200);
    assert!(origins(&mut scene).is_empty());
    assert_eq!(scene.session.stats().origins_levelled, 1);
}

#[test]
fn whole_numbers_take_over_where_ardupilot_has_no_finer_samples() {
    let mut scene = Scene::new();
    scene.hears(AUTOPILOT, ardupilot_heartbeat(0, MavState::MAV_STATE_STANDBY), 0);
    scene.sync(0, 0);
    scene.told();
    let raw = |ms| {
        MavMessage::RAW_IMU(wire::RAW_IMU_DATA {
            time_usec: u64::try_from(boot_at(at_ms(ms)).nanos() / 1_000).unwrap(),
            xacc: 100,
            yacc: 0,
            zacc: -1000,
            xgyro: 0,
            ygyro: 250,
            zgyro: 0,
            ..Default::default()
        })
    };
    scene.hears(AUTOPILOT, raw(1_000), 1_001);
    assert!(scene.told().is_empty(), "nobody asked for them yet");
    for ms in [2_000, 4_000] {
        scene.hears(AUTOPILOT, ardupilot_heartbeat(0, MavState::MAV_STATE_STANDBY), ms);
        scene.tick(ms);
    }
    scene.told();
    scene.hears(AUTOPILOT, raw(4_100), 4_101);
    let told = scene.told();
    let [Event::Imu(imu)] = told.as_slice() else { panic!("{told:?}") };
    // 0.1 g forward, 1 g up, 0.25 rad/s nose up: −0.25 about the axis to the left.
    let accel = Vector3::new(0.980_665, 0.0, 9.806_65);
    assert!((imu.accel_mps2 - accel).norm() < 1e-9, "{:?}", imu.accel_mps2);
    assert!((imu.gyro_radps - Vector3::new(0.0, -0.25, 0.0)).norm() < 1e-9);
}

#[test]
fn frames_that_the_numbering_skips_are_counted() {
    let mut scene = Scene::heard();
    let mut number = |sequence: u8| {
        let header = MavHeader { system_id: 7, component_id: 1, sequence };
        scene.session.on_message(&header, &heartbeat(0x1d, 0), at_ms(10), &mut scene.out);
        scene.session.stats().messages_missed
    };
    let before = number(250);
    assert_eq!(number(254) - before, 3);
    assert_eq!(number(1) - before, 5, "255 and 0 across the wrap");
    assert_eq!(number(0) - before, 5, "a late one is none that is missing");
}
