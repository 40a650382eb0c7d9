//! One inertial sample, one late fix, one frame of tags.

#![expect(clippy::expect_used, reason = "a bench stops where its premise fails")]

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix6, Vector2, Vector3};
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;
use stockpilot::geometry::{Body, Camera, Hall, Point, Rotation, Transform};
use stockpilot::localization::PlaceErrors;
use stockpilot::localization::camera_model::{CameraModel, Lens};
use stockpilot::localization::filter::{Covariance, FilterState, ImuNoise};
use stockpilot::localization::ring::{FrameInsertion, Insertion, Ring};
use stockpilot::localization::tight_update::{Frame, Sighting, fuse};
use stockpilot::localization::vision_fix::{PointFeature, Settings, solve};
use stockpilot::messages::{FixOutcome, ImuSample};
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

const STEP_NS: i64 = 5_000_000;

fn at(step: i64) -> Stamp<Mono> {
    Stamp::from_nanos(step * STEP_NS)
}

fn state() -> FilterState {
    FilterState {
        at: at(0),
        hall_from_body: Transform::new(
            Rotation::from_euler_rad(0.05, -0.02, 0.3),
            Point::new(2.0, 1.0, 3.0),
        ),
        velocity_mps: Vector3::new(1.0, 0.2, 0.0),
        gyro_bias_radps: Vector3::zeros(),
        accel_bias_mps2: Vector3::zeros(),
        P: Covariance::identity() * 0.01,
        places: None,
    }
}

fn imu(step: i64) -> ImuSample {
    ImuSample {
        at: at(step),
        accel_mps2: Vector3::new(0.3, -0.1, 9.8),
        gyro_radps: Vector3::new(0.02, 0.1, -0.05),
    }
}

/// One second of samples at 200 Hz.
fn ring(start: FilterState) -> Ring {
    let mut ring = Ring::new(start, imu(0), ImuNoise::default(), Duration::from_secs(1));
    (1..=200).for_each(|step| ring.push_imu(imu(step)));
    ring
}

fn propagation(c: &mut Criterion) {
    let (start, sample, noise) = (state(), imu(1), ImuNoise::default());
    let next = start.propagated(&sample, sample.at, &noise);
    assert!(next.P.trace() > start.P.trace() && next.at == at(1));
    c.bench_function("imu_propagation", |b| {
        b.iter(|| black_box(&start).propagated(black_box(&sample), sample.at, &noise));
    });
}

fn late_fix(c: &mut Criterion) {
    let full = ring(state());
    let exposed = at(180);
    let fix = FixOutcome {
        hall_from_body: full.state_at(exposed).expect("inside").hall_from_body,
        pose_cov: Matrix6::from_diagonal_element(1e-4),
        residual_rms_px: 0.3,
        n_points: 8,
        q_pos: 40.0,
        q_position: 50.0,
    };
    let mut once = full.clone();
    let inserted = once.insert_fix(exposed, fix.clone());
    assert!(matches!(inserted, Insertion::Placed(i) if i.is_within_gate()));
    assert!(once.newest().P.trace() < full.newest().P.trace());
    c.bench_function("fix_100_ms_late", |b| {
        b.iter_batched_ref(
            || {
                // In flight the ring has room; a bare clone would pay for growing here.
                let mut ring = full.clone();
                ring.push_imu(imu(201));
                (ring, fix.clone())
            },
            |(ring, fix)| ring.insert_fix(exposed, fix.clone()),
            BatchSize::SmallInput,
        );
    });
}

fn camera() -> CameraModel {
    let quarter = std::f64::consts::FRAC_PI_2;
    CameraModel {
        width_px: 1280,
        height_px: 800,
        fx_px: 640.0,
        fy_px: 640.0,
        cx_px: 640.0,
        cy_px: 400.0,
        lens: Lens::radial_tangential([-0.1, 0.01], [0.0005, -0.0003]),
        readout: Duration::ZERO,
        body_from_camera: Transform::new(
            Rotation::<Body, Camera>::from_euler_rad(-quarter, 0.0, -quarter),
            Point::new(0.1, 0.0, 0.02),
        ),
    }
}

fn fisheye() -> CameraModel {
    let lens = Lens::fisheye([-0.021, 0.013, -0.008, 0.0015]);
    CameraModel { fx_px: 330.0, fy_px: 330.0, lens, ..camera() }
}

/// The corners of ten tags of half a metre, 8 m ahead.
fn ten_tags(camera: &CameraModel, pose: &Transform<Hall, Body>) -> Vec<PointFeature> {
    let camera_from_hall = (*pose * camera.body_from_camera).inverse();
    let mut seen = Vec::new();
    for k in 0..10_u32 {
        let (y, z) = (f64::from(k % 5) * 1.5 - 2.0, 2.0 + f64::from(k / 5) * 1.5);
        for (dy, dz) in [(0.0, 0.0), (-0.5, 0.0), (-0.5, 0.5), (0.0, 0.5)] {
            let place = Point::new(10.0, y + dy, z + dz);
            let (pixel, _) = camera.project(&(camera_from_hall * place)).expect("in view");
            seen.push(PointFeature { place, pixel });
        }
    }
    seen
}

/// Half a pixel of blur: without noise a search ends sooner than in flight.
fn blurred(mut features: Vec<PointFeature>) -> Vec<PointFeature> {
    let mut noise = SeedBook::new(1).stream("blur");
    for feature in &mut features {
        feature.pixel += Vector2::new(noise.normal(), noise.normal()) * 0.5;
    }
    features
}

fn vision_fix(c: &mut Criterion) {
    let (truth, settings) = (state().hall_from_body, Settings::default());
    let near = truth.perturbed(&Vector3::new(0.05, -0.03, 0.02), &Vector3::new(0.01, 0.0, -0.02));
    for (lens, camera) in [("", camera()), ("_fisheye", fisheye())] {
        let features = blurred(ten_tags(&camera, &truth));
        for (start, prior) in [("warm", Some(&near)), ("cold", None)] {
            let fix = solve(&camera, &features, prior, &settings).expect("a fix");
            assert!((fix.hall_from_body.origin - truth.origin).coords.norm() < 0.1);
            c.bench_function(&format!("fix_10_tags_{start}{lens}"), |b| {
                b.iter(|| solve(&camera, black_box(&features), prior, &settings));
            });
        }
    }
}

fn frame(features: &[PointFeature], camera: &CameraModel) -> Frame {
    let sighting = |(k, feature): (usize, &PointFeature)| Sighting {
        place: feature.place,
        pixel: feature.pixel,
        offset_s: 0.0,
        place_idx: k / 4,
    };
    Frame {
        camera: Arc::new(camera.clone()),
        points: features.iter().enumerate().map(sighting).collect(),
        corner_sigma_px: 0.4,
        capture_sigma_s: 0.002,
    }
}

/// A state that owes something to the places of forty tags, each hung 5 mm well.
fn owing(start: &FilterState) -> FilterState {
    let mut state = FilterState { places: PlaceErrors::new(0.005), ..start.clone() };
    let camera = camera();
    for first in [30, 20, 10, 0] {
        let mut frame = frame(&ten_tags(&camera, &state.hall_from_body), &camera);
        frame.points.iter_mut().for_each(|point| point.place_idx += first);
        assert!(fuse(&mut state, &Vector3::zeros(), &frame).0.is_fused);
    }
    FilterState { P: start.P, ..state }
}

fn tight(c: &mut Criterion) {
    let (camera, mut start, rate) = (camera(), state(), Vector3::new(0.02, 0.1, -0.05));
    start.P = Covariance::identity() * 1e-4;
    let seen_from = start
        .hall_from_body
        .perturbed(&Vector3::new(0.01, -0.01, 0.005), &Vector3::new(0.002, 0.001, -0.003));
    let frame = frame(&ten_tags(&camera, &seen_from), &camera);
    for (name, start) in [("", start.clone()), ("_placed", owing(&start))] {
        let mut once = start.clone();
        let (outcome, _) = fuse(&mut once, &rate, &frame);
        assert!(outcome.is_fused && outcome.n_used == 40);
        c.bench_function(&format!("tight_update_10_tags{name}"), |b| {
            b.iter_batched_ref(
                || start.clone(),
                |state| fuse(state, &rate, black_box(&frame)),
                BatchSize::SmallInput,
            );
        });
    }
    let (placed, sample, noise) = (owing(&start), imu(1), ImuNoise::default());
    c.bench_function("imu_propagation_placed", |b| {
        b.iter(|| black_box(&placed).propagated(black_box(&sample), sample.at, &noise));
    });
    c.bench_function("total_cov_placed", |b| b.iter(|| black_box(&placed).total_cov()));
}

fn late_frames(c: &mut Criterion) {
    late_frame(c, "", state());
    late_frame(c, "_placed", owing(&state()));
}

fn late_frame(c: &mut Criterion, name: &str, start: FilterState) {
    let (full, camera) = (ring(start), camera());
    let frame_at = |step: i64| {
        let pose = full.state_at(at(step)).expect("inside").hall_from_body;
        frame(&ten_tags(&camera, &pose), &camera)
    };
    // Frames at 20 Hz; the one before the last comes 150 ms late, when three others are in.
    let mut waiting = full.clone();
    for step in [100, 110, 120, 130, 140, 150, 160, 180, 190, 200] {
        waiting.insert_frame(at(step), frame_at(step), |_, _| None);
    }
    let late = frame_at(170);
    let placed = waiting.clone().insert_frame(at(170), late.clone(), |_, _| None);
    assert!(matches!(placed, FrameInsertion::Placed(placed) if placed.tight.is_fused));
    c.bench_function(&format!("tight_frame_150_ms_late{name}"), |b| {
        b.iter_batched_ref(
            || {
                let mut ring = waiting.clone();
                ring.push_imu(imu(201));
                (ring, late.clone())
            },
            |(ring, late)| ring.insert_frame(at(170), late.clone(), |_, _| None),
            BatchSize::SmallInput,
        );
    });
    c.bench_function(&format!("error_transition_100_ms{name}"), |b| {
        b.iter(|| waiting.error_transition(black_box(at(175)), black_box(at(195))));
    });
}

criterion_group!(benches, propagation, late_fix, vision_fix, tight, late_frames);
criterion_main!(benches);
