//! Bays, bases, walls and exclusions from the configuration file to the volume, each against its
//! closed form.
//!
//! ```text
//!  y ▲ 8 ┌──────────┬┬──────────┐
//!    │   │  plane   ││  triang. │   left of the wall the material stands 2.0 m high and level,
//!    │ 4 ├──────────┤│──────────┤   right of it 0.8 m and rising by 5 cm per metre
//!    │   │  level   ││  survey ◣│   ◣ a machine that is no material
//!    │ 0 └──────────┴┴──────────┘
//!    └───────────────5─────────10──▶ x
//! ```

use nalgebra::{Matrix6, SMatrix, Vector3};
use std::path::Path;
use std::time::Duration;
use stockpilot::config::{Config, load};
use stockpilot::geometry::{Point, Rotation, Transform};
use stockpilot::mapping::{Mapper, Settings};
use stockpilot::messages::{Beam, BudgetSource, PoseError, Scan, VolumeAccount};
use stockpilot::time::Stamp;

const EXAMPLE: &str = include_str!("../../deploy/config.example.toml");

/// A wall 0.2 m thick, thinner than a cell, over the border of the bays.
const SECTIONS: &str = r#"
[[exclusions]]
rect = { x_min_m = 4.9, y_min_m = 0.0, x_max_m = 5.1, y_max_m = 8.0 }
[[exclusions]]
polygon_m = [[9.0, 0.0], [10.0, 0.0], [10.0, 2.0]]
[[bays]]
name = "level"
polygon_m = [[0.0, 0.0], [5.0, 0.0], [5.0, 4.1], [0.0, 3.9]]
base = { kind = "level", height_m = 0.1, sigma_m = 0.02 }
density_t_per_m3 = 1.5
density_sigma_t_per_m3 = 0.0
[[bays]]
name = "plane"
polygon_m = [[0.0, 3.9], [5.0, 4.1], [5.0, 8.0], [0.0, 8.0]]
base = { kind = "plane", pivot_m = [2.0, 6.0], height_m = 0.3, slope = [0.0, 0.1], sigma_m = 0.01, slope_sigma = 0.002 }
[[bays]]
name = "survey"
polygon_m = [[5.0, 0.0], [10.0, 0.0], [10.0, 4.0], [5.0, 4.0]]
base = { kind = "survey", height_file = "floor.asc", cell_sigma_m = 0.0, sigma_m = 0.015 }
[[bays]]
name = "triangulated"
polygon_m = [[5.0, 4.0], [10.0, 4.0], [10.0, 8.0], [5.0, 8.0]]
[bays.base]
kind = "triangulated"
points_m = [[5.0, 4.0, 0.1], [10.0, 4.0, 0.2], [10.0, 8.0, 0.6], [5.0, 8.0, 0.5]]
sigma_m = 0.005
point_sigma_m = 0.0
"#;

/// The file in a folder, loaded as the program does.
fn config() -> Config {
    let region = "region = { x_min_m = 0.0, y_min_m = 0.0, x_max_m = 20.0, y_max_m = 20.0 }";
    assert!(EXAMPLE.contains(region), "the example's region");
    let smaller = region.replace("20.0", "10.0").replace("y_max_m = 10.0", "y_max_m = 8.0");
    let text = EXAMPLE
        .replace(region, &smaller)
        .replace("range_m = 5.0\nsigma_m = 1.0", "range_m = 2.0\nsigma_m = 1.0");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hall.toml");
    std::fs::write(&path, format!("{text}\n{SECTIONS}")).unwrap();
    std::fs::write(folder.path().join("floor.asc"), floor_grid()).unwrap();
    load(&path, &[]).unwrap()
}

/// The floor of the third bay as an earlier survey had it: 0.2 + 0.04 x − 0.02 y at the centres of
/// cells of 0.5 m.
fn floor_grid() -> String {
    let mut text = "ncols 12\nnrows 10\nxllcorner 4.5\nyllcorner -0.5\ncellsize 0.5\n".to_owned();
    for row in (0..10_u32).rev() {
        let height_m = |col: u32| {
            let (x, y) = (4.75 + 0.5 * f64::from(col), -0.25 + 0.5 * f64::from(row));
            floor_m(x, y).to_string()
        };
        text += &((0..12).map(height_m).collect::<Vec<_>>().join(" ") + "\n");
    }
    text
}

fn floor_m(x: f64, y: f64) -> f64 {
    0.2 + 0.04 * x - 0.02 * y
}

/// The top of the material.
fn surface_m(x: f64, _y: f64) -> f64 {
    if x < 5.0 { 2.0 } else { 0.8 + 0.05 * (x - 5.0) }
}

/// Legs along y over all of it, beams nearly straight down and free of noise.
#[expect(clippy::cast_possible_truncation, reason = "beams are single precision")]
fn fly(settings: &Settings) -> Mapper {
    let mut mapper = Mapper::new(settings.clone());
    let mount = settings.lidar.body_from_lidar;
    let mut n_turns = 0_u32;
    for leg in 0..20_u32 {
        for step in 0..54_u32 {
            let (x, y) = (0.25 + 0.5 * f64::from(leg), 0.05 + 0.15 * f64::from(step));
            // Turned by 90°: the fan lies along x.
            let pose = Transform::new(
                Rotation::from_euler_rad(0.0, 0.0, std::f64::consts::FRAC_PI_2),
                Point::new(x, y, 6.0),
            );
            let from = pose * mount;
            let beam = |k: i32| {
                let angle = f64::from(k) * 0.012;
                let to = from * Point::new(angle.cos(), angle.sin(), 0.0);
                let along = to.coords - from.origin.coords;
                let reach_m = |z: f64| (z - from.origin.coords.z) / along.z;
                // The surface is flat enough for a few steps of fixed-point iteration.
                let mut range_m = 4.0;
                for _ in 0..20 {
                    let p = from.origin.coords + along * range_m;
                    range_m = reach_m(surface_m(p.x, p.y));
                }
                let p = from.origin.coords + along * range_m;
                let is_clear = (p.x - 5.0).abs() > 0.15;
                is_clear.then_some(Beam {
                    offset_ns: 0,
                    angle_rad: angle as f32,
                    range_m: range_m as f32,
                    intensity: 1,
                })
            };
            let start = Stamp::ZERO.plus(Duration::from_millis(100 * u64::from(n_turns)));
            n_turns += 1;
            let scan = Scan { start, beams: (-6..=6).filter_map(beam).collect() };
            mapper.insert(&scan, |_| Some((pose, Matrix6::identity() * 1e-8)), pose_error);
        }
    }
    mapper
}

fn pose_error(
    at: Stamp<stockpilot::time::Mono>,
    _: Option<Stamp<stockpilot::time::Mono>>,
) -> Option<PoseError> {
    Some(PoseError {
        at,
        cov: SMatrix::identity() * 1e-8,
        from_previous: SMatrix::zeros(),
        velocity_mps: Vector3::zeros(),
        rate_radps: Vector3::zeros(),
        tags: Vec::new(),
    })
}

#[test]
fn every_bay_of_the_file_has_the_volume_of_its_closed_form() {
    let config = config();
    let settings = config.pilot_settings().unwrap().mapping;
    let solved = fly(&settings).snapshot(Stamp::ZERO, true).run().unwrap();
    let of = |name: &str| -> &VolumeAccount {
        solved.accounts.iter().find(|account| account.name == name).unwrap()
    };
    // Left of the wall 4.9 m of x count. The slanted border is at y = 3.9 + 0.04 x.
    let level_area_m2 = 4.9 * 3.9 + 0.02 * 4.9_f64.powi(2);
    let plane_area_m2 = 4.9 * 8.0 - level_area_m2;
    // ∫ (y − 6) dA over the second bay: (2² − (0.04 x − 2.1)²)/2 along x.
    let primitive = |x: f64| (0.04 * x - 2.1_f64).powi(3) / 0.12;
    let plane_moment_m3 = 0.5 * (4.0 * 4.9 - (primitive(4.9) - primitive(0.0)));
    let level_m3 = 1.9 * level_area_m2;
    let plane_m3 = 1.7 * plane_area_m2 - 0.1 * plane_moment_m3;
    // Right of the wall x runs from 5.1 to 10, 7.55 on average. The surface is 0.55 + 0.05 x.
    let survey_strip_m3 = 4.9 * 4.0 * (0.35 + 0.01 * 7.55 + 0.02 * 2.0);
    // The machine: 1 m² with its middle at (29/3, 2/3).
    let machine_m3 = 0.35 + 0.01 * 29.0 / 3.0 + 0.02 * 2.0 / 3.0;
    let survey_m3 = survey_strip_m3 - machine_m3;
    // The measured outline is the plane 0.1 + 0.02 (x − 5) + 0.1 (y − 4).
    let triangulated_m3 = 4.9 * 4.0 * (0.55 + 0.05 * 7.55 - 0.1 - 0.02 * 2.55 - 0.1 * 2.0);
    let expected = [
        ("level", level_m3),
        ("plane", plane_m3),
        ("survey", survey_m3),
        ("triangulated", triangulated_m3),
        ("hall", level_m3 + plane_m3 + survey_m3 + triangulated_m3),
    ];
    for (name, expected_m3) in expected {
        let volume_m3 = of(name).estimate.volume_m3;
        // 2 mm of height over 20 m²: what the prior takes where the field ends at walls.
        let tolerance_m3 = if name == "hall" { 0.16 } else { 0.04 };
        assert!(
            (volume_m3 - expected_m3).abs() < tolerance_m3,
            "{name}: {volume_m3} against {expected_m3}"
        );
    }
    // Touching piles of 2.0 and 0.8 m: neither leaks over the wall.
    let height_m = |x: f64, y: f64| {
        let grid = &solved.surface.grid;
        solved.surface.mean_m[grid.cell_at(x, y).unwrap()]
    };
    assert!((height_m(4.7, 3.0) - 2.0).abs() < 0.01, "{}", height_m(4.7, 3.0));
    assert!((height_m(5.3, 3.0) - 0.815).abs() < 0.01, "{}", height_m(5.3, 3.0));
    // The base's error is its σ over the area that counts; tonnes follow the density alone.
    let base_sigma_m3 = |name: &str| of(name).budget.var_of_m6(BudgetSource::Base).sqrt();
    assert!((base_sigma_m3("level") - 0.02 * level_area_m2).abs() < 1e-6);
    assert!((base_sigma_m3("survey") - 0.015 * 18.6).abs() < 1e-6);
    assert!((base_sigma_m3("triangulated") - 0.005 * 19.6).abs() < 1e-6);
    let slopes_m3 = 0.01_f64 * plane_area_m2;
    assert!(base_sigma_m3("plane") > slopes_m3, "the slopes add to the level");
    let mass = of("level").mass.unwrap();
    assert!((mass.mass_t - 1.5 * of("level").estimate.volume_m3).abs() < 1e-9);
    assert!(of("plane").mass.is_none() && of("hall").mass.is_none());
}

#[test]
fn the_printed_configuration_gives_the_same_bays_without_its_files() {
    let config = config();
    let again = Config::from_toml(&config.to_toml().unwrap(), Path::new("log")).unwrap();
    let settings = |config: &Config| config.pilot_settings().unwrap().mapping;
    assert_eq!(settings(&again), settings(&config));
}
