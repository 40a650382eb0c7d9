use super::super::VolumeVariance;
use super::super::bay::Bay;
use super::super::polygon::Polygon;
use super::super::region::Rect;
use super::*;
use crate::geometry::{Point, Rotation};
use nalgebra::{Matrix3, SMatrix, Vector3};

fn settings(method: Method) -> Settings {
    settings_over(method, Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 6.0, y_max_m: 6.0 })
}

/// Of a map over these bounds.
pub(crate) fn settings_over(method: Method, bounds: Rect) -> Settings {
    Settings {
        method,
        region: Region {
            bounds,
            exclusions: Vec::new(),
            exclusion_margin_m: 0.0,
            bays: Vec::new(),
        },
        cell_m: 0.25,
        base_height_m: 0.0,
        obstacles: Vec::new(),
        below_base_m: 0.5,
        max_height_m: 4.0,
        lidar: LidarMount {
            body_from_lidar: Transform::new(
                Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0),
                Point::origin(),
            ),
            range_sigma_m: 0.01,
            angle_sigma_rad: 0.002,
            min_range_m: 0.1,
            max_range_m: 12.0,
            blind_sectors_rad: vec![(2.6, 3.2)],
        },
        grid: grid_map::Settings::default(),
        field: field_map::Settings::default(),
        max_position_sigma_m: 0.2,
    }
}

fn pose_error(at: Stamp<Mono>, _: Option<Stamp<Mono>>) -> Option<PoseError> {
    Some(PoseError {
        at,
        cov: SMatrix::identity() * 1e-6,
        from_previous: SMatrix::zeros(),
        velocity_mps: Vector3::zeros(),
        rate_radps: Vector3::zeros(),
        tags: Vec::new(),
    })
}

/// A sweep over a level surface at 1.2 m, every beam exact.
fn sweep(mapper: &mut Mapper) {
    sweep_to(mapper, 1e-6, |angle: f64| 4.0 / angle.cos());
}

/// A sweep 5.2 m above the floor from x = 0 to 6 at y = 3, its beams in the plane across, by angle
/// from straight down; with this variance of all that a pose consists of, m² and rad².
#[expect(clippy::cast_possible_truncation, reason = "test angles")]
fn sweep_to(mapper: &mut Mapper, pose_var: f64, range_m: impl Fn(f64) -> f64) {
    for step in 0..60 {
        let x = 0.05 + f64::from(step) * 0.1;
        let pose = Transform::new(Rotation::identity(), Point::new(x, 3.0, 5.2));
        let beams = (-60..=60)
            .map(|k| {
                let angle = f64::from(k) * 0.0125;
                let range_m = range_m(angle) as f32;
                Beam { offset_ns: 0, angle_rad: angle as f32, range_m, intensity: 1 }
            })
            .collect();
        let scan = Scan { start: Stamp::ZERO, beams };
        mapper.insert(&scan, |_| Some((pose, Matrix6::identity() * pose_var)), pose_error);
    }
}

#[test]
fn a_level_surface_has_the_volume_of_its_box() {
    for method in [Method::KalmanGrid, Method::MaternField] {
        let mut mapper = Mapper::new(settings(method));
        sweep(&mut mapper);
        let solved = mapper.snapshot(Stamp::ZERO, true).run().expect("solved");
        let hall = &solved.accounts[0];
        // 6 × 6 × 1.2 = 43.2 m³; the grid's prior pulls each cell by less than 1 %.
        assert!((hall.estimate.volume_m3 - 43.2).abs() < 0.43, "{method:?} {hall:?}");
        assert!(hall.estimate.coverage_ratio > 0.95);
        let sigma_m3 = hall.budget.var_m6().sqrt();
        assert!((hall.estimate.sigma_m3 - sigma_m3).abs() < 1e-9 * sigma_m3);
    }
}

#[test]
fn floor_beyond_the_border_does_not_drag_the_material_down() {
    // The material ends at the region's borders; beams that pass over those end on the floor beyond,
    // 1.2 m lower, and pass where the material's surface would go on. Where poses are poor, no hit of
    // the outermost half cell is used.
    for (pose_var, most_m) in [(1e-6, 0.001), (3e-3, 0.002)] {
        let mut mapper = Mapper::new(settings(Method::MaternField));
        let is_inside = |angle: f64| (4.0 * angle.tan()).abs() < 3.0;
        sweep_to(&mut mapper, pose_var, |angle| {
            let below_m = if is_inside(angle) { 4.0 } else { 5.2 };
            below_m / angle.cos()
        });
        let solved = mapper.snapshot(Stamp::ZERO, true).run().expect("solved");
        for row in [0, 23] {
            let of_row = &solved.surface.mean_m[24 * row..24 * (row + 1)];
            let mean_m = of_row.iter().sum::<f64>() / 24.0;
            assert!((mean_m - 1.2).abs() < most_m, "{pose_var}: row {row}: {mean_m} m");
        }
        let volume_m3 = solved.accounts[0].estimate.volume_m3;
        assert!((volume_m3 - 43.2).abs() < 0.005, "{pose_var}: {volume_m3} m³");
    }
}

#[test]
fn a_hit_counts_from_3_sigma_inside_the_border_on_or_from_half_a_cell() {
    let field = Mapper::new(settings(Method::MaternField));
    let paper = Mapper::new(settings(Method::KalmanGrid));
    let hit = |x: f64, y: f64, sigma_x_m: f64, sigma_y_m: f64| Hit {
        place: Point::new(x, y, 1.0),
        cov_m2: Matrix3::from_diagonal(&Vector3::new(sigma_x_m, sigma_y_m, 1.0).map(|s| s * s)),
    };
    // (distance from the border, σ along x, σ along y, is used)
    for (at_m, sigma_x_m, sigma_y_m, is_used) in [
        (0.031, 0.01, 0.0, true),
        (0.029, 0.01, 0.0, false),
        (0.031, 0.0, 0.01, true),
        (0.029, 0.0, 0.01, false),
        (0.126, 0.1, 0.0, true),
        (0.124, 0.1, 0.0, false),
        (0.001, 0.0, 0.0, true),
        (-0.001, 0.0, 0.0, false),
    ] {
        for (x, y) in [(at_m, 3.0), (6.0 - at_m, 3.0), (3.0, at_m), (3.0, 6.0 - at_m)] {
            let hit = hit(x, y, sigma_x_m, sigma_y_m);
            assert_eq!(field.is_material(&hit), is_used, "{hit:?}");
            // The paper takes every hit in D.
            assert_eq!(paper.is_material(&hit), at_m > 0.0, "{hit:?}");
        }
    }
}

#[test]
fn the_papers_grid_counts_its_base_unless_it_adds_as_printed() {
    let account = |law, sigma_m| {
        let mut settings = settings(Method::KalmanGrid);
        let outline = Polygon::from(settings.region.bounds);
        let base = BaseSurface::Level { height_m: 0.0, sigma_m };
        settings.region.bays = vec![Bay { name: "hall".to_owned(), outline, base, density: None }];
        settings.grid.volume_variance = law;
        let mut mapper = Mapper::new(settings);
        sweep(&mut mapper);
        mapper.snapshot(Stamp::ZERO, true).run().expect("solved").accounts.remove(0)
    };
    // 36 m² that may lie 2 cm too high.
    for (law, base_m6) in [(VolumeVariance::Full, 0.72_f64.powi(2)), (VolumeVariance::Printed, 0.0)]
    {
        let [known, unsure] = [0.0, 0.02].map(|sigma_m| account(law, sigma_m));
        let more_m6 = unsure.estimate.sigma_m3.powi(2) - known.estimate.sigma_m3.powi(2);
        assert!((more_m6 - base_m6).abs() < 1e-9, "{law:?}: {more_m6}");
        // Two surveys over it share the error.
        let shared_m6 = unsure.budget.shared_var_of_m6(crate::messages::BudgetSource::Base);
        assert!((shared_m6 - base_m6).abs() < 1e-9, "{law:?}: {shared_m6}");
    }
}

#[test]
#[expect(clippy::cast_possible_truncation, reason = "test ranges")]
fn noise_does_not_bring_the_wall_at_the_border_into_the_region() {
    // 1 m from the wall at x = 6, looking along x: level ground at 1.2 m and the wall above it, both with the noise of
    // the range, 1 cm, as ±1σ by turns.
    let mut mapper = Mapper::new(settings(Method::MaternField));
    let turn = Rotation::from_euler_rad(0.0, 0.0, -std::f64::consts::FRAC_PI_2);
    let pose = Transform::new(turn, Point::new(5.0, 3.0, 5.2));
    let beams: Vec<Beam> = (0_u8..120)
        .map(|k| {
            let angle = 0.0125 * f64::from(k);
            let (to_ground_m, to_wall_m) = (4.0 / angle.cos(), 1.0 / angle.sin());
            let noise_m = if k % 2 == 0 { 0.01 } else { -0.01 };
            let range_m = (to_ground_m.min(to_wall_m) + noise_m) as f32;
            Beam { offset_ns: 0, angle_rad: angle as f32, range_m, intensity: 1 }
        })
        .collect();
    mapper.insert(
        &Scan { start: Stamp::ZERO, beams },
        |_| Some((pose, Matrix6::identity() * 1e-6)),
        pose_error,
    );
    let patches = &mapper.turns()[0].patches;
    let (west, east) = patches.iter().fold((f64::MAX, f64::MIN), |(west, east), patch| {
        assert!((patch.place().z - 1.2).abs() < 0.02, "of the wall: {patch:?}");
        (west.min(patch.place().x), east.max(patch.place().x))
    });
    // The ground is seen up to 3σ before the wall: its beams are 0.24 rad from straight down there, so the σ of 8 mm along the
    // ground is that of the angle.
    assert!(west < 5.2 && (5.8..5.98).contains(&east), "{west} to {east}");
}

#[test]
fn silent_beams_that_come_down_are_kept_with_their_turn() {
    let mut mapper = Mapper::new(settings(Method::MaternField));
    let pose = Transform::new(Rotation::identity(), Point::new(3.0, 0.5, 5.2));
    // From straight down to level, 0.0125 rad apart; a few must answer for a turn to be kept.
    let mut rays = |is_silent: &dyn Fn(f32) -> bool| {
        let beams = (0_u8..126).map(|k| 0.0125 * f32::from(k)).map(|angle_rad| {
            let range_m = if is_silent(angle_rad) { 0.0 } else { 4.0 / angle_rad.cos() };
            Beam { offset_ns: 0, angle_rad, range_m, intensity: 1 }
        });
        let scan = Scan { start: Stamp::ZERO, beams: beams.collect() };
        mapper.insert(&scan, |_| Some((pose, Matrix6::identity() * 1e-6)), pose_error);
        mapper.turns().last().expect("a turn").silent.clone()
    };
    assert!(rays(&|_| false).is_empty());
    // The region's diagonal and the highest ground: √(6² + 6² + 4²) m, nearer than the LiDAR's 12.
    let length_m = 88_f64.sqrt();
    let silent = rays(&|angle_rad| angle_rad > 0.8);
    // 0.8125 rad is the first, two of a run go before it; what ends above 4 m stays above all ground.
    let lowest_rad = (1.2 / length_m).acos();
    let n_beams: u16 = silent.iter().map(|ray| ray.n_beams).sum();
    let n_expected = (0_u8..124)
        .map(|k| 0.0125 * f64::from(k))
        .filter(|angle_rad| *angle_rad > 0.83 && *angle_rad < lowest_rad)
        .count();
    assert_eq!(usize::from(n_beams), n_expected);
    for ray in &silent {
        let [dx, dy, dz] = [ray.to_m[0] - 3.0, ray.to_m[1] - 0.5, ray.to_m[2] - 5.2].map(f64::from);
        assert!(dx.abs() < 1e-5 && (dy.hypot(dz) - length_m).abs() < 1e-3, "{ray:?}");
        assert!((1..=2).contains(&ray.n_beams), "every 0.02 rad: {ray:?}");
    }
    // A few silent beams in a row may be lost ones, more are not.
    for (n_silent, n_rays) in [(4_u8, 0), (5, 1)] {
        let lost = 0.699..0.699 + 0.0125 * f32::from(n_silent);
        assert_eq!(rays(&|angle_rad| lost.contains(&angle_rad)).len(), n_rays, "{n_silent}");
    }
}

#[test]
fn silence_over_hidden_ground_lowers_its_ceiling() {
    // Level ground at 1.2 m answers as far as y = 5, from 5.2 m over the floor at y = 0.5; beyond it
    // nothing does, so what lies there is lower than the silent beams.
    let known_heights = |silent_m: f32| {
        let mut mapper = Mapper::new(settings(Method::MaternField));
        for k in 0..42 {
            let x = 0.5 + 0.25 * f64::from(k % 21);
            let pose = Transform::new(Rotation::identity(), Point::new(x, 0.5, 5.2));
            let beams = (0_u8..91).map(|k| 0.0125 * f32::from(k)).map(|angle_rad| {
                let range_m = if angle_rad < 0.85 { 4.0 / angle_rad.cos() } else { silent_m };
                Beam { offset_ns: 0, angle_rad, range_m, intensity: 1 }
            });
            let scan = Scan { start: Stamp::ZERO, beams: beams.collect() };
            mapper.insert(&scan, |_| Some((pose, Matrix6::identity() * 1e-6)), pose_error);
        }
        let solved = mapper.snapshot(Stamp::ZERO, false).run().expect("solved");
        mapper.absorb(&solved);
        mapper.snapshot(Stamp::ZERO, false).known_heights().expect("known")
    };
    let ceiling_m = |silent_m| {
        let heights = known_heights(silent_m);
        let cell = heights.grid.cell_at(3.1, 5.4).expect("in the grid");
        heights.ceiling_m[cell]
    };
    // Ranges that are not trusted are no silence.
    assert!(ceiling_m(13.0).is_infinite());
    let lowest_m = ceiling_m(0.0);
    // The farthest echo is from 4/cos 0.8375 = 5.98 m, so rays are free for 5.9 m; of those that come
    // so far, 4.9 m aside, the lowest ends there.
    let expected_m = 5.2 - (5.9_f64.powi(2) - 4.9_f64.powi(2)).sqrt();
    assert!((lowest_m - expected_m).abs() < 0.1, "{lowest_m} {expected_m}");
}

#[test]
fn every_beam_is_counted_once() {
    let mut mapper = Mapper::new(settings(Method::KalmanGrid));
    let beam = |angle_rad, range_m| Beam { offset_ns: 0, angle_rad, range_m, intensity: 0 };
    let scan = Scan {
        start: Stamp::ZERO,
        beams: vec![
            beam(0.0, 4.0),
            beam(0.0, 0.0),
            beam(0.0, 13.0),
            beam(3.0, 1.0),
            beam(1.2, 11.0),
        ],
    };
    let pose = Transform::new(Rotation::identity(), Point::new(3.0, 3.0, 5.0));
    mapper.insert(&scan, |_| Some((pose, Matrix6::zeros())), pose_error);
    let one = Scan { start: Stamp::ZERO, beams: vec![beam(0.0, 4.0)] };
    mapper.insert(&one, |_| None, pose_error);
    mapper.insert(&one, |_| Some((pose, Matrix6::identity())), pose_error);
    let expected = HitCounts {
        received: 7,
        used: 1,
        no_return: 2,
        own_body: 1,
        outside: 1,
        no_pose: 1,
        poor_pose: 1,
        on_ground: 0,
        refused: 0,
        forgotten: 0,
    };
    assert_eq!(mapper.counts(), expected);
}

fn above() -> Transform<Hall, Body> {
    Transform::new(Rotation::identity(), Point::new(3.0, 3.0, 5.0))
}

fn two_beams(start: Stamp<Mono>) -> Scan {
    let beam = |angle_rad| Beam { offset_ns: 0, angle_rad, range_m: 4.0, intensity: 0 };
    Scan { start, beams: vec![beam(0.0), beam(0.1)] }
}

#[test]
fn a_pose_whose_covariance_is_no_number_maps_nothing() {
    for method in [Method::KalmanGrid, Method::MaternField] {
        let mut broken = Matrix6::identity() * 1e-6;
        // Beside the position's variances, and among them.
        for place in [(4, 1), (1, 1)] {
            broken[place] = f64::NAN;
            let mut mapper = Mapper::new(settings(method));
            mapper.insert(&two_beams(Stamp::ZERO), |_| Some((above(), broken)), pose_error);
            let counts = mapper.counts();
            assert_eq!((counts.used, counts.poor_pose), (0, 2), "{method:?}");
        }
    }
}

#[test]
fn beams_without_an_error_of_their_pose_are_not_counted_as_used() {
    let sure = |_| Some((above(), Matrix6::identity() * 1e-6));
    let broken_error = |at, previous| {
        let mut error = pose_error(at, previous)?;
        error.cov[(7, 7)] = f64::INFINITY;
        Some(error)
    };
    let counts_of = |method, error_at: &dyn Fn(_, _) -> Option<PoseError>| {
        let mut mapper = Mapper::new(settings(method));
        mapper.insert(&two_beams(Stamp::ZERO), sure, error_at);
        let counts = mapper.counts();
        (counts.used, counts.no_pose, counts.poor_pose)
    };
    assert_eq!(counts_of(Method::MaternField, &|_, _| None), (0, 2, 0));
    assert_eq!(counts_of(Method::MaternField, &broken_error), (0, 0, 2));
    assert_eq!(counts_of(Method::MaternField, &pose_error), (2, 0, 0));
    // The paper's grid asks for no chained errors.
    assert_eq!(counts_of(Method::KalmanGrid, &|_, _| None), (2, 0, 0));
}

#[test]
fn what_wrong_poses_have_seen_is_forgotten() {
    let sure = |_| Some((above(), Matrix6::identity() * 1e-6));
    let at_s = |seconds: i64| Stamp::from_nanos(seconds * 1_000_000_000);
    for (method, n_dropped) in [(Method::MaternField, 4), (Method::KalmanGrid, 10)] {
        let mut mapper = Mapper::new(settings(method));
        let mut as_if_never = Mapper::new(settings(method));
        for second in 1..=5 {
            mapper.insert(&two_beams(at_s(second)), sure, pose_error);
            if second <= 3 && method == Method::MaternField {
                as_if_never.insert(&two_beams(at_s(second)), sure, pose_error);
            }
        }
        assert_eq!(mapper.forget_since(at_s(5)), 0, "nothing is newer");
        assert_eq!(mapper.forget_since(at_s(3)), n_dropped, "{method:?}");
        let counts = mapper.counts();
        assert_eq!((counts.used, counts.forgotten), (10 - n_dropped, n_dropped));
        assert_eq!(mapper.forget_since(at_s(3)), 0, "they are gone");
        let volumes =
            |mapper: &Mapper| mapper.snapshot(at_s(6), true).run().map(|solved| solved.accounts);
        assert_eq!(volumes(&mapper), volumes(&as_if_never), "{method:?}");
    }
}

#[test]
fn a_scan_measures_where_distances_in_reach_come_from_past_the_own_body() {
    let mapper = Mapper::new(settings(Method::KalmanGrid));
    let scan = |range_m: &dyn Fn(u8) -> f32, from_rad: f32, step_rad: f32| Scan {
        start: Stamp::from_nanos(1_000),
        beams: (0..100)
            .map(|k| Beam {
                offset_ns: 10 * u32::from(k),
                angle_rad: from_rad + f32::from(k) * step_rad,
                range_m: range_m(k),
                intensity: 9,
            })
            .collect(),
    };
    let measured_ns = |scan: &Scan| mapper.measured_at(scan).map(Stamp::nanos);
    assert_eq!(measured_ns(&scan(&|_| 4.0, 0.0, 0.025)), Some(1_990));
    assert_eq!(measured_ns(&scan(&|k| if k < 50 { 4.0 } else { 0.0 }, 0.0, 0.025)), Some(1_490));
    // Nothing comes back, all too near or too far, the own body alone.
    for (range_m, from_rad, step_rad) in
        [(0.0, 0.0, 0.025), (0.05, 0.0, 0.025), (12.5, 0.0, 0.025), (4.0, 2.65, 0.005)]
    {
        assert_eq!(
            mapper.measured_at(&scan(&|_| range_m, from_rad, step_rad)),
            None,
            "{range_m} m"
        );
    }
    // A head that stands, at the cut of the angles too, and one that turns over it.
    assert!(
        !scan(&|_| 4.0, 0.3, 0.0).is_turning()
            && !Scan { beams: Vec::new(), ..scan(&|_| 4.0, 0.0, 0.1) }.is_turning()
    );
    let mut at_cut = scan(&|_| 4.0, 3.135, 0.0);
    at_cut.beams.iter_mut().step_by(2).for_each(|beam| beam.angle_rad = -3.135);
    assert!(!at_cut.is_turning());
    assert!(scan(&|_| 4.0, 3.1, 0.001).is_turning());
}
