//! The range check before a wall, on emulators with a known fault and with parts of a vehicle in view.

use crate::support::{Bench, Clean};
use stockpilot::calibration::range::{Position, RangeCheck, Request, check};
use stockpilot::lidar::Model;
use stockpilot::stats::SeedBook;
use stockpilot_sim::lidar::{LidarModel, Optics, Part, Room};

const BIAS_M: f64 = 0.018;
const SCALE: f64 = 0.004;
const NOISE_M: f64 = 0.007;
/// Clockwise: a leg behind at the left, an arm at the right.
const PARTS: [Part; 2] = [
    Part { from_deg: 220.0, to_deg: 233.0, distance_m: 0.31 },
    Part { from_deg: 85.0, to_deg: 95.0, distance_m: 0.42 },
];

/// What the sensor gives at a distance: the walls ahead and behind, two metres of hall to the sides.
fn scans_at(model: Model, distance_m: f64, seed: u64) -> Position {
    let faulty = LidarModel {
        range_bias_m: BIAS_M,
        range_scale: SCALE,
        range_sigma_m: NOISE_M,
        ..LidarModel::of(model)
    };
    let mut bench = Bench::new(model);
    let optics = Optics::new(faulty, SeedBook::new(seed));
    bench.room = Room::new(optics).with_half_length_m(distance_m).with_parts(PARTS.into());
    // The first seconds go for questions and spin-up.
    bench.run(4.0, &mut Clean);
    bench.scans.clear();
    bench.run(3.0, &mut Clean);
    Position { taped_m: distance_m, scans: bench.scans }
}

fn checked(model: Model) -> RangeCheck {
    let distances_m = [0.9, 1.6, 2.6, 3.6];
    let positions: Vec<Position> =
        distances_m.iter().zip(50..).map(|(m, seed)| scans_at(model, *m, seed)).collect();
    let spec = model.spec();
    let request = Request {
        tape_sigma_m: 0.001,
        axis_sigma_m: 0.0005,
        range_m: spec.range_m,
        range_step_m: spec.range_step_m,
        scale: (0.0, 0.001),
    };
    // The wall behind is as far as the one ahead.
    check(&positions, Some(0.0), &request).unwrap()
}

#[test]
fn bias_noise_and_the_vehicles_own_parts_are_found_with_every_family() {
    let models = [Model::Ld19, Model::RplidarS2, Model::RplidarA3, Model::YdlidarTg15];
    for model in models.into_iter().chain([Model::HokuyoUtm30lx]) {
        let found = checked(model);
        let (bias, scale) = (found.bias_m, found.scale.unwrap());
        let noise_mm = 1e3 * found.noise_m.value;
        println!(
            "{:18} bias {:.2} ± {:.2} mm, scale {:.3} ± {:.3} %, noise {noise_mm:.2} mm, {:?}",
            model.name(),
            1e3 * bias.value,
            1e3 * bias.sigma,
            1e2 * scale.value,
            1e2 * scale.sigma,
            found.body
        );
        assert!((bias.value - BIAS_M).abs() < 2.0 * bias.sigma, "{model:?}: {bias:?}");
        assert!((scale.value - SCALE).abs() < 2.0 * scale.sigma, "{model:?}: {scale:?}");
        assert!(bias.sigma < 0.002 && scale.sigma < 0.001, "{model:?}");
        // The step of the range adds to the noise: up to 8 mm on an A3 at these distances.
        let step_mm = if model == Model::RplidarA3 { 4.0 } else { 1.0 } / 12_f64.sqrt();
        let expected_mm = (1e3 * NOISE_M).hypot(step_mm);
        assert!((noise_mm - expected_mm).abs() < 0.6, "{model:?}: {noise_mm} mm");

        // Counter-clockwise: 360 − 233 to 360 − 220 and −95 to −85, with 2° of margin and 1° of rounding.
        let body = found.body.unwrap();
        let mut expected = vec![([-97.0, -83.0], 0.42), ([125.0, 142.0], 0.31)];
        if model == Model::HokuyoUtm30lx {
            // It sees 135° to both sides.
            expected[1].0[1] = 137.0;
        }
        assert_eq!(body.len(), expected.len(), "{model:?}: {body:?}");
        // Where a beam of a triangulating sensor goes depends on its range: by 5° from 0.3 to 0.6 m, and
        // at an edge either holds.
        let tolerance_deg = if model == Model::RplidarA3 { 3.0 } else { 1.6 };
        for (part, (ends_deg, distance_m)) in body.iter().zip(expected) {
            let found_deg = [part.from_rad, part.to_rad].map(f64::to_degrees);
            for (found, expected) in found_deg.iter().zip(ends_deg) {
                let off_deg = (found - expected).abs();
                assert!(off_deg <= tolerance_deg, "{model:?}: {found_deg:?}");
            }
            let off_m = part.nearest_m - BIAS_M - distance_m;
            assert!(off_m.abs() < 0.04, "{model:?}: {part:?}");
        }
    }
}
