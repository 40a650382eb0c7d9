//! Whatever the bytes say, no number that is not one reaches the brain or the wire.

use crate::support::at_ms;
use mavlink::dialects::ardupilotmega::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavType, TIMESYNC_DATA,
};
use mavlink::{MavHeader, MavlinkVersion, Message as _};
use proptest::prelude::*;
use stockpilot::link::{Session, SessionOutput, Settings};
use stockpilot::messages::{AutopilotPose, BatterySample};
use stockpilot::pilot::Event;

const AUTOPILOT: MavHeader = MavHeader { system_id: 1, component_id: 1, sequence: 0 };
/// Every message that the session looks into.
const IDS: [u32; 12] = [0, 1, 2, 31, 32, 75, 76, 77, 105, 111, 147, 245];

/// A session that knows its autopilot and the autopilot's clock, which equals its own.
fn synced(out: &mut SessionOutput) -> Session {
    let mut session = Session::new(Settings::new("udpin:127.0.0.1:0".parse().unwrap()));
    let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
        base_mode: MavModeFlag::empty(),
        ..Default::default()
    });
    session.on_message(&AUTOPILOT, &heartbeat, at_ms(1_000), out);
    for step in 0..10 {
        let now = at_ms(1_000 + step * 100);
        session.on_time(now, out);
        let answer = TIMESYNC_DATA { tc1: now.nanos(), ts1: now.nanos(), ..Default::default() };
        session.on_message(&AUTOPILOT, &MavMessage::TIMESYNC(answer), now, out);
    }
    assert_eq!(session.stats().timesync_accepted, 10);
    out.clear();
    session
}

fn is_finite(event: &Event) -> bool {
    match event {
        Event::Imu(sample) => sample.is_finite(),
        Event::Battery(BatterySample { voltage_v, current_a, remaining_ratio, .. }) => {
            voltage_v.is_finite() && current_a.is_finite() && (0.0..=1.0).contains(remaining_ratio)
        }
        Event::AutopilotPose(AutopilotPose { position, velocity_mps, .. }) => {
            position.is_finite() && velocity_mps.is_finite()
        }
        _ => true,
    }
}

/// Payloads of random bytes, half of them with the exponents that make NaN and infinity.
fn payload() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![any::<u8>(), Just(0xff), Just(0x7f), Just(0x80), Just(0)];
    prop::collection::vec(byte, 0..64)
}

/// Mostly what a sensor says, sometimes any bits.
fn acceleration_or_rate() -> impl Strategy<Value = f32> {
    prop_oneof![6 => -70.0..70.0_f32, 1 => any::<f32>()]
}

proptest! {
    #[test]
    fn random_payloads_give_finite_events(
        id in prop::sample::select(&IDS[..]),
        payloads in prop::collection::vec(payload(), 1..20),
    ) {
        let mut out = SessionOutput::default();
        let mut session = synced(&mut out);
        for (ms, payload) in (2_000..).zip(payloads) {
            let Ok(message) = MavMessage::parse(MavlinkVersion::V2, id, &payload) else { continue };
            session.on_message(&AUTOPILOT, &message, at_ms(ms), &mut out);
            session.on_time(at_ms(ms), &mut out);
            prop_assert!(out.events.iter().all(is_finite), "{:?}", out.events);
        }
    }

    #[test]
    fn random_numbers_with_good_stamps_are_bounded(values in prop::array::uniform6(acceleration_or_rate())) {
        let mut out = SessionOutput::default();
        let mut session = synced(&mut out);
        let [xacc, yacc, zacc, xgyro, ygyro, zgyro] = values;
        let data = mavlink::dialects::ardupilotmega::HIGHRES_IMU_DATA {
            time_usec: 2_000_000, xacc, yacc, zacc, xgyro, ygyro, zgyro, ..Default::default()
        };
        session.on_message(&AUTOPILOT, &MavMessage::HIGHRES_IMU(data), at_ms(2_001), &mut out);
        let is_good = values[..3].iter().all(|v| v.abs() <= 320.0)
            && values[3..].iter().all(|v| v.abs() <= 70.0);
        prop_assert_eq!(out.events.len(), usize::from(is_good));
    }
}
