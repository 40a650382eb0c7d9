//! Bytes of a LiDAR's line, cut anywhere and with any pauses, into every driver, its scans, and
//! the search for an unknown sensor.

#![no_main]

use arbitrary::{Result, Unstructured};
use libfuzzer_sys::fuzz_target;
use std::time::Duration;
use stockpilot::lidar::{Detector, Model, ScanAssembler, sensor};
use stockpilot::time::Stamp;

fuzz_target!(|input: &[u8]| {
    let mut u = Unstructured::new(input);
    let _ = converse(&mut u);
});

fn converse(u: &mut Unstructured<'_>) -> Result<()> {
    let model = *u.choose(&Model::ALL)?;
    let mut now = Stamp::ZERO;
    let mut sensor = sensor(model);
    let mut assembler = ScanAssembler::new(model.default_baud());
    let mut detector = Detector::new(None);
    sensor.restart(now);
    while !u.is_empty() {
        while sensor.poll(now).is_some() {}
        while detector.poll(now).is_some() {}
        let n_bytes = u.int_in_range(0..=400_usize)?.min(u.len());
        let bytes = u.bytes(n_bytes)?;
        detector.feed(bytes);
        sensor.feed(bytes, now, &mut |packet| {
            assembler.push(packet, |scan| {
                for beam in &scan.beams {
                    assert!(beam.range_m.is_finite() && beam.range_m >= 0.0);
                    assert!(beam.angle_rad.abs() <= std::f32::consts::PI + 1e-6);
                }
                assert!(scan.beams.is_sorted_by_key(|beam| beam.offset_ns));
            });
        });
        now = now.plus(Duration::from_millis(u.int_in_range(0..=700)?));
    }
    Ok(())
}
