//! Setpoints and poses against numbers computed by hand.

use super::*;
use crate::geometry::{Body, Direction, Hall, Point, Rotation, Transform};
use nalgebra::{SVector, UnitQuaternion};

/// Row-major index in the upper triangle of a 6×6 matrix, as MAVLink's documentation counts.
const DIAGONAL: [usize; 6] = [0, 6, 11, 15, 18, 20];

fn estimate(roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> NavEstimate {
    NavEstimate {
        at: Stamp::from_nanos(12_345_678_901),
        hall_from_body: Transform::new(
            Rotation::from_euler_rad(roll_rad, pitch_rad, yaw_rad),
            Point::new(1.5, -2.5, 4.0),
        ),
        velocity_mps: Direction::new(0.0, 2.0, 0.5),
        gyro_radps: Vector3::new(0.1, 0.2, 0.3),
        gyro_bias_radps: Vector3::zeros(),
        accel_bias_mps2: Vector3::zeros(),
        error_cov: SMatrix::identity() * 1e-4,
        reset_counter: 3,
    }
}

fn sent(estimate: &NavEstimate) -> ODOMETRY_DATA {
    match odometry(estimate, Dialect::Px4) {
        Some(MavMessage::ODOMETRY(data)) => data,
        other => panic!("{other:?}"),
    }
}

fn assert_near(got: f32, expected: f64, what: &str) {
    // Single precision at values below 10.
    assert!((f64::from(got) - expected).abs() < 2e-6, "{what}: {got} instead of {expected}");
}

#[test]
fn a_setpoint_is_turned_to_north_east_down() {
    let hall = Setpoint {
        at: Stamp::from_nanos(5_000_000_000),
        position: Point::new(3.0, -4.0, 2.5),
        velocity_mps: Direction::new(0.5, 0.25, -0.125),
        accel_mps2: Direction::new(-1.0, 2.0, 0.75),
        yaw_rad: 1.25,
        yaw_rate_radps: -0.5,
    };
    let Some(MavMessage::SET_POSITION_TARGET_LOCAL_NED(data)) = setpoint(&hall, 7) else {
        panic!("not sent")
    };
    assert_eq!((data.x, data.y, data.z), (3.0, 4.0, -2.5));
    assert_eq!((data.vx, data.vy, data.vz), (0.5, -0.25, 0.125));
    assert_eq!((data.afx, data.afy, data.afz), (-1.0, -2.0, -0.75));
    assert_eq!((data.yaw, data.yaw_rate), (-1.25, 0.5));
    assert_eq!(data.coordinate_frame, MavFrame::MAV_FRAME_LOCAL_NED);
    assert_eq!(data.type_mask.bits(), 0, "everything is used");
    assert_eq!((data.target_system, data.target_component, data.time_boot_ms), (7, 1, 5_000));
}

#[test]
fn a_pose_is_turned_to_north_east_down_and_forward_right_down() {
    // Level, heading along +y of the hall: 90° to the left, −90° in NED.
    let data = sent(&estimate(0.0, 0.0, std::f64::consts::FRAC_PI_2));
    assert_eq!((data.x, data.y, data.z), (1.5, 2.5, -4.0));
    let half = std::f64::consts::FRAC_1_SQRT_2;
    for (got, expected) in data.q.into_iter().zip([half, 0.0, 0.0, -half]) {
        assert_near(got, expected, "q");
    }
    // 2 m/s along +y is straight ahead, 0.5 m/s up is −0.5 down.
    assert_near(data.vx, 2.0, "vx");
    assert_near(data.vy, 0.0, "vy");
    assert_near(data.vz, -0.5, "vz");
    assert_near(data.rollspeed, 0.1, "rollspeed");
    assert_near(data.pitchspeed, -0.2, "pitchspeed");
    assert_near(data.yawspeed, -0.3, "yawspeed");
    assert_eq!(data.frame_id, MavFrame::MAV_FRAME_LOCAL_NED);
    assert_eq!(data.child_frame_id, MavFrame::MAV_FRAME_BODY_FRD);
    assert_eq!(data.estimator_type, MavEstimatorType::MAV_ESTIMATOR_TYPE_VISION);
    assert_eq!((data.reset_counter, data.time_usec), (3, 12_345_678));
    // σ = 1 cm of 1 m.
    assert_eq!(data.quality, 99);
}

#[test]
fn variances_land_on_their_axes() {
    // Level, heading 90° to the left: body x lies along hall y.
    let mut state = estimate(0.0, 0.0, std::f64::consts::FRAC_PI_2);
    let mut variances = SVector::<f64, 15>::zeros();
    for (element, value) in variances.iter_mut().zip([
        0.01, 0.04, 0.09, // position x, y, z of the hall
        0.001, 0.002, 0.003, // attitude about body x, y, z
        0.25, 0.36, 0.49, // velocity x, y, z of the hall
        1e-6, 2e-6, 3e-6, // gyro bias
    ]) {
        *element = value;
    }
    state.error_cov = SMatrix::from_diagonal(&variances);
    let data = sent(&state);
    let pose = DIAGONAL.map(|index| data.pose_covariance[index]);
    for (got, expected) in pose.into_iter().zip([0.01, 0.04, 0.09, 0.001, 0.002, 0.003]) {
        assert_near(got, expected, "pose variance");
    }
    // The velocity is (2, 0, 0.5) in FLU. Forward is hall y, left is −x, and a turn δ bends it:
    //   v × δ = (vy δz − vz δy, vz δx − vx δz, vx δy − vy δx)
    //   var x: 0.36 + 0.25·0.002              = 0.3605
    //   var y: 0.25 + 0.25·0.001 + 4·0.003    = 0.26225
    //   var z: 0.49 + 4·0.002                 = 0.498
    let velocity = DIAGONAL.map(|index| data.velocity_covariance[index]);
    for (got, expected) in velocity.into_iter().zip([0.3605, 0.26225, 0.498, 1e-6, 2e-6, 3e-6]) {
        assert_near(got, expected, "velocity variance");
    }
}

#[test]
fn euler_errors_match_a_central_difference_at_awkward_attitudes() {
    let step = 1e-6;
    for (roll, pitch, yaw) in [(0.3, -0.8, 1.1), (-0.6, 0.5, -2.9), (1.0, 0.2, 3.1)] {
        let state = estimate(roll, pitch, yaw);
        let analytic = pose_jacobian(&state).unwrap();
        for axis in 0..3 {
            let ned_euler = |sign: f64| {
                let delta = Vector3::ith(axis, sign * step);
                let turned: Rotation<Hall, Body> = state.hall_from_body.rotation.perturbed(&delta);
                let [w, x, y, z] = ned_from_frd_wxyz(&turned);
                let q = nalgebra::Quaternion::new(w, x, y, z);
                let (roll, pitch, yaw) = UnitQuaternion::from_quaternion(q).euler_angles();
                Vector3::new(roll, pitch, yaw)
            };
            let numeric = (ned_euler(1.0) - ned_euler(-1.0)) / (2.0 * step);
            let column: Vector3<f64> =
                analytic.fixed_view::<3, 1>(3, state::ATT.start + axis).into_owned();
            assert!((numeric - column).norm() < 1e-8, "{roll} {pitch} {yaw} axis {axis}");
        }
    }
}

#[test]
fn no_covariance_no_message() {
    let mut broken = estimate(0.1, 0.2, 0.3);
    broken.error_cov[(4, 4)] = f64::NAN;
    assert!(odometry(&broken, Dialect::Px4).is_none());
    let mut negative = estimate(0.1, 0.2, 0.3);
    negative.error_cov[(2, 2)] = -1.0;
    assert!(odometry(&negative, Dialect::Px4).is_none());
    let mut nowhere = estimate(0.1, 0.2, 0.3);
    nowhere.hall_from_body.origin = Point::new(0.0, f64::INFINITY, 0.0);
    assert!(odometry(&nowhere, Dialect::Px4).is_none());
    assert!(odometry(&estimate(0.0, std::f64::consts::FRAC_PI_2, 0.0), Dialect::Px4).is_none());
}

#[test]
fn quality_falls_with_the_position_sigma() {
    let with_sigma = |sigma_m: f64| {
        let mut state = estimate(0.0, 0.0, 0.0);
        state.error_cov[(1, 1)] = sigma_m * sigma_m;
        sent(&state).quality
    };
    assert_eq!((with_sigma(0.25), with_sigma(1.0), with_sigma(40.0)), (75, 1, 1));
}

#[test]
fn body_velocity_errors_match_a_central_difference_at_awkward_attitudes() {
    let step = 1e-6;
    for (roll, pitch, yaw) in [(0.3, -0.8, 1.1), (-0.6, 0.5, -2.9), (1.0, 0.2, 3.1)] {
        let state = estimate(roll, pitch, yaw);
        let analytic = velocity_jacobian(&state);
        for axis in 0..3 {
            let delta = Vector3::ith(axis, step);
            let velocity_frd = |turn: Vector3<f64>, push: Vector3<f64>| {
                let rotation = state.hall_from_body.rotation.perturbed(&turn);
                let velocity = Direction::<Hall>::from_coords(state.velocity_mps.coords + push);
                let body: Direction<Body> = rotation.inverse() * velocity;
                Vector3::new(body.coords.x, -body.coords.y, -body.coords.z)
            };
            let still = Vector3::zeros();
            let by_turn = velocity_frd(delta, still) - velocity_frd(-delta, still);
            let by_push = velocity_frd(still, delta) - velocity_frd(still, -delta);
            for (difference, start) in [(by_turn, state::ATT.start), (by_push, state::VEL.start)] {
                let column: Vector3<f64> =
                    analytic.fixed_view::<3, 1>(0, start + axis).into_owned();
                let numeric = difference / (2.0 * step);
                assert!((numeric - column).norm() < 1e-8, "{roll} {pitch} {yaw} axis {axis}");
            }
        }
    }
}

#[test]
fn ardupilot_gets_its_frame_and_covariance_with_the_same_numbers() {
    let mut state = estimate(0.1, -0.2, 0.3);
    state.error_cov[(1, 1)] = 0.09;
    let Some(MavMessage::ODOMETRY(data)) = odometry(&state, Dialect::ArduPilot) else {
        panic!("not sent")
    };
    let px4 = sent(&state);
    assert_eq!(data.frame_id, MavFrame::MAV_FRAME_LOCAL_FRD);
    assert_eq!(data.child_frame_id, MavFrame::MAV_FRAME_BODY_FRD);
    assert_eq!((data.x, data.y, data.z, data.q), (px4.x, px4.y, px4.z, px4.q));
    assert_eq!((data.vx, data.vy, data.vz), (px4.vx, px4.vy, px4.vz));
    // It adds the three up: σ = 0.3 m, the largest.
    let place: f32 = [0, 6, 11].iter().map(|&i: &usize| data.pose_covariance[i]).sum();
    assert_near(place.sqrt(), 0.3, "σ of the place");
}
