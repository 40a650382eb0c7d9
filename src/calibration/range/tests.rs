#![expect(clippy::cast_possible_truncation, reason = "beams are single precision")]

use super::*;
use crate::messages::Beam;
use crate::stats::{Noise, SeedBook};
use crate::time::Stamp;
use std::f64::consts::TAU;

/// A sensor with a known fault in a room whose walls but one are far away.
struct Sensor {
    bias_m: f64,
    scale: f64,
    noise_m: f64,
    noise: Noise,
}

impl Sensor {
    fn new(seed: u64) -> Self {
        let noise = SeedBook::new(seed).stream("range");
        Self { bias_m: 0.021, scale: 0.003, noise_m: 0.009, noise }
    }

    /// Twenty turns: a wall at 25°, parts of the vehicle at 100° to 112° and about ±180°, else 9 m.
    fn scans(&mut self, wall_m: f64) -> Vec<Scan> {
        let wall_rad = 25_f64.to_radians();
        let one = |sensor: &mut Self| {
            let beam = |k: u32| {
                let angle_rad = f64::from(k) / 720.0 * TAU - 3.1;
                let deg = angle_rad.to_degrees();
                let cos = (angle_rad - wall_rad).cos();
                let true_m = if (100.0..112.0).contains(&deg) {
                    0.17
                } else if !(-174.0..=176.0).contains(&deg) {
                    0.24
                } else if cos > 0.5 {
                    wall_m / cos
                } else {
                    9.0
                };
                let range_m = true_m * (1.0 + sensor.scale)
                    + sensor.bias_m
                    + sensor.noise_m * sensor.noise.normal();
                Beam {
                    offset_ns: k,
                    angle_rad: angle_rad as f32,
                    range_m: range_m as f32,
                    intensity: 9,
                }
            };
            Scan { start: Stamp::ZERO, beams: (0..720).map(beam).collect() }
        };
        (0..20).map(|_| one(self)).collect()
    }

    fn at(&mut self, taped_m: f64) -> Position {
        Position { taped_m, scans: self.scans(taped_m) }
    }
}

fn request() -> Request {
    Request {
        tape_sigma_m: 0.002,
        axis_sigma_m: 0.0,
        range_m: (0.1, 12.0),
        range_step_m: 0.001,
        scale: (0.0, 0.001),
    }
}

/// Tapes are as wrong as they say, and errors over their σ are those of a normal number.
#[test]
fn bias_scale_and_noise_come_back_within_their_sigma() {
    let (mut squares, mut n) = (0.0, 0.0);
    for seed in 0..30 {
        let mut sensor = Sensor::new(seed);
        let mut tape = SeedBook::new(seed).stream("tape");
        let positions: Vec<Position> = [0.8, 1.7, 3.0, 5.0]
            .map(|true_m| {
                let scans = sensor.scans(true_m);
                Position { taped_m: true_m + 0.002 * tape.normal(), scans }
            })
            .into();
        let found = check(&positions, None, &request()).unwrap();
        let scale = found.scale.unwrap();
        squares += ((found.bias_m.value - 0.021) / found.bias_m.sigma).powi(2);
        squares += ((scale.value - 0.003) / scale.sigma).powi(2);
        n += 2.0;
        // The largest of four.
        assert!(
            (found.noise_m.value - 0.009).abs() < 4.0 * found.noise_m.sigma,
            "{:?}",
            found.noise_m
        );
        assert!(found.bias_m.sigma < 0.004 && scale.sigma < 0.0015, "{found:?}");
    }
    // Mean of 60 squares, of which two and two are correlated: 1 ± 0.2, less where a scatter by chance
    // has widened the σ.
    println!("mean square of error/σ {:.2}", squares / n);
    assert!((0.3..1.5).contains(&(squares / n)), "{}", squares / n);
}

#[test]
fn the_vehicle_is_told_from_the_hall() {
    let mut sensor = Sensor::new(1);
    let positions = [0.5, 1.5, 2.5].map(|m| sensor.at(m));
    let body = check(&positions, None, &request()).unwrap().body.unwrap();
    let sectors: Vec<[f64; 2]> =
        body.iter().map(|s| [s.from_rad.to_degrees(), s.to_rad.to_degrees()]).collect();
    println!("{body:?}");
    // Two bins of margin on both sides, a bin of rounding; the wall at 0.5 m is not among them.
    let expected = [[-180.0, -172.0], [98.0, 114.0], [174.0, 180.0]];
    assert_eq!(sectors.len(), 3);
    for (found, expected) in sectors.iter().zip(expected) {
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() <= 1.5, "{sectors:?}");
        }
    }
    assert!((body[1].nearest_m - 0.19).abs() < 0.04 && (body[0].nearest_m - 0.26).abs() < 0.04);
    // Hardly moved, the vehicle and the hall look alike.
    let positions = [1.0, 1.1].map(|m| sensor.at(m));
    assert!(check(&positions, None, &request()).unwrap().body.is_none());
}

#[test]
fn one_distance_leaves_the_scale_and_says_so_in_the_sigma_of_the_bias() {
    let mut sensor = Sensor::new(2);
    sensor.scale = 0.0;
    let found = check(&[sensor.at(4.0)], None, &request()).unwrap();
    assert!(found.scale.is_none());
    // 2 mm of the tape and 0.1 % of 4 m.
    assert!((found.bias_m.sigma - 0.002_f64.hypot(0.004)).abs() < 1e-4, "{:?}", found.bias_m);
    assert!((found.bias_m.value - 0.021).abs() < 2.0 * found.bias_m.sigma);
}

#[test]
fn what_is_no_wall_is_refused_with_the_cure() {
    let mut sensor = Sensor::new(3);
    let refused = |positions: &[Position]| check(positions, None, &request()).unwrap_err();
    assert_eq!(refused(&[]), Refusal::NoPosition);
    assert!(matches!(refused(&[sensor.at(14.0)]), Refusal::OutOfReach { .. }));
    let short = Position { taped_m: 2.0, scans: Vec::new() };
    assert!(matches!(refused(&[short]), Refusal::TooFew { n_beams: 0, .. }));
    // Measured to the wrong end of the tape by half a metre.
    let wrong = Position { taped_m: 2.5, scans: sensor.scans(2.0) };
    let Refusal::NoWall { nearest_m, .. } = refused(&[wrong]) else { panic!("a wall") };
    assert!((nearest_m.unwrap() - 2.0).abs() < 0.11, "{nearest_m:?}");
    // One distance misread by 5 cm among four.
    let mut positions = [0.8, 1.7, 3.0, 5.0].map(|m| sensor.at(m));
    positions[1].taped_m += 0.05;
    let Refusal::Contradiction { worst_m, .. } = refused(&positions) else { panic!("agreed") };
    assert!((worst_m - 1.75).abs() < 1e-9, "{worst_m}");
    // Held in the hand: 3 cm nearer in the second half.
    let scans = [sensor.scans(2.0), sensor.scans(1.97)].concat();
    assert!(matches!(refused(&[Position { taped_m: 2.0, scans }]), Refusal::Moved { .. }));
    // In the corner of a room, both walls at the same distance.
    let mut scans = sensor.scans(2.0);
    for beam in scans.iter_mut().flat_map(|scan| &mut scan.beams) {
        let cos = (f64::from(beam.angle_rad) + 65_f64.to_radians()).cos();
        if cos > 0.71 {
            beam.range_m = (2.02 / cos) as f32;
        }
    }
    let corner = [Position { taped_m: 2.0, scans }];
    assert!(matches!(refused(&corner), Refusal::TwoWalls { .. }));
    let towards = check(&corner, Some(30_f64.to_radians()), &request()).unwrap();
    assert!((towards.lines[0].direction_rad - 25_f64.to_radians()).abs() < 0.01);
}
