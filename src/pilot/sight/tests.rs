use super::*;
use crate::geometry::{Rotation, Transform};
use crate::stats::SeedBook;
use nalgebra::Matrix6;

const OLDEST: Duration = Duration::from_millis(300);
const CAMERA: CameraId = CameraId(0);
const SIGMA_M: f64 = 0.01;

fn at_ms(ms: u64) -> Stamp<Mono> {
    Stamp::ZERO.plus(Duration::from_millis(ms))
}

fn fix(x_m: f64) -> FixOutcome {
    FixOutcome {
        hall_from_body: Transform {
            rotation: Rotation::identity(),
            origin: Point::new(x_m, 3.0, 4.0),
        },
        pose_cov: Matrix6::identity() * SIGMA_M * SIGMA_M,
        residual_rms_px: 0.3,
        n_points: 16,
        q_pos: 50.0,
        q_position: 50.0,
    }
}

#[test]
fn a_straight_flight_is_told_at_the_instant_asked_for() {
    let mut sight = Sight::default();
    for (ms, x_m) in [(1_000, 2.0), (1_050, 2.1), (1_100, 2.2)] {
        sight.take(at_ms(ms), CAMERA, fix(x_m));
    }
    // 2 m/s along x, asked for 80 ms after the frame.
    let told = sight.tell(at_ms(1_180), OLDEST, 0.25, 7).unwrap();
    assert!((told.hall_from_body.origin.coords - Vector3::new(2.36, 3.0, 4.0)).norm() < 1e-9);
    assert!((told.velocity_mps.coords - Vector3::new(2.0, 0.0, 0.0)).norm() < 1e-9);
    assert_eq!((told.at, told.reset_counter), (at_ms(1_180), 7));
    // By hand: σ_v² = 2e-4/0.01 + 0.075² = 0.025625, cov(p, v) = 1e-4/0.1; carried on by τ = 0.08:
    // σ_p² = 1e-4 + 2 τ 1e-3 + τ² σ_v² + (0.75 τ²)², σ_v² + (1.5 τ)².
    assert!((told.error_cov[(0, 0)] - 4.470_4e-4).abs() < 1e-9, "{}", told.error_cov[(0, 0)]);
    assert!((told.error_cov[(VEL.start, VEL.start)] - 0.040_025).abs() < 1e-9);
    assert_eq!(sight.tell(at_ms(1_190), OLDEST, 0.25, 7), None, "told once");
}

#[test]
fn lone_old_and_contradicting_frames_tell_nothing() {
    let mut sight = Sight::default();
    sight.take(at_ms(1_000), CAMERA, fix(2.0));
    assert_eq!(sight.tell(at_ms(1_010), OLDEST, 0.25, 0), None, "no velocity");
    sight.take(at_ms(1_100), CAMERA, fix(2.2));
    assert_eq!(sight.tell(at_ms(1_401), OLDEST, 0.25, 0), None, "too old");
    sight.take(at_ms(1_200), CAMERA, fix(9.0));
    assert_eq!(sight.tell(at_ms(1_210), OLDEST, 0.25, 0), None, "a jump of 7 m");
    sight.take(at_ms(1_300), CAMERA, fix(9.2));
    assert!(sight.tell(at_ms(1_310), OLDEST, 0.25, 0).is_some(), "the next one decides");
    // A frame that comes out of order changes nothing.
    sight.take(at_ms(1_250), CAMERA, fix(9.1));
    assert_eq!(sight.tell(at_ms(1_320), OLDEST, 0.25, 0), None);
}

#[test]
fn a_repeated_picture_is_no_vehicle_that_stands() {
    let mut sight = Sight::default();
    for ms in (1_000..2_000).step_by(50) {
        sight.take(at_ms(ms), CAMERA, fix(2.0));
        assert_eq!(sight.tell(at_ms(ms + 10), OLDEST, 0.25, 0), None);
    }
}

#[test]
fn noise_of_fast_frames_and_a_second_camera_silence_nobody() {
    let mut noise = SeedBook::new(3).stream("sight");
    let mut sight = Sight::default();
    let (mut n_told, mut worst_mps) = (0, 0.0_f64);
    for ms in (1_000..2_000).step_by(8) {
        let x_m = 1e-3 * f64::from(u32::try_from(ms).unwrap());
        sight.take(at_ms(ms), CAMERA, fix(x_m + SIGMA_M * noise.normal()));
        // Its mounting is off by 5 cm.
        sight.take(at_ms(ms + 3), CameraId(1), fix(x_m + 0.05));
        if let Some(told) = sight.tell(at_ms(ms + 5), OLDEST, 0.25, 0) {
            n_told += 1;
            let sigma_mps = told.error_cov[(VEL.start, VEL.start)].sqrt();
            worst_mps = worst_mps.max((told.velocity_mps.coords.x - 1.0).abs() / sigma_mps);
        }
    }
    assert!(n_told > 110 && worst_mps < 4.0, "{n_told} told, {worst_mps:.1} σ");
    // Once the first is silent, the other one is heard.
    assert_eq!(sight.camera, Some(CAMERA));
    for (ms, x_m) in [(2_400, 2.45), (2_450, 2.5), (2_500, 2.55)] {
        sight.take(at_ms(ms), CameraId(1), fix(x_m));
    }
    let told = sight.tell(at_ms(2_510), OLDEST, 0.25, 0).unwrap();
    assert!((told.hall_from_body.origin.coords.x - 2.56).abs() < 1e-9);
}

#[test]
fn wild_and_vague_fixes_are_not_told() {
    let mut sight = Sight::default();
    let vague = |x_m: f64| FixOutcome { pose_cov: Matrix6::identity(), ..fix(x_m) };
    // 4 m to and fro is within 3 σ of two fixes.
    for (ms, x_m) in [(1_000, 2.0), (1_100, 6.0), (1_200, 2.1), (1_300, 6.1)] {
        sight.take(at_ms(ms), CAMERA, vague(x_m));
        assert_eq!(sight.tell(at_ms(ms + 5), OLDEST, 0.25, 0), None);
        assert_eq!(sight.tell(at_ms(ms + 5), OLDEST, 10.0, 0), None, "and not at 40 m/s");
    }
}

#[test]
fn nobody_is_made_to_jump() {
    let still = |at, x_m: f64| {
        let seen = |at| Seen { at, fix: fix(x_m) };
        NavEstimate { at, ..of_two_frames(&seen(at_ms(900)), &seen(at_ms(1_000)), 0) }
    };
    let mut sight = Sight::default();
    sight.note_told(&still(at_ms(1_000), 2.0));
    assert!(sight.is_followed(at_ms(5_900)) && !sight.is_followed(at_ms(6_000)));
    // Two tags that were moved, so that the vehicle seems to be 1.5 m off: never.
    for ms in (1_100..5_000).step_by(100) {
        sight.take(at_ms(ms), CAMERA, fix(3.5 + 1e-6 * f64::from(u32::try_from(ms).unwrap())));
        assert_eq!(sight.tell(at_ms(ms + 10), OLDEST, 0.25, 0), None, "{ms}");
    }
    sight.forget_told();
    assert!(!sight.is_followed(at_ms(1_310)));
    // Where it was going it may be.
    sight = Sight::default();
    sight.note_told(&still(at_ms(1_000), 2.0));
    for (ms, x_m) in [(1_100, 2.02), (1_200, 2.04), (1_300, 2.06)] {
        sight.take(at_ms(ms), CAMERA, fix(x_m));
    }
    assert!(sight.tell(at_ms(1_310), OLDEST, 0.25, 0).is_some());
}
