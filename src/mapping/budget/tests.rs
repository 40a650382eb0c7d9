//! The budget against the same map solved again with every source of error moved.
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    reason = "places are single precision, counts are small"
)]

use super::super::bay::BayOnGrid;
use super::super::field_map::{self, FieldMap, Setup};
use super::super::footprint::{Footprint, Patch};
use super::super::matern_field::Lattice;
use super::super::projection::LidarMount;
use super::super::volume::Base;
use super::*;
use crate::geometry::{Body, Hall, Lidar, Point, Rotation, Transform};
use crate::messages::{GridGeometry, PoseError, TagSensitivity, VolumeAccount};
use crate::stats::{Noise, SeedBook};
use crate::time::Stamp;
use nalgebra::Matrix6x3;
use std::time::Duration;

const SIGMAS: CalibrationSigmas = CalibrationSigmas {
    range_bias_m: 0.01,
    range_scale: 0.001,
    mount_position_m: 0.005,
    mount_rotation_rad: 0.003,
    clock_offset_s: 0.002,
    tag_place_m: 0.005,
    tag_datum_m: 0.0,
};
const N_TURNS: usize = 12;
const N_TAGS: usize = 2;

fn grid() -> GridGeometry {
    GridGeometry { x_min_m: 1.0, y_min_m: -2.0, cell_m: 0.25, n_cols: 16, n_rows: 14 }
}

fn mount() -> Transform<Body, Lidar> {
    Transform::new(Rotation::from_euler_rad(0.05, 1.5, -0.1), Point::new(0.07, 0.02, -0.05))
}

fn map() -> FieldMap {
    map_with(field_map::Settings { range_m: 3.0, calibration: SIGMAS, ..Default::default() })
}

fn map_with(settings: field_map::Settings) -> FieldMap {
    let lattice = Lattice::covering(&grid(), 1.0, |_, _| false);
    let areas = vec![grid().cell_area_m2(); grid().n_cells()];
    FieldMap::new(Arc::new(Setup {
        settings,
        lattice: Arc::new(lattice),
        lidars: vec![LidarMount {
            body_from_lidar: mount(),
            range_sigma_m: 0.02,
            angle_sigma_rad: 0.003,
            min_range_m: 0.1,
            max_range_m: 12.0,
            blind_sectors_rad: Vec::new(),
        }],
        bays: Arc::new(vec![BayOnGrid {
            name: "hall".to_owned(),
            base: Base::level(0.0, areas),
            areas: (0..grid().n_cells())
                .map(|cell| (grid().centre_m(cell), grid().cell_area_m2()))
                .collect(),
            is_over_survey: false,
            density: None,
        }]),
    }))
}

/// A slanted, gently curved ground, so that horizontal errors count too.
fn height_m(x: f64, y: f64) -> f64 {
    1.0 + 0.3 * (x - 2.0) - 0.2 * y + 0.1 * (0.9 * x).sin() * (0.8 * y).cos()
}

/// What is wrong with the data, beside nothing.
#[derive(Clone, Copy, Default)]
struct Wrong {
    /// Error of the LiDAR's mounting: position (body axes), rotation (LiDAR axes).
    mount: Vector6<f64>,
    range_bias_m: f64,
    range_scale: f64,
    clock_offset_s: f64,
    /// Error of the pose of one turn.
    pose: Option<(usize, Vector6<f64>)>,
    tag: Option<(usize, Vector3<f64>)>,
    /// Error of the places of all tags.
    all_tags: Vector3<f64>,
}

fn tag_sensitivity(turn: usize, tag_idx: usize) -> Matrix6x3<f64> {
    let k = turn as f64 + 0.3;
    Matrix6x3::from_fn(|r, c| 0.1 * ((r + 2 * c + 3 * tag_idx) as f64 * 0.7 + 0.2 * k).sin())
}

/// The turns of a flight over the ground; the error is in what the map is told, never in the truth.
fn footprints(wrong: &Wrong) -> Vec<Footprint> {
    (0..N_TURNS).map(|turn| footprint(turn, wrong)).collect()
}

fn footprint(turn: usize, wrong: &Wrong) -> Footprint {
    let x = 1.3 + 0.29 * turn as f64;
    let truth = Transform::<Hall, Body>::new(
        Rotation::from_euler_rad(0.04, -0.06 + 0.01 * turn as f64, 0.2),
        Point::new(x, -0.4, 6.0),
    );
    let (velocity_mps, rate_radps) = (Vector3::new(1.8, 0.2, -0.1), Vector3::new(0.05, -0.1, 0.2));
    let mut error = Vector6::zeros();
    if let Some((_, by)) = wrong.pose.filter(|(k, _)| *k == turn) {
        error += by;
    }
    if let Some((tag, by)) = wrong.tag {
        error += tag_sensitivity(turn, tag) * by;
    }
    (0..N_TAGS).for_each(|tag| error += tag_sensitivity(turn, tag) * wrong.all_tags);
    let v = Vector6::new(
        velocity_mps.x,
        velocity_mps.y,
        velocity_mps.z,
        rate_radps.x,
        rate_radps.y,
        rate_radps.z,
    );
    error += v * wrong.clock_offset_s;
    let believed = truth
        .perturbed(&error.fixed_rows::<3>(0).into_owned(), &error.fixed_rows::<3>(3).into_owned());
    let m = wrong.mount;
    let believed_mount = Transform::<Body, Lidar>::new(
        mount().rotation.perturbed(&m.fixed_rows::<3>(3).into_owned()),
        Point::from_coords(mount().origin.coords + m.fixed_rows::<3>(0)),
    );
    let beams = (-30..=30).map(|k| {
        let angle = f64::from(k) * 0.011;
        let direction = Vector3::new(angle.cos(), angle.sin(), 0.0);
        let range_m = range_to_ground(&(truth * mount()), &direction);
        let told_m = range_m * (1.0 + wrong.range_scale) + wrong.range_bias_m;
        believed_mount * Point::from_coords(direction * told_m)
    });
    let patches = beams
        .map(|arm| Patch {
            place_m: (believed * arm).coords.map(|c| c as f32).into(),
            arm_m: arm.coords.map(|c| c as f32).into(),
            n_beams: 1,
            level: Patch::NO_LEVEL,
        })
        .collect();
    Footprint {
        lidar_idx: 0,
        passed_to_m: Vec::new(),
        silent: Vec::new(),
        error: PoseError {
            at: Stamp::ZERO.plus(Duration::from_millis(100 * turn as u64)),
            cov: cov(turn),
            from_previous: transition(turn),
            velocity_mps,
            rate_radps,
            tags: (0..N_TAGS)
                .map(|tag_idx| TagSensitivity {
                    tag_idx,
                    pose_by_place: tag_sensitivity(turn, tag_idx).cast(),
                })
                .collect(),
        },
        hall_from_body: believed,
        patches,
    }
}

/// Where a ray meets the ground, by bisection.
fn range_to_ground(hall_from_lidar: &Transform<Hall, Lidar>, direction: &Vector3<f64>) -> f64 {
    let above = |range_m: f64| {
        let p = (*hall_from_lidar * Point::from_coords(direction * range_m)).coords;
        p.z - height_m(p.x, p.y)
    };
    let (mut near, mut far) = (0.5, 12.0);
    for _ in 0..60 {
        let middle = 0.5 * (near + far);
        if above(middle) > 0.0 { near = middle } else { far = middle }
    }
    near
}

/// A fixed, lively matrix of the given scale.
fn lively(seed: u64, scale: f64) -> SMatrix<f64, SIZE, SIZE> {
    let mut noise = SeedBook::new(seed).stream("matrix");
    SMatrix::from_fn(|_, _| scale * noise.normal())
}

fn cov(turn: usize) -> SMatrix<f64, SIZE, SIZE> {
    // P_k = A_k P_{k−1} A_kᵀ + new noise, as a filter's would be.
    let fresh = lively(100 + turn as u64, 1e-3);
    let fresh = fresh * fresh.transpose();
    if turn == 0 {
        return fresh * 4.0;
    }
    let a = transition(turn);
    a * cov(turn - 1) * a.transpose() + fresh
}

fn transition(turn: usize) -> SMatrix<f64, SIZE, SIZE> {
    SMatrix::identity() * 0.9 + lively(200 + turn as u64, 0.01)
}

fn solved(footprints: Vec<Footprint>) -> VolumeAccount {
    solved_in(map(), footprints)
}

fn solved_in(mut map: FieldMap, footprints: Vec<Footprint>) -> VolumeAccount {
    for footprint in footprints {
        map.push(footprint);
    }
    map.snapshot(Stamp::ZERO, true).run().expect("solved").accounts.remove(0)
}

/// ∂V/∂c by central difference: solved anew with the error on either side.
fn volume_by(wrong: impl Fn(f64) -> Wrong, step: f64) -> f64 {
    let volume = |s: f64| solved(footprints(&wrong(s))).estimate.volume_m3;
    (volume(step) - volume(-step)) / (2.0 * step)
}

#[test]
fn constant_sources_match_the_map_solved_again() {
    let account = solved(footprints(&Wrong::default()));
    let claimed = |source, component| {
        let of = |s: &&SharedSensitivity| s.source == source && s.component == component;
        account.budget.shared.iter().find(of).expect("a source").dv_dc
    };
    // Rows and weights move with the data too, in proportion to what the surface leaves of them:
    // 2 % of the answer to a shift along z, which is the area.
    let area_m2 = 14.0;
    let near = |a: f64, b: f64, lever: f64| (a - b).abs() < 0.02 * area_m2 * lever;
    for c in 0..6 {
        let by = volume_by(|s| Wrong { mount: Vector6::ith(c, s), ..Wrong::default() }, 2e-3);
        let ours = claimed(BudgetSource::LidarMounting, c);
        let lever = if c < 3 { 1.0 } else { 6.0 };
        assert!(near(by, ours, lever), "mounting {c}: {by} against {ours}");
    }
    let by = volume_by(|s| Wrong { range_bias_m: s, ..Wrong::default() }, 5e-3);
    let ours = claimed(BudgetSource::RangeBias, 0);
    assert!(near(by, ours, 1.0), "range bias: {by} against {ours}");
    let by = volume_by(|s| Wrong { range_scale: s, ..Wrong::default() }, 1e-3);
    let ours = claimed(BudgetSource::RangeScale, 0);
    assert!(near(by, ours, 6.0), "range scale: {by} against {ours}");
    let by = volume_by(|s| Wrong { clock_offset_s: s, ..Wrong::default() }, 5e-3);
    let ours = claimed(BudgetSource::ClockOffset, 0);
    assert!(near(by, ours, 2.0), "clock: {by} against {ours}");
    for tag in 0..N_TAGS {
        for axis in 0..3 {
            let wrong = |s| Wrong { tag: Some((tag, Vector3::ith(axis, s))), ..Wrong::default() };
            let by = volume_by(wrong, 2e-2);
            let ours = claimed(BudgetSource::MarkerMap, 3 * tag + axis);
            assert!(near(by, ours, 0.3), "tag {tag} axis {axis}: {by} against {ours}");
        }
    }
}

#[test]
fn chained_pose_errors_match_the_joint_covariance() {
    let account = solved(footprints(&Wrong::default()));
    // s_k of every turn by moving that turn's pose alone.
    let s: Vec<SVector<f64, SIZE>> = (0..N_TURNS)
        .map(|turn| {
            let mut s = SVector::<f64, SIZE>::zeros();
            for c in 0..6 {
                let wrong =
                    |by| Wrong { pose: Some((turn, Vector6::ith(c, by))), ..Wrong::default() };
                s[c] = volume_by(wrong, 2e-3);
            }
            s
        })
        .collect();
    // cov(e_j, e_k) = A_j … A_{k+1} P_k for j > k, pair by pair.
    let mut var_m6 = 0.0;
    for k in 0..s.len() {
        let mut chain = SMatrix::<f64, SIZE, SIZE>::identity();
        var_m6 += s[k].dot(&(cov(k) * s[k]));
        for j in k + 1..s.len() {
            chain = transition(j) * chain;
            var_m6 += 2.0 * s[j].dot(&(chain * cov(k) * s[k]));
        }
    }
    let claimed = account.budget.var_of_m6(BudgetSource::Pose);
    assert!((claimed - var_m6).abs() < 0.05 * var_m6, "{claimed} against {var_m6}");
}

#[test]
fn a_marker_map_that_is_off_as_a_whole_moves_the_volume_as_its_row_says() {
    let with_datum = |tag_datum_m| {
        let calibration = CalibrationSigmas { tag_datum_m, ..SIGMAS };
        let settings = field_map::Settings { range_m: 3.0, calibration, ..Default::default() };
        solved_in(map_with(settings), footprints(&Wrong::default()))
    };
    let (known, unsure) = (with_datum(0.0), with_datum(0.002));
    let markers = |account: &VolumeAccount| {
        let of = |s: &&SharedSensitivity| s.source == BudgetSource::MarkerMap;
        account.budget.shared.iter().filter(of).copied().collect::<Vec<_>>()
    };
    // The axes of the whole come first, then the tags one by one as ever.
    let (tags, all) = (markers(&known), markers(&unsure));
    assert_eq!((tags.len(), all.len()), (3 * N_TAGS, 3 + 3 * N_TAGS));
    for (tag, moved) in std::iter::zip(&tags, &all[3..]) {
        assert_eq!((tag.dv_dc, tag.sigma), (moved.dv_dc, moved.sigma));
        assert_eq!(tag.component + 3, moved.component);
    }
    let mut var_m6 = 0.0;
    for (axis, claimed) in all[..3].iter().enumerate() {
        let wrong = |s| Wrong { all_tags: Vector3::ith(axis, s), ..Wrong::default() };
        let by = volume_by(wrong, 1e-2);
        // As in the test above: 2 % of the answer to a shift along z, which is the area.
        assert!((by - claimed.dv_dc).abs() < 0.02 * 14.0 * 0.3, "axis {axis}: {by} {claimed:?}");
        var_m6 += (by * 0.002).powi(2);
    }
    let more_m6 = unsure.budget.var_of_m6(BudgetSource::MarkerMap)
        - known.budget.var_of_m6(BudgetSource::MarkerMap);
    assert!((more_m6 / var_m6 - 1.0).abs() < 0.1, "{more_m6} against {var_m6}");
}

#[test]
fn hidden_hollows_move_the_volume_as_their_row_says() {
    let rough = over_rough_ground(0.05);
    let volume_at = |occlusion_share| {
        let settings = field_map::Settings {
            range_m: 3.0,
            calibration: SIGMAS,
            occlusion_share,
            ..Default::default()
        };
        solved_in(map_with(settings), rough.clone())
    };
    let (share, sigma) = OCCLUSION_SHARE;
    let claimed_m3 = volume_at(share).budget.var_of_m6(BudgetSource::Occlusion).sqrt();
    let [less, more] = [-sigma, sigma].map(|by| volume_at(share + by).estimate.volume_m3);
    let found_m3 = (less - more) / 2.0;
    assert!(found_m3 > 0.005, "the ground is not rough enough to tell: {found_m3}");
    // The roughness that the data show moves a little with the surface.
    assert!((claimed_m3 / found_m3 - 1.0).abs() < 0.05, "{claimed_m3} against {found_m3}");
}

/// The flight over ground whose patches scatter by so much about each other, m: rough below the cells.
fn over_rough_ground(roughness_m: f64) -> Vec<Footprint> {
    let mut noise = SeedBook::new(9).stream("ground");
    let mut turns = footprints(&Wrong::default());
    for patch in turns.iter_mut().flat_map(|turn| &mut turn.patches) {
        patch.place_m[2] += (roughness_m * noise.normal()) as f32;
    }
    turns
}

/// What is drawn of the data's errors.
#[derive(Debug, Clone, Copy)]
enum Shaken {
    /// Noise of ranges and angles, beam by beam.
    ByBeams,
    /// What the nodes cannot show: slopes patch by patch, heights square by square.
    ByGround,
}

#[test]
fn white_sources_match_the_scatter_of_noisy_flights() {
    let before = over_rough_ground(0.03);
    let (account, roughness_m) = {
        let mut map = map();
        before.iter().for_each(|turn| map.push(turn.clone()));
        let mut solved = map.snapshot(Stamp::ZERO, true).run().expect("solved");
        let newest = solved.newest.expect("a field");
        (solved.accounts.remove(0), newest.scatter_m.expect("enough is seen"))
    };
    // What is found is less the beams' own 2 cm.
    assert!((0.015..0.035).contains(&roughness_m), "{roughness_m}");
    let n_flights = 150_u32;
    let n_nodes = map().lattice().n_nodes();
    for (source, by, seed) in [
        (BudgetSource::BeamNoise, Shaken::ByBeams, 7),
        (BudgetSource::Roughness, Shaken::ByGround, 8),
    ] {
        let claimed = account.budget.var_of_m6(source);
        let mut noise = SeedBook::new(seed).stream("beams");
        let mut squares_m6 = 0.0;
        for _ in 0..n_flights {
            let rough: Vec<f64> = (0..n_nodes).map(|_| noise.normal()).collect();
            let turns = before.iter().cloned();
            let noisy = turns.map(|turn| shaken(turn, by, (roughness_m, &rough), &mut noise));
            let noisy = noisy.collect();
            squares_m6 += (solved(noisy).estimate.volume_m3 - account.estimate.volume_m3).powi(2);
        }
        let ratio = squares_m6 / f64::from(n_flights) / claimed;
        // χ² with 150 degrees of freedom: ±3σ is ±35 %.
        assert!((0.65..1.35).contains(&ratio), "{source:?}, scatter over claim: {ratio}");
    }
}

/// Every hit moved along the vertical by a draw of its own variance, or by its square's roughness, of
/// which σ and one draw per square are given.
fn shaken(
    mut turn: Footprint,
    by: Shaken,
    (roughness_m, rough): (f64, &[f64]),
    noise: &mut Noise,
) -> Footprint {
    let map = map();
    let heights: Vec<f64> = (0..map.lattice().n_nodes())
        .map(|node| map.lattice().place_m(node))
        .map(|(x, y)| height_m(x, y))
        .collect();
    let at = Linearization { roughness_m, ..map.linearization(&heights) };
    let data: Vec<_> = {
        let shared = Turn::new(&turn, at).expect("a known LiDAR");
        turn.patches.iter().map(|patch| shared.datum(patch)).collect()
    };
    for (patch, datum) in turn.patches.iter_mut().zip(data) {
        let Some(datum) = datum else { continue };
        let moved_m = match by {
            Shaken::ByBeams => datum.sensor_var_m2.sqrt() * noise.normal(),
            Shaken::ByGround => {
                datum.slope_var_m2.sqrt() * noise.normal()
                    + datum.roughness_var_m2.sqrt() * rough[datum.row.nodes[0] as usize]
            }
        };
        patch.place_m[2] += moved_m as f32;
    }
    turn
}
