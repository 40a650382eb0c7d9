//! What data may and may not do to the surface.

use crate::support::{at_ns, lidar_mount, settings};
use nalgebra::{Matrix3, Matrix6, Vector3};
use stockpilot::geometry::{Point, Rotation, Transform};
use stockpilot::mapping::kalman_grid::{KalmanGrid, Settings, VarianceUpdate};
use stockpilot::mapping::projection::{Hit, project};
use stockpilot::mapping::sparse_gp::{self, Posterior};
use stockpilot::mapping::volume::Base;
use stockpilot::mapping::{Mapper, Method, SolvedSurface, VolumeVariance};
use stockpilot::messages::{Beam, GridGeometry};
use stockpilot::stats::{Noise, SeedBook};

const GRID: GridGeometry =
    GridGeometry { x_min_m: -1.0, y_min_m: 2.0, cell_m: 0.25, n_cols: 24, n_rows: 16 };

/// A hit anywhere on or beside the grid, from sharp to hopeless, correlated.
fn hit(noise: &mut Noise) -> Hit {
    let place =
        Point::new(noise.between(-3.0, 7.0), noise.between(0.0, 8.0), noise.between(-1.0, 5.0));
    let scale = 10_f64.powf(noise.between(-4.0, 1.0));
    let spread = Matrix3::from_fn(|_, _| noise.normal()) * scale;
    Hit { place, cov_m2: spread * spread.transpose() }
}

#[test]
fn posterior_variance_never_exceeds_prior() {
    for variance_update in [VarianceUpdate::Printed, VarianceUpdate::Kalman] {
        let settings = Settings { variance_update, ..Settings::default() };
        let mut grid = KalmanGrid::new(GRID, settings);
        let prior = settings.prior_sigma_m.powi(2);
        let mut noise = SeedBook::new(31).stream("hits");
        let mut before = grid.var_m2().to_vec();
        for _ in 0..5_000 {
            grid.insert(&hit(&mut noise), |_| true);
            for (old, new) in std::iter::zip(&before, grid.var_m2()) {
                assert!(new <= old && *new >= 0.0 && *new <= prior, "{old} to {new}");
            }
            before.copy_from_slice(grid.var_m2());
        }
        assert!(
            grid.mean_m().iter().all(|mean| (-1.0..=5.0).contains(mean)),
            "outside of the data"
        );
        assert!(before.iter().any(|var| *var < 0.01 * prior), "nothing was learnt");
    }
}

#[test]
fn more_data_never_makes_the_volume_less_certain() {
    let settings = sparse_gp::Settings {
        smoothness_nu: 1.5,
        length_scale_m: 0.5,
        reach: 2.0,
        sigma_m: 0.8,
        mean_m: 1.0,
        cut: sparse_gp::Cut::Taper,
    };
    let mut grid = KalmanGrid::new(GRID, Settings::default());
    let mut noise = SeedBook::new(32).stream("hits");
    let areas = vec![GRID.cell_area_m2(); GRID.n_cells()];
    let mut last = f64::INFINITY;
    for _ in 0..12 {
        let posterior = Posterior::new(&GRID, grid.mean_m(), grid.var_m2(), &settings)
            .expect("a tapered kernel is positive definite");
        let variance = posterior.sum_var(&areas);
        assert!(variance <= last * (1.0 + 1e-9), "{last} to {variance}");
        let marginals = posterior.marginal_var_m2();
        assert!(marginals.iter().all(|var| *var <= settings.sigma_m.powi(2) * (1.0 + 1e-9)));
        last = variance;
        for _ in 0..40 {
            grid.insert(&hit(&mut noise), |_| true);
        }
    }
    assert!(last > 0.0 && last.is_finite());
}

#[test]
fn printed_variance_adds_marginals_and_full_is_that_of_the_sum() {
    let solved = |volume_variance| {
        let mut settings = settings().mapping;
        settings.method = Method::KalmanGrid;
        settings.grid.volume_variance = volume_variance;
        settings.grid.gp.sigma_m = 0.5;
        let areas = settings.region.cell_areas_m2(&settings.region.grid(settings.cell_m));
        let solve = Mapper::new(settings).snapshot(at_ns(0), true);
        (solve.run().expect("a tapered kernel is positive definite"), areas)
    };
    let sigma_m3 = |solved: &SolvedSurface| solved.accounts[0].estimate.sigma_m3;
    let (printed, areas) = solved(VolumeVariance::Printed);
    let added: f64 = std::iter::zip(&areas, &printed.surface.sigma_m)
        .map(|(area, sigma)| (area * sigma).powi(2))
        .sum();
    assert!((sigma_m3(&printed) / added.sqrt() - 1.0).abs() < 1e-12);
    // Neighbours move together, so their sum is less certain than the printed rule says: nearly
    // as many cells as lie within the kernel count as one.
    let (full, _) = solved(VolumeVariance::Full);
    assert!(sigma_m3(&full) > 1.5 * sigma_m3(&printed), "{full:?}");
}

#[test]
fn the_literal_cut_tells_what_helps_when_it_fails() {
    let mut settings = settings().mapping;
    settings.method = Method::KalmanGrid;
    settings.grid.gp = sparse_gp::Settings {
        cut: sparse_gp::Cut::Literal,
        smoothness_nu: 2.7,
        length_scale_m: 2.0,
        reach: 0.5,
        ..settings.grid.gp
    };
    settings.grid.kalman_grid.prior_sigma_m = 1e-3;
    let error = Mapper::new(settings).snapshot(at_ns(0), false).run().unwrap_err();
    assert!(error.to_string().contains("use the taper"), "{error}");
}

#[test]
fn volumes_of_parts_add_up() {
    let mut noise = SeedBook::new(33).stream("heights");
    for _ in 0..200 {
        let heights: Vec<f64> = (0..400).map(|_| noise.between(-0.5, 6.0)).collect();
        let whole: Vec<f64> = (0..400).map(|_| noise.between(0.0, 0.0625)).collect();
        let share: Vec<f64> = (0..400).map(|_| noise.uniform()).collect();
        let part = |f: &dyn Fn(f64) -> f64| {
            let cell_areas_m2 = whole.iter().zip(&share).map(|(a, s)| a * f(*s)).collect();
            Base::level(0.3, cell_areas_m2).volume_m3(&heights)
        };
        let (first, second, all) = (part(&|s| s), part(&|s| 1.0 - s), part(&|_| 1.0));
        assert!((first + second - all).abs() < 1e-10, "{first} + {second} is not {all}");
    }
}

#[test]
fn covariances_of_hits_are_positive_and_never_shrink_with_the_pose() {
    let mount = lidar_mount();
    let mut noise = SeedBook::new(34).stream("poses");
    for _ in 0..2_000 {
        let turn = noise.normal3() * 0.7;
        let pose = Transform::new(
            Rotation::from_euler_rad(turn.x, turn.y, turn.z),
            Point::from_coords(noise.normal3() * 5.0),
        );
        #[expect(clippy::cast_possible_truncation, reason = "beams are single precision")]
        let beam = Beam {
            offset_ns: 0,
            angle_rad: noise.between(-3.1, 3.1) as f32,
            range_m: noise.between(0.2, 12.0) as f32,
            intensity: 9,
        };
        let spread = Matrix6::from_fn(|_, _| noise.normal()) * 0.05;
        let hit = project(&mount, &beam, &pose, &(spread * spread.transpose()));
        let sharp = project(&mount, &beam, &pose, &Matrix6::zeros());
        let direction: Vector3<f64> = noise.normal3();
        let var = |hit: &Hit| (direction.transpose() * hit.cov_m2 * direction).x;
        assert!(var(&sharp) >= 0.0 && var(&hit) >= var(&sharp) - 1e-12);
        // The distance from sensor to hit is the range, whatever the pose.
        let lidar = pose * mount.body_from_lidar * Point::origin();
        let range_m = (hit.place - lidar).coords.norm();
        assert!((range_m - f64::from(beam.range_m)).abs() < 1e-9);
    }
}
