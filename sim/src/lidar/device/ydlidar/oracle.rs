//! Packets of a TG30 and a G4, byte by byte.
//!
//! Source: `YDLidar-SDK` 1.2.20, `core/common/ydlidar_protocol.h` and `src/YDlidarDriver.cpp`.

use super::Ydlidar;
use crate::lidar::LidarModel;
use crate::lidar::device::vectors::{bytes, numbers};
use stockpilot::lidar::ydlidar::{Geometry, PacketParser, SampleFormat};
use stockpilot::lidar::{Model, Sample};
use stockpilot::stats::SeedBook;
use stockpilot::time::Stamp;

const TG30: &str = include_str!("../vectors/ydlidar_tg30.hex");
const G4: &str = include_str!("../vectors/ydlidar_g4.hex");
const G4_ANGLES: &str = include_str!("../vectors/ydlidar_g4_angles.txt");

fn samples(geometry: Geometry, bytes: &[u8]) -> Vec<Sample> {
    let mut parser = PacketParser::new(geometry, SampleFormat::Distance);
    let mut samples = Vec::new();
    parser.feed(bytes, |arrived| samples.extend_from_slice(arrived.samples));
    assert_eq!((parser.refused(), parser.skipped_bytes()), (0, 0));
    samples
}

fn sent(model: Model, model_byte: u8, first_q6: u32, last_q6: u32, mm: &[f64]) -> Vec<u8> {
    let model = LidarModel::of(model);
    let sensor = Ydlidar::new(&model, model_byte, SeedBook::new(1), Stamp::ZERO, true);
    let samples: Vec<(u8, f64)> = mm.iter().map(|mm| (0, *mm)).collect();
    sensor.pack(first_q6, last_q6, &samples)
}

fn assert_ranges(samples: &[Sample], mm: &[f64]) {
    for (sample, mm) in samples.iter().zip(mm) {
        assert!((f64::from(sample.range_m) * 1000.0 - mm).abs() < 1e-2, "{sample:?}, {mm} mm");
    }
}

#[test]
fn tg30_packet() {
    let vector = bytes(TG30);
    let mm: Vec<f64> = (0..40).map(|i| f64::from(300 + 197 * i)).collect();
    let read = samples(Geometry::of(Model::YdlidarTg30), &vector);
    assert_eq!(read.len(), 40);
    assert_ranges(&read, &mm);
    for (i, sample) in read.iter().enumerate() {
        let expected_deg = 45.25 + (3345.0 - 2896.0) / 64.0 * i as f64 / 39.0;
        assert!((f64::from(sample.clockwise_deg) - expected_deg).abs() < 1e-4, "sample {i}");
    }
    assert_eq!(sent(Model::YdlidarTg30, 101, 2896, 3345, &mm), vector);
}

#[test]
fn g4_packet() {
    let vector = bytes(G4);
    let mm = |i: u32| if i == 3 { 0.0 } else { f64::from(4 * (300 + 197 * i) + i % 4) / 4.0 };
    let mm: Vec<f64> = (0..40).map(mm).collect();
    let read = samples(Geometry::of(Model::YdlidarG4), &vector);
    let angles_deg = numbers(G4_ANGLES);
    assert_eq!((read.len(), angles_deg.len()), (40, 40));
    assert_ranges(&read, &mm);
    // The maker leaves the angle of what did not come back as the head's; ours is where that beam went.
    let returned = |(sample, _): &(&Sample, f64)| sample.range_m > 0.0;
    for (sample, deg) in read.iter().zip(angles_deg).filter(returned) {
        // Single precision near 360° has steps of 3e-5°.
        assert!((f64::from(sample.clockwise_deg) - deg).abs() < 1e-4, "{sample:?}, {deg}");
    }
    assert_eq!(sent(Model::YdlidarG4, 5, 22_720, 22_720 + 998, &mm), vector);
}
