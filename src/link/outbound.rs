//! Setpoints and the own pose as MAVLink carries them.

use super::AUTOPILOT_COMPONENT;
use super::dialect::Dialect;
use super::frames::{half_turn, half_turned, ned_from_frd_wxyz};
use crate::geometry::skew;
use crate::messages::{NavEstimate, Setpoint, state};
use crate::time::{Mono, Stamp};
use mavlink::dialects::ardupilotmega::{
    MavEstimatorType, MavFrame, MavMessage, ODOMETRY_DATA, PositionTargetTypemask,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3};

/// Below this cosine of the pitch, roll and yaw cannot be told apart; no variance is claimed.
const MIN_COS_PITCH: f64 = 0.1;
/// The position σ at which ODOMETRY's quality reaches its lowest good value 1, m.
const WORST_SIGMA_M: f64 = 1.0;

type Jacobian = SMatrix<f64, 6, 15>;

/// The number in single precision, unless it is NaN, infinite or too large for that.
pub(crate) fn finite_f32(value: f64) -> Option<f32> {
    #[expect(clippy::cast_possible_truncation, reason = "an overflow is infinite and refused")]
    let single = value as f32;
    single.is_finite().then_some(single)
}

fn finite_vector(v: &Vector3<f64>) -> Option<[f32; 3]> {
    Some([finite_f32(v.x)?, finite_f32(v.y)?, finite_f32(v.z)?])
}

/// Milliseconds of this computer's clock as MAVLink's `time_boot_ms`; wraps after 49.7 days.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the field wraps by definition"
)]
pub(crate) const fn wire_millis(at: Stamp<Mono>) -> u32 {
    at.nanos().div_euclid(1_000_000) as u32
}

/// `SET_POSITION_TARGET_LOCAL_NED` with position, velocity, acceleration, yaw and yaw rate, all
/// of them used; `None` if a number cannot be sent.
///
/// The velocity is not only for a flight without lag: `ArduPilot` flies on to a lone position for
/// ever, and brakes `GUID_TIMEOUT` after the last velocity.
pub(crate) fn setpoint(setpoint: &Setpoint, target_system: u8) -> Option<MavMessage> {
    let [x, y, z] = finite_vector(&half_turned(&setpoint.position.coords))?;
    let [vx, vy, vz] = finite_vector(&half_turned(&setpoint.velocity_mps.coords))?;
    let [afx, afy, afz] = finite_vector(&half_turned(&setpoint.accel_mps2.coords))?;
    Some(MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        time_boot_ms: wire_millis(setpoint.at),
        x,
        y,
        z,
        vx,
        vy,
        vz,
        afx,
        afy,
        afz,
        yaw: finite_f32(-crate::units::wrapped_rad(setpoint.yaw_rad))?,
        yaw_rate: finite_f32(-setpoint.yaw_rate_radps)?,
        type_mask: PositionTargetTypemask::empty(),
        target_system,
        target_component: AUTOPILOT_COMPONENT,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
    }))
}

/// `ODOMETRY` as a vision estimate: pose in local NED, velocity in body FRD, as the autopilot's
/// family reads it; `None` if a number cannot be sent.
///
/// `time_usec` is this computer's clock, the same that answers TIMESYNC requests.
pub(crate) fn odometry(estimate: &NavEstimate, dialect: Dialect) -> Option<MavMessage> {
    let pose = &estimate.hall_from_body;
    let velocity_body = pose.rotation.inverse() * estimate.velocity_mps;
    let [x, y, z] = finite_vector(&half_turned(&pose.origin.coords))?;
    let [vx, vy, vz] = finite_vector(&half_turned(&velocity_body.coords))?;
    let [rollspeed, pitchspeed, yawspeed] = finite_vector(&half_turned(&estimate.gyro_radps))?;
    let [w, i, j, k] = ned_from_frd_wxyz(&pose.rotation);
    Some(MavMessage::ODOMETRY(ODOMETRY_DATA {
        time_usec: u64::try_from(estimate.at.nanos() / 1_000).ok()?,
        x,
        y,
        z,
        q: [finite_f32(w)?, finite_f32(i)?, finite_f32(j)?, finite_f32(k)?],
        vx,
        vy,
        vz,
        rollspeed,
        pitchspeed,
        yawspeed,
        pose_covariance: dialect
            .pose_covariance(wire_covariance(estimate, &pose_jacobian(estimate)?)?),
        velocity_covariance: wire_covariance(estimate, &velocity_jacobian(estimate))?,
        frame_id: dialect.odometry_frame(),
        child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
        reset_counter: estimate.reset_counter,
        estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_VISION,
        quality: quality(estimate),
    }))
}

/// 100 at a perfect position, falling to 1 at [`WORST_SIGMA_M`] and beyond.
#[expect(clippy::cast_possible_truncation, reason = "the value lies between 1 and 100")]
pub(crate) fn quality(estimate: &NavEstimate) -> i8 {
    let sigma_ratio = (estimate.position_sigma_m().max() / WORST_SIGMA_M).clamp(0.0, 1.0);
    (100.0 * (1.0 - sigma_ratio)).round().max(1.0) as i8
}

/// Error of (x, y, z, roll, pitch, yaw) in NED and FRD by the error state, 6×15.
///
/// ```text
/// δp_ned = D δp            δ(roll, pitch, yaw) = E(roll, pitch) D δθ
///
///     ⎡ 1  sin φ tan θ  cos φ tan θ ⎤
/// E = ⎢ 0  cos φ        −sin φ      ⎥     φ roll, θ pitch in NED/FRD
///     ⎣ 0  sin φ/cos θ  cos φ/cos θ ⎦
/// ```
/// E turns body rates into Euler-angle rates (Diebel 2006, "Representing attitude", section 5.2),
/// and so small rotations in body axes into errors of the angles. `None` near θ = ±90°.
fn pose_jacobian(estimate: &NavEstimate) -> Option<Jacobian> {
    let (roll_rad, pitch_up_z, _) = estimate.hall_from_body.rotation.euler_rad();
    // Half a turn about x keeps roll and changes the sign of pitch and yaw.
    let pitch_rad = -pitch_up_z;
    let (sin_roll, cos_roll) = roll_rad.sin_cos();
    let cos_pitch = pitch_rad.cos();
    if cos_pitch.is_nan() || cos_pitch < MIN_COS_PITCH {
        return None;
    }
    let tan_pitch = pitch_rad.tan();
    #[rustfmt::skip]
    let euler_from_frd = Matrix3::new(
        1.0, sin_roll * tan_pitch, cos_roll * tan_pitch,
        0.0, cos_roll,             -sin_roll,
        0.0, sin_roll / cos_pitch, cos_roll / cos_pitch,
    );
    let mut jacobian = Jacobian::zeros();
    jacobian.fixed_view_mut::<3, 3>(0, state::POS.start).copy_from(&half_turn());
    let attitude = euler_from_frd * half_turn();
    jacobian.fixed_view_mut::<3, 3>(3, state::ATT.start).copy_from(&attitude);
    Some(jacobian)
}

/// Error of (vx, vy, vz, rates) in FRD by the error state, 6×15.
///
/// ```text
/// v_b = Rᵀ v,  R = R̂ exp(δθ^)   ⇒   δv_b = R̂ᵀ δv + v̂_b^ δθ
/// ω_b = ω_meas − b_g             ⇒   δω_b = −δb_g
/// ```
fn velocity_jacobian(estimate: &NavEstimate) -> Jacobian {
    let body_from_hall = estimate.hall_from_body.rotation.inverse();
    let velocity_body = body_from_hall * estimate.velocity_mps;
    let mut jacobian = Jacobian::zeros();
    let by_velocity = half_turn() * body_from_hall.matrix();
    jacobian.fixed_view_mut::<3, 3>(0, state::VEL.start).copy_from(&by_velocity);
    let by_attitude = half_turn() * skew(&velocity_body.coords);
    jacobian.fixed_view_mut::<3, 3>(0, state::ATT.start).copy_from(&by_attitude);
    jacobian.fixed_view_mut::<3, 3>(3, state::GYRO_BIAS.start).copy_from(&-half_turn());
    jacobian
}

/// J P Jᵀ as MAVLink's upper triangle, row by row; `None` if it is no covariance.
fn wire_covariance(estimate: &NavEstimate, jacobian: &Jacobian) -> Option<[f32; 21]> {
    let cov: Matrix6<f64> = jacobian * estimate.error_cov * jacobian.transpose();
    if cov.diagonal().iter().any(|variance| variance.is_nan() || *variance < 0.0) {
        return None;
    }
    let mut triangle = [0.0; 21];
    let upper = (0..6).flat_map(|row| (row..6).map(move |col| (row, col)));
    for (element, (row, col)) in triangle.iter_mut().zip(upper) {
        *element = finite_f32(cov[(row, col)])?;
    }
    Some(triangle)
}

#[cfg(test)]
mod tests;
