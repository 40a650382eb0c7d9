//! PX4 on a serial line: half of it by default, and what nobody reads takes most of that.

use crate::support::short_survey;
use std::time::Duration;
use stockpilot::pilot::Event;
use stockpilot_sim::autopilot::{Flavour, ParamValue, StubAutopilot};
use stockpilot_sim::campaign::{DirectFlight, Witnessed};
use stockpilot_sim::hall::{Devices, config};
use stockpilot_sim::scenario::Scenario;

const SEED: u64 = 61;

/// A flight over such an address; its autopilot's port has this speed and this `MAV_1_RATE`.
fn flight(address: &str, baud: u32, rate: i32) -> DirectFlight {
    let scenario = Scenario { autopilot: Flavour::Px4, ..short_survey(SEED, 30) };
    let mut config = config(&scenario, Devices::none());
    config.link.address = address.to_owned();
    let mut flight = DirectFlight::with_config(&scenario, &config).expect("it fits");
    if let StubAutopilot::Px4(stub) = flight.rig.autopilot_mut() {
        assert!(stub.params_mut().set("MAV_1_RATE", ParamValue::Int(rate)));
        stub.speaks_over_serial(baud);
    }
    flight
}

/// Inertial samples per second from 5 to 15 s after the start.
fn imu_hz(flight: &mut DirectFlight) -> f64 {
    let mut n_samples = 0_u32;
    let began = flight.rig.now();
    let (from, until) = (began.plus(Duration::from_secs(5)), began.plus(Duration::from_secs(15)));
    while flight.rig.now() < until {
        flight.step(&mut |now, witnessed| {
            let is_sample = matches!(witnessed, Witnessed::Event(Event::Imu(_)));
            n_samples += u32::from(is_sample && now >= from);
        });
    }
    f64::from(n_samples) / 10.0
}

fn is_told(flight: &DirectFlight) -> bool {
    flight.texts().join("").contains("too few inertial samples")
}

#[test]
fn px4_gives_its_bytes_to_what_is_read_and_too_few_of_them_are_told() {
    // 230400 baud carry 23040 bytes/s, of which PX4 takes 11520. What it sends unasked is 14 kB/s of 33:
    // 200 Hz · 11520 / 33200 = 69 Hz where it must be left on, 200 · 11520 / 19200 = 120 Hz without it.
    let mut shared = flight("udpin:127.0.0.1:0", 230_400, 0);
    let hz = imu_hz(&mut shared);
    assert!((55.0..75.0).contains(&hz), "{hz} Hz behind a network");
    let mut own = flight("serial:/dev/ttyAMA0:230400", 230_400, 0);
    let hz = imu_hz(&mut own);
    assert!((105.0..135.0).contains(&hz), "{hz} Hz on a line of its own");
    assert!(is_told(&own), "{:?}", own.texts());
    // Either cure.
    for (baud, rate) in [(230_400, 20_700), (921_600, 0)] {
        let mut cured = flight(&format!("serial:/dev/ttyAMA0:{baud}"), baud, rate);
        let hz = imu_hz(&mut cured);
        assert!(hz > 190.0, "{hz} Hz at {baud} baud, MAV_1_RATE {rate}");
        assert!(!is_told(&cured), "{:?}", cured.texts());
    }
}
