//! One frame of an STL-27L, byte by byte.
//!
//! Source: LDROBOT development manual of the LD19, section 3, and `ldlidar_stl_sdk` 3.0.3, `lipkg.h`; the
//! CRC is a long division that gives the manual's example its 50.

use crate::lidar::device::vectors::bytes;
use crate::lidar::{Packet, Sample, encode};
use stockpilot::lidar::ldrobot::Parser;
use stockpilot::time::Stamp;

const FRAME: &str = include_str!("../vectors/stl27l.hex");

#[test]
fn stl27l_frame() {
    let vector = bytes(FRAME);
    let mut frames = Vec::new();
    Parser::new().feed(&vector, |frame, _| frames.push(frame));
    let [frame] = &frames[..] else { panic!("{frames:?}") };
    assert_eq!((frame.speed_deg_per_s, frame.timestamp_ms), (3600, 12_345));
    for (i, sample) in frame.samples.iter().enumerate() {
        assert_eq!(usize::from(sample.range_mm), 24_000 - 111 * i);
        assert_eq!(usize::from(sample.intensity), 200 - i);
        let expected_deg = 123.45 + 1.83 * i as f64 / 11.0;
        assert!((frame.angle_deg(i) - expected_deg).abs() < 1e-9);
    }
    let sample = |i: usize| Sample {
        at: Stamp::ZERO,
        clockwise_cdeg: 0.0,
        range_mm: u16::try_from(24_000 - 111 * i).unwrap(),
        intensity: u8::try_from(200 - i).unwrap(),
    };
    let packet = Packet {
        samples: std::array::from_fn(sample),
        speed_dps: 3600,
        start_cdeg: 12_345,
        end_cdeg: 12_528,
        clock_ms: 12_345,
    };
    assert_eq!(encode(&packet)[..], vector);
}
