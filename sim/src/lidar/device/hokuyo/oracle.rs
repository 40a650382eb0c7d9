//! A scan and the parameters of a URG-04LX, byte by byte.
//!
//! Source: Hokuyo's SCIP 2.0 specification as `urg_library` 1.2.7 reads it (`urg_sensor.c`); the length
//! of a whole scan, 2,137 bytes, is that of a real sensor.

use super::{Hokuyo, Measuring};
use crate::lidar::{Echo, LidarModel, Scene};
use std::time::Duration;
use stockpilot::lidar::Model;
use stockpilot::lidar::hokuyo::{Block, BlockReader};
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

const SCAN: &str = include_str!("../vectors/urg04lx_scan.txt");
const PARAMETERS: &str = include_str!("../vectors/urg04lx_pp.txt");
const TIME_MS: u32 = 1_234_567;

/// Distance at a step, counted from the first: 20 + (37 i mod 5500).
const fn mm(i: u32) -> u32 {
    20 + 37 * i % 5500
}

fn blocks(bytes: &[u8]) -> Vec<(Block, Vec<u32>)> {
    let mut reader = BlockReader::new(682);
    let mut blocks = Vec::new();
    for chunk in bytes.chunks(7) {
        reader.feed(chunk, |block, distances, _| blocks.push((block, distances.to_vec())));
    }
    assert_eq!((reader.refused(), reader.skipped_bytes()), (0, 0));
    blocks
}

/// What stands at each step: 44 to 725 of 1,024, step 384 in front, counter-clockwise.
struct Steps;

impl Scene for Steps {
    fn distance_m(&mut self, _at: Stamp<Mono>, clockwise_deg: f64) -> Option<f64> {
        let step = (384.0 - clockwise_deg / 360.0 * 1024.0).rem_euclid(1024.0).round();
        let expected = (44..=725).find(|at: &u32| f64::from(*at).total_cmp(&step).is_eq())?;
        Some(f64::from(mm(expected - 44)) / 1000.0)
    }

    fn echo(&mut self, at: Stamp<Mono>, clockwise_deg: f64) -> Option<Echo> {
        self.distance_m(at, clockwise_deg).map(|range_m| Echo { range_m, intensity: 0 })
    }
}

fn sensor() -> Hokuyo {
    let model = LidarModel::of(Model::HokuyoUrg04lx);
    Hokuyo::new(&model, 682, SeedBook::new(1), Stamp::ZERO)
}

#[test]
fn urg04lx_scan() {
    assert_eq!(SCAN.len(), 2137);
    let read = blocks(SCAN.as_bytes());
    let [(Block::Scan { time_ms, n_bytes }, distances)] = &read[..] else { panic!("{read:?}") };
    assert_eq!((*time_ms, *n_bytes), (TIME_MS, 2137));
    assert_eq!(*distances, (0..682).map(mm).collect::<Vec<_>>());

    let began = Stamp::ZERO.plus(Duration::from_secs(5000));
    let mut sensor = Hokuyo {
        booted: began.minus(Duration::from_millis(TIME_MS.into())),
        measuring: Some(Measuring {
            command: "MD00440725010".to_owned(),
            first_step: 44,
            last_step: 725,
            n_left: 0,
            next_at: began,
        }),
        ..sensor()
    };
    let frame = sensor.scan(began.plus(Duration::from_secs(1)), &mut Steps).unwrap();
    assert_eq!(String::from_utf8(frame.bytes).unwrap(), SCAN);
}

#[test]
fn urg04lx_parameters() {
    let read = blocks(PARAMETERS.as_bytes());
    let [(Block::Answer { echo, state, values }, _)] = &read[..] else { panic!("{read:?}") };
    assert_eq!((echo.as_str(), state), ("PP", b"00"));
    let numbers = [20, 5600, 1024, 44, 725, 384, 600];
    let names = ["DMIN", "DMAX", "ARES", "AMIN", "AMAX", "AFRT", "SCAN"];
    let expected: Vec<(String, String)> =
        names.iter().zip(numbers).map(|(name, n)| ((*name).to_owned(), n.to_string())).collect();
    assert_eq!(values[1..], expected);

    let mut sensor = sensor();
    sensor.act("PP", Stamp::ZERO);
    assert_eq!(String::from_utf8(sensor.answers[0].bytes.clone()).unwrap(), PARAMETERS);
}
