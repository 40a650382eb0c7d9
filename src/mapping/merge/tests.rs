//! One flight split over two maps against the same flight as one map, and shared errors.

use super::super::projection::LidarMount;
use super::super::region::{Rect, Region};
use super::super::{SolvedSurface, field_map, grid_map};
use super::*;
use crate::geometry::{Body, Hall, Point, Rotation, Transform};
use crate::mapping::budget::CalibrationSigmas;
use crate::messages::{Beam, BudgetSource, PoseError, Scan, VolumeBudget};
use crate::stats::SeedBook;
use crate::time::{Mono, Stamp};
use nalgebra::{Matrix6, SMatrix, Vector3};
use std::time::Duration;

fn settings() -> Settings {
    Settings {
        method: Method::MaternField,
        region: Region {
            bounds: Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 6.0, y_max_m: 5.0 },
            exclusions: Vec::new(),
            exclusion_margin_m: 0.0,
            bays: Vec::new(),
        },
        obstacles: Vec::new(),
        cell_m: 0.25,
        base_height_m: 0.0,
        below_base_m: 0.5,
        max_height_m: 4.0,
        lidar: LidarMount {
            body_from_lidar: Transform::new(
                Rotation::from_euler_rad(0.02, 1.55, 0.01),
                Point::new(0.05, 0.0, -0.04),
            ),
            range_sigma_m: 0.01,
            angle_sigma_rad: 0.002,
            min_range_m: 0.1,
            max_range_m: 12.0,
            blind_sectors_rad: Vec::new(),
        },
        grid: grid_map::Settings::default(),
        field: field_map::Settings {
            range_m: 2.0,
            calibration: CalibrationSigmas {
                range_bias_m: 0.01,
                range_scale: 0.001,
                mount_position_m: 0.005,
                mount_rotation_rad: 0.003,
                clock_offset_s: 0.002,
                tag_place_m: 0.005,
                tag_datum_m: 0.0,
            },
            ..Default::default()
        },
        max_position_sigma_m: 0.2,
    }
}

/// A floor with a slope and waves.
fn height_m(x: f64, y: f64) -> f64 {
    0.8 + 0.1 * x + 0.25 * (1.1 * x).sin() * (0.9 * y).cos()
}

fn pose(turn: u32) -> Transform<Hall, Body> {
    let x = 0.1 + 0.1 * f64::from(turn);
    let roll = 0.03 * (0.3 * f64::from(turn)).sin();
    Transform::new(Rotation::from_euler_rad(roll, -0.02, 0.1), Point::new(x, 2.4, 5.1))
}

fn at(turn: u32) -> Stamp<Mono> {
    Stamp::ZERO.plus(Duration::from_millis(100 * u64::from(turn)))
}

/// Turns of a noisy scanner, by a search along each beam.
#[expect(clippy::cast_possible_truncation, reason = "test angles")]
fn scans(settings: &Settings) -> Vec<Scan> {
    let mut noise = SeedBook::new(5).stream("ranges");
    let mut scan = |turn| {
        let hall_from_lidar = pose(turn) * settings.lidar.body_from_lidar;
        let beams = (-50..=50).map(|k| {
            let angle = 0.0137 * f64::from(k);
            let along = Vector3::new(angle.cos(), angle.sin(), 0.0);
            let above_m = |range_m: f64| {
                let p = (hall_from_lidar * Point::from_coords(along * range_m)).coords;
                p.z - height_m(p.x, p.y)
            };
            let (mut low, mut high) = (0.0, 12.0);
            for _ in 0..50 {
                let middle = f64::midpoint(low, high);
                if above_m(middle) > 0.0 { low = middle } else { high = middle }
            }
            let range_m = (low + 0.01 * noise.normal()) as f32;
            Beam { offset_ns: 0, angle_rad: angle as f32, range_m, intensity: 1 }
        });
        Scan { start: at(turn), beams: beams.collect() }
    };
    (0..58).map(&mut scan).collect()
}

/// Errors of the pose that fade from turn to turn, and nothing of one lives on from turn 28 to 29.
fn pose_error(now: Stamp<Mono>, previous: Option<Stamp<Mono>>) -> Option<PoseError> {
    let is_cut = now == at(29) || previous.is_none();
    let keeps = if is_cut { 0.0 } else { 0.9 };
    Some(PoseError {
        at: now,
        cov: SMatrix::identity() * 4e-5,
        from_previous: SMatrix::identity() * keeps,
        velocity_mps: Vector3::new(1.0, 0.1, 0.0),
        rate_radps: Vector3::new(0.02, 0.0, 0.1),
        tags: Vec::new(),
    })
}

/// A map of some of the scans.
fn map_of(settings: &Settings, scans: &[Scan]) -> Mapper {
    let mut mapper = Mapper::new(settings.clone());
    for scan in scans {
        let turn = u32::try_from(scan.start.nanos() / 100_000_000).expect("few turns");
        let with_cov = |_| Some((pose(turn), Matrix6::identity() * 4e-5));
        mapper.insert(scan, with_cov, pose_error);
    }
    mapper
}

fn solved(mapper: &Mapper) -> SolvedSurface {
    mapper.snapshot(at(100), true).run().expect("solved")
}

fn joined(settings: &Settings, maps: &[(usize, &Mapper)]) -> Result<Mapper, MergeError> {
    let flights: Vec<FlightTurns<'_>> = maps
        .iter()
        .map(|(vehicle_idx, map)| FlightTurns {
            settings,
            vehicle_idx: *vehicle_idx,
            turns: map.turns(),
        })
        .collect();
    merged(&flights)
}

#[test]
fn a_split_flight_merged_is_the_joint_solution() {
    let settings = settings();
    let scans = scans(&settings);
    let joint = solved(&map_of(&settings, &scans));
    let halves = [&scans[..29], &scans[29..]].map(|part| map_of(&settings, part));
    let merged = solved(&joined(&settings, &[(0, &halves[0]), (0, &halves[1])]).expect("fits"));
    // Sums in the same order: equal to rounding of nothing at all; 1e-9 leaves room for a solver.
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * a.abs().max(1e-6);
    for (a, b) in std::iter::zip(&joint.surface.mean_m, &merged.surface.mean_m) {
        assert!(near(*a, *b), "{a} {b}");
    }
    let (ours, theirs) = (&merged.accounts[0], &joint.accounts[0]);
    assert!(near(ours.estimate.volume_m3, theirs.estimate.volume_m3));
    assert!(near(ours.estimate.sigma_m3, theirs.estimate.sigma_m3));
    for source in BudgetSource::ALL {
        let (a, b) = (ours.budget.var_of_m6(source), theirs.budget.var_of_m6(source));
        assert!(near(a, b), "{source:?}: {a} {b}");
    }
    assert!(ours.budget.var_of_m6(BudgetSource::Pose) > 0.0);

    // Neither half alone is the whole: the comparison can fail.
    let half = solved(&halves[0]);
    assert!(half.accounts[0].estimate.sigma_m3 > 2.0 * ours.estimate.sigma_m3);
}

#[test]
fn information_of_parts_adds_up_to_that_of_the_whole() {
    use super::super::datum::{Linearization, Turn};
    use super::super::matern_field::{Information, Lattice};
    let settings = settings();
    let scans = scans(&settings);
    let whole = map_of(&settings, &scans);
    let halves = [&scans[..29], &scans[29..]].map(|part| map_of(&settings, part));
    let lattice = Lattice::covering(&settings.region.grid(0.25), 5.0, |_, _| false);
    let heights: Vec<f64> = (0..lattice.n_nodes())
        .map(|node| lattice.place_m(node))
        .map(|(x, y)| height_m(x, y))
        .collect();
    let lidars = [settings.lidar.clone()];
    let at = Linearization {
        lattice: &lattice,
        heights_m: Some(&heights),
        is_known: &[],
        lidars: &lidars,
        n_patches: &[],
        roughness_m: 0.02,
        scatter_m: 0.0,
        slope_sigma: 0.6,
        occlusion_share: 0.3,
    };
    let information = |map: &Mapper| {
        let mut sum = Information::new(&lattice);
        for footprint in map.turns() {
            let turn = Turn::new(footprint, at).expect("the LiDAR");
            for datum in footprint.patches.iter().filter_map(|patch| turn.datum(patch)) {
                sum.add(&datum.row, datum.height_m, datum.weight_per_m2);
            }
        }
        sum
    };
    let mut added = information(&halves[0]);
    added.merge(&information(&halves[1])).expect("one lattice");
    let all = information(&whole);
    for node in 0..lattice.n_nodes() {
        let (a, b) = (added.info_per_m2(node), all.info_per_m2(node));
        assert!((a - b).abs() <= 1e-12 * a.max(1.0), "{node}: {a} {b}");
    }
}

#[test]
fn what_is_shared_stays_shared_and_what_is_not_becomes_independent() {
    let settings = settings();
    let scans = scans(&settings);
    // The same ground twice over: once as two flights of a vehicle, once of two vehicles.
    let first = map_of(&settings, &scans);
    let second = map_of(&settings, &scans);
    let [shared, apart] = [0, 1].map(|vehicle| {
        let map = joined(&settings, &[(0, &first), (vehicle, &second)]).expect("fits");
        solved(&map).accounts.remove(0).budget
    });
    let alone = solved(&first).accounts.remove(0).budget;
    let ratio =
        |a: &VolumeBudget, b: &VolumeBudget, source| a.var_of_m6(source) / b.var_of_m6(source);
    for source in [BudgetSource::RangeBias, BudgetSource::LidarMounting] {
        // Each flight has half of the weight: (½)² + (½)² against (½ + ½)².
        assert!((ratio(&apart, &shared, source) - 0.5).abs() < 0.01, "{source:?}");
        assert!((ratio(&shared, &alone, source) - 1.0).abs() < 0.02, "{source:?}");
    }
    // Pose errors are new in every flight, of whatever vehicle.
    for both in [&shared, &apart] {
        let pose = ratio(both, &alone, BudgetSource::Pose);
        assert!((pose - 0.5).abs() < 0.03, "{pose}");
    }
    let n_mounting = |budget: &VolumeBudget| {
        budget.shared.iter().filter(|item| item.source == BudgetSource::LidarMounting).count()
    };
    assert_eq!((n_mounting(&shared), n_mounting(&apart)), (6, 12));
}

#[test]
fn flights_that_do_not_fit_are_refused_with_the_reason() {
    let settings = settings();
    let map = map_of(&settings, &scans(&settings)[..2]);
    let refusal = |change: fn(&mut Settings)| {
        let mut other = settings.clone();
        change(&mut other);
        let flight = |settings| FlightTurns { settings, vehicle_idx: 0, turns: map.turns() };
        merged(&[flight(&settings), flight(&other)]).expect_err("does not fit").to_string()
    };
    assert_eq!(
        refusal(|s| s.cell_m = 0.2),
        "flight 1 has another cell size than the first: they have no common map"
    );
    assert!(refusal(|s| s.region.bounds.x_max_m = 7.0).contains("another region"));
    assert!(refusal(|s| s.field.nugget_m = 0.03).contains("surface.field"));
    assert!(refusal(|s| s.field.calibration.range_bias_m = 0.02).contains("surface.uncertainty"));
    assert!(refusal(|s| s.lidar.range_sigma_m = 0.02).contains("its LiDAR is another"));
    assert_eq!(merged(&[]).expect_err("nothing"), MergeError::NoFlight);
    let grid = Settings { method: Method::KalmanGrid, ..settings.clone() };
    let of_grid = FlightTurns { settings: &grid, vehicle_idx: 0, turns: &[] };
    assert_eq!(merged(&[of_grid]).expect_err("the paper's"), MergeError::Method);
}
