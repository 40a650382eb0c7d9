//! What the autopilot measures.

use super::*;

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
    // Measured 60 ms before the place, while it turns to the left by 2 rad/s.
    let attitude = wire::ATTITUDE_QUATERNION_DATA {
        time_boot_ms: u32::try_from(boot_at(at_ms(1_040)).nanos() / 1_000_000).unwrap(),
        q1: half,
        q4: half,
        yawspeed: -2.0,
        ..Default::default()
    };
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
    let rotation = pose.hall_from_body_rot.expect("the attitude is 60 ms old");
    let turned_rad = 0.06 * 2.0;
    assert!((rotation.yaw_rad() + std::f64::consts::FRAC_PI_2 - turned_rad).abs() < 1e-6);
    // Of an attitude that is long past nothing is said.
    let place = wire::LOCAL_POSITION_NED_DATA {
        time_boot_ms: u32::try_from(boot_at(at_ms(1_300)).nanos() / 1_000_000).unwrap(),
        ..Default::default()
    };
    scene.hears(AUTOPILOT, MavMessage::LOCAL_POSITION_NED(place), 1_302);
    let told = scene.told();
    let [Event::AutopilotPose(pose)] = told.as_slice() else { panic!("{told:?}") };
    assert_eq!(pose.hall_from_body_rot, None);
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
    // Its stamps mean nothing now.
    assert_eq!(scene.told(), [Event::AutopilotRebooted(at_ms(1_102))]);
    assert_eq!(scene.session.stats().autopilot_reboots, 1);
    let requests_before = scene.session.stats().stream_requests;
    scene.sync(1_200, shift_ns);
    assert_eq!(scene.session.stats().stream_requests, requests_before + 6);
    let mut sample = highres_imu(at_ms(2_200));
    sample.time_usec -= 30_000_000;
    scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(sample), 2_202);
    let told = scene.told();
    let [Event::Imu(sample)] = told.as_slice() else { panic!("{told:?}") };
    assert!(sample.at.nanos_since(at_ms(2_200)).abs() < 2_000);
}

#[test]
fn a_clock_that_jumps_ahead_puts_no_sample_into_the_future() {
    let mut scene = Scene::synced();
    let jumped = |ms: i64| {
        let mut sample = highres_imu(at_ms(ms));
        sample.time_usec += 300_000;
        MavMessage::HIGHRES_IMU(sample)
    };
    // Its clock is 0.3 s further than a moment ago: the stamps lie after the arrival.
    for ms in [1_010, 1_020, 1_030] {
        scene.hears(AUTOPILOT, jumped(ms), ms + 2);
    }
    assert!(scene.told().is_empty());
    assert_eq!(scene.session.stats().refused_values, 3);
    // Five answers that disagree, then five that agree, and the new offset is known.
    scene.sync(1_100, -300_000_000);
    assert_eq!(scene.session.stats().timesync_resets, 1);
    scene.hears(AUTOPILOT, jumped(2_100), 2_102);
    let told = scene.told();
    let [Event::Imu(sample)] = told.as_slice() else { panic!("{told:?}") };
    assert!(sample.at.nanos_since(at_ms(2_100)).abs() < 2_000, "{:?}", sample.at);
}

#[test]
fn a_reboot_behind_a_silent_link_is_found_by_the_answers() {
    let mut scene = Scene::synced();
    // It has been up for longer than the last time when it is heard again, so its clock has not
    // fallen: only the answers tell, 8 s apart from what they were.
    let requests_before = scene.session.stats().stream_requests;
    let shift_ns = 8_000_000_000;
    scene.hears(AUTOPILOT, heartbeat(0x1d, 0x0304_0000), 59_990);
    scene.out.clear();
    scene.sync(60_000, shift_ns);
    let stats = scene.session.stats();
    assert_eq!((stats.autopilot_reboots, stats.timesync_resets), (0, 1));
    assert!(stats.stream_requests > requests_before, "its streams are asked for again");
    scene.sync(61_000, shift_ns);
    let mut sample = highres_imu(at_ms(62_000));
    sample.time_usec -= 8_000_000;
    scene.hears(AUTOPILOT, MavMessage::HIGHRES_IMU(sample), 62_003);
    let told = scene.told();
    let [Event::Imu(sample)] = told.as_slice() else { panic!("{told:?}") };
    assert!(sample.at.nanos_since(at_ms(62_000)).abs() < 2_000, "{:?}", sample.at);
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
