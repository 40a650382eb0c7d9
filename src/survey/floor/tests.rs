use super::*;
use crate::geometry::{Body, Hall, Point, Rotation, Transform};
use crate::mapping::base::BaseSurface;
use crate::mapping::bay::Bay;
use crate::mapping::budget::CalibrationSigmas;
use crate::mapping::polygon::{Place, Polygon};
use crate::mapping::projection::LidarMount;
use crate::mapping::region::{Rect, Region};
use crate::mapping::surveyed_base::SurveyedBase;
use crate::mapping::{self, Method, field_map, grid_map};
use crate::messages::{Beam, PoseError, Scan};
use crate::stats::{Noise, SeedBook};
use nalgebra::{Matrix6, SMatrix, Vector3};

fn grid() -> GridGeometry {
    GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.5, n_cols: 40, n_rows: 25 }
}

fn seen(height_m: impl Fn(usize) -> f64) -> Floor {
    let n = grid().n_cells();
    Floor {
        grid: grid(),
        height_m: (0..n).map(height_m).collect(),
        sigma_m: vec![0.01; n],
        shared_sigma_m: 0.005,
    }
}

#[test]
fn many_noisy_looks_at_one_floor_do_not_sink_it() {
    let mut noise = SeedBook::new(4).stream("floor");
    let mut memory = FloorMemory::empty(grid());
    for day in 0..30 {
        let draws: Vec<f64> = (0..grid().n_cells()).map(|_| 0.01 * noise.normal()).collect();
        memory.take(&seen(|cell| 0.2 + draws[cell]), 20_260_301 + day);
    }
    let mean_m = memory.height_m.iter().sum::<f64>() / memory.height_m.len() as f64;
    // The plain minimum of 30 looks would lie 20 mm low.
    assert!((mean_m - 0.2).abs() < 0.002, "{mean_m}");
}

#[test]
fn what_lies_on_the_floor_is_no_floor_and_a_lower_one_is_dated() {
    let mut memory = FloorMemory::empty(grid());
    let first = memory.take(&seen(|cell| if cell < 10 { 1.0 } else { 0.0 }), 20_260_301);
    assert_eq!((first.n_new, first.n_lower), (1000, 0));
    // The heap has moved: from the first ten cells to the next ten.
    let moved = |cell| if (10..20).contains(&cell) { 1.5 } else { 0.0 };
    let second = memory.take(&seen(moved), 20_260_402);
    assert_eq!((second.n_new, second.n_lower, second.n_confirmed), (0, 10, 980));
    assert!(memory.height_m.iter().all(|height_m| height_m.abs() < 1e-12));
    let dates = [0, 15, 30].map(|cell| memory.date[cell]);
    assert!((dates[0] - 20_260_402.0).abs() < 0.5 && (dates[1] - 20_260_301.0).abs() < 0.5);
}

#[test]
fn a_memory_comes_back_from_its_folder() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut memory = FloorMemory::read(folder.path(), grid()).expect("empty");
    memory.take(&seen(|cell| if cell == 3 { f64::NAN } else { 0.125 }), 20_260_301);
    memory.write(folder.path()).expect("written");
    let again = FloorMemory::read(folder.path(), grid()).expect("a memory");
    assert!(again.height_m[3].is_nan() && again.date[3].is_nan());
    assert_eq!((&again.height_m[4..], &again.sigma_m), (&memory.height_m[4..], &memory.sigma_m));
    let other = GridGeometry { n_cols: 25, n_rows: 40, ..grid() };
    let error = FloorMemory::read(folder.path(), other).unwrap_err();
    assert!(matches!(error, FloorError::OtherCells { .. }), "{error}");
}

#[test]
fn the_level_of_ten_days_is_their_mean() {
    let mut noise = SeedBook::new(5).stream("days");
    let mut squares_m2 = 0.0;
    for _ in 0..40 {
        let mut memory = FloorMemory::empty(grid());
        let mut sum_m = 0.0;
        for day in 0..10 {
            let lift_m = 0.02 * noise.normal();
            sum_m += lift_m;
            let draws: Vec<f64> = (0..grid().n_cells()).map(|_| 0.003 * noise.normal()).collect();
            let mut floor = seen(|cell| 0.2 + lift_m + draws[cell]);
            floor.sigma_m.fill(0.003);
            floor.shared_sigma_m = 0.02;
            let learned = memory.take(&floor, 20_260_301 + day);
            // No cell is lower than ever, and none is left out as material: the floor is the same.
            let expected = if day == 0 { (1000, 0, 0) } else { (0, 0, 1000) };
            assert_eq!((learned.n_new, learned.n_lower, learned.n_confirmed), expected);
        }
        let off_m = memory.height_m.iter().sum::<f64>() / memory.height_m.len() as f64 - 0.2;
        // What is left is the noise of a median, 0.003 √(π/2000) = 0.12 mm, a few of them.
        assert!((off_m - sum_m / 10.0).abs() < 6e-4, "{off_m} {sum_m}");
        squares_m2 += off_m * off_m;
        // The same vehicle may bring the same error every day.
        assert!((memory.level.expect("seen").sigma_m - 0.02).abs() < 1e-12);
    }
    // 0.02/√10 = 6.3 mm; the minimum of ten would lie 31 mm low.
    let rms_m = (squares_m2 / 40.0).sqrt();
    assert!((0.004..0.009).contains(&rms_m), "{rms_m}");
}

#[test]
fn a_heap_over_most_of_the_floor_does_not_lift_its_level() {
    let mut memory = FloorMemory::empty(grid());
    memory.take(&seen(|_| 0.0), 20_260_301);
    // Three quarters lie under material, the rest is seen 8 mm low, and ten cells have sunk.
    let later = seen(|cell| match cell {
        0..750 => 0.4,
        990.. => -0.508,
        _ => -0.008,
    });
    let learned = memory.take(&later, 20_260_302);
    assert_eq!((learned.n_lower, learned.n_confirmed), (10, 240));
    let level_m = learned.level_m.expect("240 cells are common");
    // Of the eight, the median's own noise of 1.1 mm explains 3 %.
    assert!((level_m + 0.008).abs() < 3e-4, "{level_m}");
    // Both levels weigh alike, so they meet in the middle, covered cells included.
    assert!((memory.height_m[0] - 0.5 * level_m).abs() < 1e-12);
    assert!((memory.height_m[800] + 0.004).abs() < 3e-4, "{}", memory.height_m[800]);
    assert!((memory.height_m[995] + 0.504).abs() < 3e-4, "{}", memory.height_m[995]);
}

#[test]
fn floors_beside_each_other_are_no_better_known_than_the_worse() {
    let mut memory = FloorMemory::empty(grid());
    memory.take(&seen(|cell| if cell < 500 { 0.0 } else { f64::NAN }), 20_260_301);
    let mut other = seen(|cell| if cell < 490 { f64::NAN } else { 0.012 });
    other.shared_sigma_m = 0.009;
    let learned = memory.take(&other, 20_260_302);
    assert_eq!((learned.n_new, learned.n_confirmed, learned.level_m), (500, 10, None));
    assert!((memory.level.expect("seen").sigma_m - 0.009).abs() < 1e-15);
    assert!(memory.height_m[0].abs() < 1e-15 && (memory.height_m[999] - 0.012).abs() < 1e-15);
}

#[test]
fn a_level_comes_back_and_one_that_is_none_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut memory = FloorMemory::empty(grid());
    for day in 1..=3 {
        memory.take(&seen(|_| 0.125), 20_260_300 + day);
    }
    memory.write(folder.path()).expect("written");
    assert_eq!(FloorMemory::read(folder.path(), grid()).expect("a memory").level, memory.level);
    let file = folder.path().join("lowest-level.toml");
    fs::write(&file, "sigma_m = -1.0\nweight_per_m2 = 1.0\n").expect("written");
    let error = FloorMemory::read(folder.path(), grid()).unwrap_err().to_string();
    assert!(error.contains("lowest-level.toml"), "{error}");
    // Folders from before there was such a file count as a base without a word of its σ: 1 cm.
    fs::remove_file(&file).expect("removed");
    let level = FloorMemory::read(folder.path(), grid()).expect("a memory").level.expect("assumed");
    assert!((level.sigma_m - 0.01).abs() < 1e-15 && (level.weight_per_m2 - 1e4).abs() < 1e-6);
}

/// A hall of 4 m × 4 m whose floor is surveyed from 3 m above.
fn mapper(base: BaseSurface) -> Mapper {
    let bounds = Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 4.0, y_max_m: 4.0 };
    let bay = Bay { name: "hall".to_owned(), outline: Polygon::from(bounds), base, density: None };
    let calibration = CalibrationSigmas { range_bias_m: 0.004, ..CalibrationSigmas::default() };
    Mapper::new(mapping::Settings {
        method: Method::MaternField,
        region: Region { bounds, exclusions: Vec::new(), exclusion_margin_m: 0.0, bays: vec![bay] },
        cell_m: 0.4,
        base_height_m: 0.0,
        obstacles: Vec::new(),
        below_base_m: 0.5,
        max_height_m: 2.0,
        lidar: LidarMount {
            body_from_lidar: Transform::new(
                Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0),
                Point::origin(),
            ),
            range_sigma_m: 0.01,
            angle_sigma_rad: 0.001,
            min_range_m: 0.1,
            max_range_m: 12.0,
            blind_sectors_rad: Vec::new(),
        },
        grid: grid_map::Settings::default(),
        field: field_map::Settings { range_m: 1.5, calibration, ..Default::default() },
        max_position_sigma_m: 0.2,
    })
}

/// σ of the pose's height, and how it is passed on from turn to turn.
const HEIGHT_SIGMA_M: f64 = 0.02;
const PASSED_ON: f64 = 0.9;

fn pose_cov() -> SMatrix<f64, 15, 15> {
    let mut cov = SMatrix::identity() * 1e-10;
    cov[(2, 2)] = HEIGHT_SIGMA_M * HEIGHT_SIGMA_M;
    cov
}

fn pose_error(at: Stamp<Mono>, _: Option<Stamp<Mono>>) -> Option<PoseError> {
    Some(PoseError {
        at,
        cov: pose_cov(),
        from_previous: SMatrix::identity() * PASSED_ON,
        velocity_mps: Vector3::zeros(),
        rate_radps: Vector3::zeros(),
        tags: Vec::new(),
    })
}

/// Flies over the level floor to the east as far as `to_x_m`, with errors of pose and ranges drawn from
/// their σ; without noise exactly.
#[expect(clippy::cast_possible_truncation, reason = "beams are single precision")]
fn flown(mut mapper: Mapper, to_x_m: f64, noise: &mut Option<Noise>) -> Mapper {
    let mut normal = || noise.as_mut().map_or(0.0, Noise::normal);
    let range_bias_m = 0.004 * normal();
    let mut error_m = HEIGHT_SIGMA_M * normal();
    let cov = pose_cov().fixed_view::<6, 6>(0, 0).into_owned();
    for step in 0..60_u32 {
        let x_m = 0.05 + 0.066 * f64::from(step);
        if x_m > to_x_m {
            break;
        }
        let believed: Transform<Hall, Body> =
            Transform::new(Rotation::identity(), Point::new(x_m, 2.0, 3.0 + error_m));
        let beams = (-40..=40)
            .map(|k| {
                let angle_rad = f64::from(k) * 0.0155;
                let range_m = 3.0 / angle_rad.cos() + range_bias_m + 0.01 * normal();
                let (angle_rad, range_m) = (angle_rad as f32, range_m as f32);
                Beam { offset_ns: 0, angle_rad, range_m, intensity: 1 }
            })
            .collect();
        let start = Stamp::from_nanos(i64::from(step) * 100_000_000);
        let pose: (_, Matrix6<f64>) = (believed, cov);
        mapper.insert(&Scan { start, beams }, |_| Some(pose), pose_error);
        error_m =
            PASSED_ON * error_m + (1.0 - PASSED_ON * PASSED_ON).sqrt() * HEIGHT_SIGMA_M * normal();
    }
    mapper
}

/// Variance of the volume over a floor as a base, as a later survey counts it.
fn base_var_m6(floor: &Floor) -> f64 {
    let Floor { grid, height_m, sigma_m, shared_sigma_m } = floor.clone();
    let is_known = |cell: &usize| height_m[*cell].is_finite();
    let areas: Vec<(Place, f64)> = (0..grid.n_cells())
        .filter(is_known)
        .map(|cell| (grid.centre_m(cell), grid.cell_area_m2()))
        .collect();
    let base = SurveyedBase::new(grid, height_m, sigma_m, shared_sigma_m).expect("a base");
    let errors = BaseSurface::Survey(base).errors(&areas);
    errors.iter().map(|(by, sigma)| (by * sigma).powi(2)).sum()
}

#[test]
fn the_volume_of_a_floor_has_the_uncertainty_of_its_survey() {
    let at = Stamp::from_nanos(10_000_000_000);
    let exact = || mapper(BaseSurface::level(0.0));
    let floor = floor_of(flown(exact(), 4.0, &mut None), at).expect("solved");
    assert!(floor.height_m.iter().all(|height_m| height_m.abs() < 2e-3), "{floor:?}");
    let account =
        |mapper: Mapper| mapper.snapshot(at, true).run().expect("solved").accounts[0].clone();
    let survey = account(flown(exact(), 4.0, &mut None));
    let claimed_m6 = base_var_m6(&floor);
    // A base is taken at the cells' centres, a volume over a level from their means: nearly the same.
    assert!((claimed_m6 / survey.budget.var_m6() - 1.0).abs() < 0.03, "{claimed_m6} {survey:?}");
    // What the floor lay on when it was surveyed is no error of its heights.
    let over_unsure = mapper(BaseSurface::Level { height_m: 0.0, sigma_m: 0.5 });
    let same = floor_of(flown(over_unsure, 4.0, &mut None), at).expect("solved");
    assert!((same.shared_sigma_m - floor.shared_sigma_m).abs() < 1e-9, "{}", same.shared_sigma_m);
    // Surveys with errors drawn: their volumes scatter by what is claimed.
    let n_surveys = 150_u32;
    let mut noise = Some(SeedBook::new(31).stream("floors"));
    let squares_m6: f64 = (0..n_surveys)
        .map(|_| account(flown(exact(), 4.0, &mut noise)).estimate.volume_m3)
        .map(|volume_m3| (volume_m3 - survey.estimate.volume_m3).powi(2))
        .sum();
    let ratio = squares_m6 / f64::from(n_surveys) / claimed_m6;
    // χ² with 150 degrees of freedom: ±3σ is ±35 %.
    assert!((0.65..1.35).contains(&ratio), "scatter over claim: {ratio}");
}

#[test]
fn ground_that_the_survey_missed_is_no_part_of_its_level() {
    let at = Stamp::from_nanos(10_000_000_000);
    let of = |to_x_m| {
        let mapper = flown(mapper(BaseSurface::level(0.0)), to_x_m, &mut None);
        floor_of(mapper, at).expect("solved")
    };
    let (whole, half) = (of(4.0), of(2.0));
    let n_known = half.height_m.iter().filter(|height_m| height_m.is_finite()).count();
    assert!((40..75).contains(&n_known), "{n_known} of 100");
    // Half the flight averages half as many errors of the pose; the prior of unseen ground would make
    // it tens of times as much. Less of the floor also tells less of how smooth it is: some per cent either way.
    let ratio = half.shared_sigma_m / whole.shared_sigma_m;
    assert!((0.9..2.0).contains(&ratio), "{ratio}");
}
