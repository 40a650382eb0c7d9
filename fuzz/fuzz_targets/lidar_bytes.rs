//! Bytes of a LiDAR's line, cut anywhere and with any pauses, into every driver, its scans, and
//! the search for an unknown sensor; and any payload behind right heads and sums, because raw bytes
//! hardly ever pass a checksum.

#![no_main]

#[path = "../../tests/drivers/lidar_endurance.rs"]
mod lidar_endurance;
#[path = "../../tests/drivers/lidar_frames.rs"]
mod lidar_frames;

use arbitrary::{Result, Unstructured};
use libfuzzer_sys::fuzz_target;
use lidar_endurance::Piece;
use lidar_frames::Kind;
use std::time::Duration;
use stockpilot::lidar::{Detector, Model, ScanAssembler, sensor};
use stockpilot::time::Stamp;

fuzz_target!(|input: &[u8]| {
    let mut u = Unstructured::new(input);
    let _ = choose(&mut u);
});

fn choose(u: &mut Unstructured<'_>) -> Result<()> {
    match u.int_in_range(0..=2)? {
        0 => raw(u),
        arm => framed(u, arm == 1),
    }
}

fn framed(u: &mut Unstructured<'_>, is_parser_alone: bool) -> Result<()> {
    let kind = *u.choose(&Kind::ALL)?;
    let chunk_bytes = u.int_in_range(1..=400_usize)?;
    let mut pieces = Vec::new();
    while !u.is_empty() && pieces.len() < 40 {
        let arm = u.int_in_range(0..=5)?;
        let n_bytes = u.int_in_range(0..=2100_usize)?.min(u.len());
        let bytes = u.bytes(n_bytes)?.to_vec();
        pieces.push(match arm {
            0 => Piece::Garbage(bytes),
            1 => Piece::Damaged(bytes, u.arbitrary()?),
            _ => Piece::Frame(bytes),
        });
    }
    if is_parser_alone {
        lidar_endurance::parse(kind, &pieces, chunk_bytes);
    } else {
        lidar_endurance::converse(kind, &pieces, chunk_bytes);
    }
    Ok(())
}

fn raw(u: &mut Unstructured<'_>) -> Result<()> {
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
