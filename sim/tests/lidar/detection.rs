//! An unknown sensor is found out, whatever its line speed.

use crate::support::{STEP, exact, room};
use stockpilot::lidar::{Detector, Found, Model, Probe};
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::Stamp;
use stockpilot_sim::lidar::{Firmware, LidarModel, device};

/// What the search finds and how long it takes, s.
fn found(model: Model, is_running: bool) -> (Option<Found>, f64) {
    let (detector, found, took_s) = searched(&exact(model), is_running);
    assert_eq!(detector.stranger(), None);
    (found, took_s)
}

fn searched(exact: &LidarModel, is_running: bool) -> (Detector, Option<Found>, f64) {
    let start = Stamp::ZERO;
    let mut device = device(exact, SeedBook::new(3), start, is_running);
    let mut room = room(exact);
    let mut noise: Noise = SeedBook::new(4).stream("garbage");
    let mut detector = Detector::new(None);
    let (mut now, mut baud) = (start, 0);
    // USB knows no line speed.
    let is_usb = matches!(exact.firmware, Firmware::Hokuyo(_));
    while !detector.is_exhausted() {
        now = now.plus(STEP);
        while let Some(probe) = detector.poll(now) {
            match probe {
                Probe::SetBaud(wanted) => baud = wanted,
                Probe::Send(bytes) if baud == exact.baud || is_usb => device.hear(&bytes, now),
                Probe::Send(_) => {}
            }
        }
        let mut frames = Vec::new();
        device.advance(now, &mut room, &mut frames);
        for frame in frames {
            let mut bytes = frame.bytes;
            if baud != exact.baud && !is_usb {
                bytes.iter_mut().for_each(|byte| *byte = noise.bits().to_le_bytes()[0]);
            }
            if let Some(found) = detector.feed(&bytes) {
                return (detector, Some(found), now.seconds());
            }
        }
    }
    (detector, None, now.seconds())
}

/// A sister of a known sensor with a number of its own.
fn sister(of: Model, firmware: Firmware) -> LidarModel {
    LidarModel { firmware, ..exact(of) }
}

#[test]
fn a_sensor_with_an_unknown_number_is_named_with_its_speed() {
    for (model, name) in [
        (sister(Model::YdlidarG4, Firmware::Ydlidar(19)), "YDLIDAR model 19"),
        (sister(Model::YdlidarX4, Firmware::Ydlidar(4)), "YDLIDAR model 4"),
        (sister(Model::RplidarS2, Firmware::Rplidar(0xB1)), "RPLIDAR model 177"),
    ] {
        let (detector, found, took_s) = searched(&model, false);
        assert_eq!(found, None);
        let stranger = detector.stranger().unwrap_or_else(|| panic!("{name} is not noticed"));
        println!("{stranger:?} after {took_s:.1} s");
        assert_eq!((stranger.name.as_str(), stranger.baud), (name, model.baud));
        assert!(took_s < 8.0);
    }
}

#[test]
fn every_sensor_is_found_at_its_speed() {
    for model in Model::ALL {
        let (found, took_s) = found(model, true);
        let found = found.unwrap_or_else(|| panic!("{model:?} is not found"));
        println!("{:18} {found:?} after {took_s:.1} s", model.name());
        // An LD06 sends what an LD19 sends.
        let expected = if model == Model::Ld06 { Model::Ld19 } else { model };
        assert_eq!(found.model, expected);
        assert!(took_s < 8.0);
        if model.family() != stockpilot::lidar::Family::Hokuyo {
            assert_eq!(found.baud, model.default_baud());
        }
    }
}

#[test]
fn garbage_is_nobody() {
    let mut detector = Detector::new(None);
    let mut noise: Noise = SeedBook::new(9).stream("garbage");
    let mut now = Stamp::ZERO;
    while !detector.is_exhausted() {
        now = now.plus(STEP);
        while detector.poll(now).is_some() {}
        let bytes: Vec<u8> = (0..60).map(|_| noise.bits().to_le_bytes()[0]).collect();
        assert_eq!(detector.feed(&bytes), None);
    }
}
