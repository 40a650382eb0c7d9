//! An unknown sensor is found out, whatever its line speed.

use crate::support::{STEP, exact, room};
use stockpilot::lidar::{Detector, Found, Model, Probe};
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::Stamp;
use stockpilot_sim::lidar::device;

/// What the search finds and how long it takes, s.
fn found(model: Model, is_running: bool) -> (Option<Found>, f64) {
    let exact = exact(model);
    let start = Stamp::ZERO;
    let mut device = device(&exact, SeedBook::new(3), start, is_running);
    let mut room = room(&exact);
    let mut noise: Noise = SeedBook::new(4).stream("garbage");
    let mut detector = Detector::new(None);
    let (mut now, mut baud) = (start, 0);
    // USB knows no line speed.
    let is_usb = model.family() == stockpilot::lidar::Family::Hokuyo;
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
                return (Some(found), now.seconds());
            }
        }
    }
    (None, now.seconds())
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
