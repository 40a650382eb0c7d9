//! Dense, ultra-dense and HQ frames, byte by byte.
//!
//! Source: Slamtec `rplidar_sdk` 2.1.0, `sl_lidar_protocol.h` and `handler_capsules.cpp`,
//! `handler_hqnode.cpp`, `sl_crc.cpp`; the CRC is the one of Python's `zlib`.

use super::Format;
use super::formats::Shot;
use crate::lidar::device::vectors::bytes;
use stockpilot::lidar::rplidar::{Answer, Node, StreamParser};
use stockpilot::time::Stamp;

const DENSE: &str = include_str!("../vectors/rplidar_dense.hex");
const ULTRA_DENSE: &str = include_str!("../vectors/rplidar_ultra_dense.hex");
const HQ: &str = include_str!("../vectors/rplidar_hq.hex");

/// The nodes of whole frames, whatever the chunks.
fn nodes(answer: Answer, bytes: &[u8]) -> Vec<Node> {
    let read = |chunk_bytes: usize| {
        let (mut parser, mut nodes) = (StreamParser::new(answer), Vec::new());
        for chunk in bytes.chunks(chunk_bytes) {
            parser.feed(chunk, Stamp::ZERO, |arrived| nodes.extend_from_slice(arrived.nodes));
        }
        assert_eq!((parser.refused(), parser.skipped_bytes()), (0, 0));
        nodes
    };
    let nodes = read(bytes.len());
    assert_eq!(nodes, read(3));
    nodes
}

/// Whole steps of 2⁻¹⁶ ° are lost at most once in a sample: the vendor adds a truncated step.
fn assert_angles(nodes: &[Node], start_deg: f64, span_deg: f64) {
    for (i, node) in nodes.iter().enumerate() {
        let expected = (start_deg + span_deg * i as f64 / nodes.len() as f64).rem_euclid(360.0);
        let off_deg = f64::from(node.angle_q16) / 65_536.0 - expected;
        assert!((-1e-3..1e-6).contains(&off_deg), "sample {i}: {off_deg}");
    }
}

fn shot(quarters: u32, intensity: u8) -> Shot {
    Shot { dist_mm: f64::from(quarters) / 4.0, intensity, ..Shot::default() }
}

#[test]
fn dense_capsules() {
    let vector = bytes(DENSE);
    let mm = |i: u32| if i == 7 { 0 } else { 500 + 137 * i };
    let read = nodes(Answer::Dense, &vector);
    assert_eq!(read.len(), 40);
    assert!((0..).zip(&read).all(|(i, node)| node.dist_q2 == 4 * mm(i)));
    assert!((0..).zip(&read).all(|(i, node)| node.quality == if i == 7 { 0 } else { 188 }));
    // 23,322 − 22,400 of 1/64° from 350°.
    assert_angles(&read, 350.0, 922.0 / 64.0);

    let first: Vec<Shot> = (0..40).map(|i| shot(4 * mm(i), 0)).collect();
    let second = [shot(4000, 0); 40];
    let sent = [
        Format::Dense.pack(22_400, false, &first, second[0]),
        Format::Dense.pack(282, false, &second, second[0]),
    ];
    assert_eq!(sent.concat(), vector);
}

#[test]
fn ultra_dense_capsules() {
    let vector = bytes(ULTRA_DENSE);
    let mm = |i: u32| match i % 4 {
        0 => 2 * (50 + i),
        1 => 2046 + 3 * (10 + i),
        2 => 8187 + 4 * (100 + i),
        _ => 24_567 + 5 * (20 + i),
    };
    let strength = |i: u32| u8::try_from(8 * (i % 32)).unwrap();
    let read = nodes(Answer::UltraDense, &vector);
    assert_eq!(read.len(), 64);
    for (i, node) in (0..).zip(&read) {
        assert_eq!((node.dist_q2, node.quality), (4 * mm(i), strength(i)), "sample {i}");
    }
    assert_angles(&read, 100.5, 1228.0 / 64.0);

    let first: Vec<Shot> = (0..64).map(|i| shot(4 * mm(i), strength(i))).collect();
    let second = [shot(4000, 40); 64];
    let sent = [
        Format::UltraDense.pack(6432, false, &first, second[0]),
        Format::UltraDense.pack(7660, false, &second, second[0]),
    ];
    assert_eq!(sent.concat(), vector);
}

#[test]
fn hq_packet() {
    let vector = bytes(HQ);
    let quarters = |i: u32| 4 * (1234 + 11 * i) + i % 4;
    let strength = |i: u32| u8::try_from(5 * i % 256).unwrap();
    let angle = |i: u32| 16_000 + 170 * i;
    let read = nodes(Answer::Hq, &vector);
    assert_eq!(read.len(), 96);
    for (i, node) in (0..).zip(&read) {
        // 90°/2¹⁴ are 360 of 2⁻¹⁶ °.
        let expected = (i32::try_from(360 * angle(i)).unwrap(), quarters(i), strength(i), i == 40);
        let told = (node.angle_q16, node.dist_q2, node.quality, node.starts_turn);
        assert_eq!(told, expected, "sample {i}");
    }

    let shots = (0..96).map(|i| Shot {
        angle_deg: f64::from(angle(i)) * 90.0 / 16_384.0,
        starts_turn: i == 40,
        ..shot(quarters(i), strength(i))
    });
    let shots: Vec<Shot> = shots.collect();
    assert_eq!(Format::Hq.pack(0, false, &shots, shots[0]), vector);
}
