//! Whole solves over ground of known shape, its beams found by a search along each.

use super::*;
use crate::geometry::{Body, Hall, Point, Rotation, Transform};
use crate::mapping::matern_field;
use crate::mapping::region::{Rect, Region};
use crate::mapping::unseen_patch::Ground;
use crate::mapping::{Mapper, Method, SolvedSurface, grid_map};
use crate::messages::{Beam, BudgetSource, PoseError, Scan};
use crate::stats::SeedBook;
use nalgebra::{Matrix6, SMatrix, Vector3};
use std::time::Duration;

fn mapper() -> Mapper {
    Mapper::new(crate::mapping::Settings {
        method: Method::MaternField,
        region: Region {
            bounds: Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 8.0, y_max_m: 8.0 },
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
                Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0),
                Point::origin(),
            ),
            range_sigma_m: 0.01,
            angle_sigma_rad: 0.002,
            min_range_m: 0.1,
            max_range_m: 20.0,
            blind_sectors_rad: Vec::new(),
        },
        grid: grid_map::Settings::default(),
        field: Settings { range_m: 4.0, ..Settings::default() },
        max_position_sigma_m: 0.2,
    })
}

/// One leg along x at `y_m`, 6 m high, a turn each 0.2 m; the scan plane stands across.
#[expect(clippy::cast_possible_truncation, reason = "test angles")]
fn fly_leg(mapper: &mut Mapper, y_m: f64, start_s: u64, height_m: &impl Fn(f64, f64) -> f64) {
    let mut noise = SeedBook::new(5 + start_s).stream("ranges");
    for turn in 0..40_u32 {
        let at = Stamp::ZERO
            .plus(Duration::from_secs(start_s))
            .plus(Duration::from_millis(100 * u64::from(turn)));
        let x_m = 0.1 + 0.2 * f64::from(turn);
        let pose = Transform::<Hall, Body>::new(Rotation::identity(), Point::new(x_m, y_m, 6.0));
        // Beams about straight down, by 1°, each followed to the ground or to walls at −1 and 9 m.
        let beam = |k: i32| {
            let angle = f64::from(k).to_radians();
            let along = Vector3::new(0.0, angle.sin(), -angle.cos());
            let ends = |range_m: f64| {
                let p = pose.origin.coords + along * range_m;
                p.z <= height_m(p.x, p.y) || !(-1.0..=9.0).contains(&p.y)
            };
            let far_m = (0..320).map(|step| 0.05 * f64::from(step)).find(|range_m| ends(*range_m));
            let mut far_m = far_m.unwrap_or(0.0);
            let mut near_m = (far_m - 0.05).max(0.0);
            for _ in 0..12 {
                let middle_m = f64::midpoint(near_m, far_m);
                if ends(middle_m) { far_m = middle_m } else { near_m = middle_m }
            }
            (angle, far_m)
        };
        let beams = (-70..=70).map(beam).map(|(angle, range_m)| Beam {
            offset_ns: 0,
            angle_rad: angle as f32,
            range_m: (range_m + 0.01 * noise.normal()) as f32,
            intensity: 100,
        });
        let scan = Scan { start: at, beams: beams.collect() };
        mapper.insert(
            &scan,
            |_| Some((pose, Matrix6::identity() * 1e-8)),
            |at, _| {
                Some(PoseError {
                    at,
                    cov: SMatrix::identity() * 1e-8,
                    from_previous: SMatrix::zeros(),
                    velocity_mps: Vector3::zeros(),
                    rate_radps: Vector3::zeros(),
                    tags: Vec::new(),
                })
            },
        );
    }
}

fn solved(mapper: &Mapper, is_final: bool) -> SolvedSurface {
    mapper.snapshot(Stamp::from_nanos(100_000_000_000), is_final).run().expect("solved")
}

fn row_m6(solved: &SolvedSurface, source: BudgetSource) -> f64 {
    let rows = &solved.accounts[0].budget.rows;
    rows.iter().filter(|row| row.source == source).map(|row| row.var_m6).sum()
}

/// The true volume by midpoints of 2 cm.
fn true_m3(height_m: &impl Fn(f64, f64) -> f64) -> f64 {
    let place = |k: u32| 0.02 * (f64::from(k) + 0.5);
    let cells = (0..400).flat_map(|i| (0..400).map(move |j| (i, j)));
    cells.map(|(i, j)| height_m(place(i), place(j)) * 4e-4).sum()
}

#[test]
fn ground_behind_a_ridge_is_taken_as_lower_than_the_rays() {
    // A ridge along x at y = 4, 3.2 m high, flown over on one side only. The rays over its crest fall
    // by 1.1, its far flank by 1.6.
    let height_m =
        |_: f64, y: f64| (3.2 - if y < 4.0 { 4.0 - y } else { 1.6 * (y - 4.0) }).max(0.4);
    let mut mapper = mapper();
    fly_leg(&mut mapper, 1.5, 0, &height_m);
    let with = solved(&mapper, true);
    let error_m3 = with.accounts[0].estimate.volume_m3 - true_m3(&height_m);
    // What the field says without the conditions: the newest field of a first look has none.
    let without = solved(&mapper, false);
    let was_m3 = without.accounts[0].estimate.volume_m3 - true_m3(&height_m);
    assert!(was_m3 > 1.0, "nothing hides here: {was_m3}");
    let sigma_m3 = with.accounts[0].estimate.sigma_m3;
    assert!(error_m3.abs() < 0.6 * was_m3, "{was_m3} became {error_m3} ± {sigma_m3}");
    assert!(error_m3.abs() < 2.5 * sigma_m3, "{error_m3} ± {sigma_m3}");
    assert!(row_m6(&with, BudgetSource::HiddenGround) > 0.01 * sigma_m3 * sigma_m3);
}

#[test]
fn smooth_ground_bridges_its_gaps_better() {
    let height_m = |x: f64, y: f64| 1.0 + 0.3 * (0.6 * x).sin() * (0.5 * y).cos();
    let mut mapper = mapper();
    fly_leg(&mut mapper, 2.0, 0, &height_m);
    fly_leg(&mut mapper, 6.0, 10, &height_m);
    let (in_flight, landed) = (solved(&mapper, false), solved(&mapper, true));
    let prior = |solved: &SolvedSurface| row_m6(solved, BudgetSource::Prior);
    assert!(prior(&landed) < 0.5 * prior(&in_flight), "{} {}", prior(&landed), prior(&in_flight));
    let estimate = landed.accounts[0].estimate;
    let error_m3 = estimate.volume_m3 - true_m3(&height_m);
    assert!(error_m3.abs() < 3.0 * estimate.sigma_m3, "{error_m3} ± {}", estimate.sigma_m3);
}

#[test]
fn fully_seen_ground_has_nothing_hidden() {
    let height_m = |x: f64, _: f64| 0.8 + 0.1 * x;
    let mut mapper = mapper();
    fly_leg(&mut mapper, 2.0, 0, &height_m);
    fly_leg(&mut mapper, 6.0, 10, &height_m);
    let landed = solved(&mapper, true);
    let sigma_m3 = landed.accounts[0].estimate.sigma_m3;
    assert!(row_m6(&landed, BudgetSource::HiddenGround) < 0.02 * sigma_m3 * sigma_m3);
}

#[test]
fn what_stands_for_less_than_half_a_cell_is_no_unseen_ground() {
    let mapper = mapper();
    let work = mapper.snapshot(Stamp::ZERO, false);
    let crate::mapping::SolveSurface::MaternField(work) = &work else { panic!("a field") };
    let setup = &work.setup;
    let is_known = vec![false; setup.lattice.n_nodes()];
    let mut areas_m2 = setup.areas_m2().swap_remove(0);
    let cell_m2 = 0.25 * 0.25;
    let (thin, half) = (setup.lattice.nearest_node(4.0, 4.0), setup.lattice.nearest_node(6.0, 4.0));
    areas_m2[thin] = 0.4 * cell_m2;
    areas_m2[half] = 0.6 * cell_m2;
    let ground = setup.ground(&is_known, &areas_m2);
    assert_eq!((ground[thin], ground[half]), (Ground::Known, Ground::Core));
    // The padding outside of the region is no ground, all within is.
    let n_open = ground.iter().filter(|ground| **ground != Ground::Known).count();
    assert!(n_open < setup.lattice.n_nodes() && n_open.abs_diff(32 * 32) <= 33, "{n_open}");
}

#[test]
fn the_prior_that_ground_was_drawn_from_is_learned() {
    let truth = Prior { range_m: 2.0, sigma_m: 0.25, mean_m: 1.0, mean_sigma_m: 0.1 };
    let cell_m = 0.25;
    let grid = crate::messages::GridGeometry {
        x_min_m: -1.0,
        y_min_m: -1.0,
        cell_m,
        n_cols: 40,
        n_rows: 40,
    };
    let lattice = Arc::new(Lattice::covering(&grid, 1.0, |_, _| false));
    let empty = matern_field::Information::new(&lattice);
    let solver = matern_field::Solver::Direct;
    let drawn_from = matern_field::solve(&lattice, &truth, &empty, solver, None).expect("solved");
    for seed in [1, 2] {
        let mut noise = SeedBook::new(seed).stream("ground");
        let ground_m = drawn_from.sample_m(&mut noise).expect("has a factor");
        let height_m =
            |x: f64, y: f64| lattice.row_at(x, y).map_or(-1.0, |row| row.value(&ground_m)).max(0.0);
        let mut mapper = mapper();
        for (leg, y_m) in [1.0, 3.0, 5.0, 7.0].into_iter().enumerate() {
            fly_leg(&mut mapper, y_m, 10 * leg as u64, &height_m);
        }
        let landed = solved(&mapper, true);
        mapper.absorb(&landed);
        let snapshot = mapper.snapshot(Stamp::from_nanos(100_000_000_000), true);
        let crate::mapping::SolveSurface::MaternField(field) = snapshot else { panic!("a field") };
        let found = field.learn_prior().expect("estimated");
        println!("seed {seed}: {found:?}");
        // Started from ρ = 4 m and σ = 1 m. A field of four ranges by four fixes both to about 15 %.
        assert!((found.range_m / truth.range_m).ln().abs() < 0.45, "{found:?}");
        assert!((found.sigma_m / truth.sigma_m).ln().abs() < 0.45, "{found:?}");
    }
}
