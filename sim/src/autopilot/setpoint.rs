//! Targets of the position controller, and `SET_POSITION_TARGET_LOCAL_NED`.

#![expect(deprecated, reason = "PX4 v1.16 knows this frame as BODY_NED")]

use super::estimator::Belief;
use mavlink::dialects::ardupilotmega::{
    MavFrame, PositionTargetTypemask as Mask, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use nalgebra::Vector3;

/// What to fly to, NED; `None` where nothing is asked of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Target {
    pub(super) position_m: [Option<f64>; 3],
    pub(super) velocity_mps: [Option<f64>; 3],
    pub(super) accel_mps2: [Option<f64>; 3],
    pub(super) yaw_rad: Option<f64>,
    pub(super) yaw_rate_radps: Option<f64>,
}

impl Target {
    /// Stay at a place with a heading.
    pub(super) fn hold(position_m: &Vector3<f64>, yaw_rad: f64) -> Self {
        Self {
            position_m: [0, 1, 2].map(|axis| Some(position_m[axis])),
            yaw_rad: Some(yaw_rad),
            ..Self::default()
        }
    }

    /// Sink at this speed over a place; without a place, with level attitude.
    pub(super) fn sink(place_m: Option<&Vector3<f64>>, yaw_rad: f64, speed_mps: f64) -> Self {
        Self {
            position_m: [place_m.map(|p| p.x), place_m.map(|p| p.y), None],
            velocity_mps: [None, None, Some(speed_mps)],
            accel_mps2: [Some(0.0), Some(0.0), None],
            yaw_rad: Some(yaw_rad),
            yaw_rate_radps: None,
        }
    }

    fn is_usable(&self) -> bool {
        let triples = [&self.position_m, &self.velocity_mps, &self.accel_mps2];
        triples.into_iter().flatten().any(Option::is_some)
    }
}

/// Why a message is no setpoint, in PX4's words.
pub(super) type Refusal = String;

/// Reads a message as PX4 does: ignore bits and NaN per axis, frames 1 and 8 only.
pub(super) fn from_message(
    message: &SET_POSITION_TARGET_LOCAL_NED_DATA,
    belief: &Belief,
) -> Result<Target, Refusal> {
    let mask = message.type_mask;
    let uses_accel = !mask.contains(
        Mask::POSITION_TARGET_TYPEMASK_AX_IGNORE
            | Mask::POSITION_TARGET_TYPEMASK_AY_IGNORE
            | Mask::POSITION_TARGET_TYPEMASK_AZ_IGNORE,
    );
    if mask.contains(Mask::POSITION_TARGET_TYPEMASK_FORCE_SET) && uses_accel {
        return Err("SET_POSITION_TARGET_LOCAL_NED force not supported".to_owned());
    }
    let axes = |values: [f32; 3], first_bit: u32| {
        let mut axis = 0;
        values.map(|value| {
            let is_ignored = (u32::from(mask.bits()) >> (first_bit + axis)) & 1 == 1;
            axis += 1;
            (!is_ignored && value.is_finite()).then_some(f64::from(value))
        })
    };
    let mut target = Target {
        position_m: axes([message.x, message.y, message.z], 0),
        velocity_mps: axes([message.vx, message.vy, message.vz], 3),
        accel_mps2: axes([message.afx, message.afy, message.afz], 6),
        yaw_rad: axes([message.yaw, 0.0, 0.0], 10)[0],
        yaw_rate_radps: axes([message.yaw_rate, 0.0, 0.0], 11)[0],
    };
    match message.coordinate_frame {
        MavFrame::MAV_FRAME_LOCAL_NED => {}
        MavFrame::MAV_FRAME_BODY_NED => turn_from_body(&mut target, belief),
        other => {
            let number = other as u32;
            return Err(format!(
                "SET_POSITION_TARGET_LOCAL_NED coordinate frame {number} unsupported"
            ));
        }
    }
    if target.is_usable() {
        Ok(target)
    } else {
        Err("SET_POSITION_TARGET_LOCAL_NED invalid".to_owned())
    }
}

/// `BODY_NED`: no position, velocity turned by the heading, acceleration by the attitude.
fn turn_from_body(target: &mut Target, belief: &Belief) {
    target.position_m = [None; 3];
    let heading = nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, belief.yaw_rad);
    target.velocity_mps = turned(&heading, target.velocity_mps);
    target.accel_mps2 = turned(&belief.attitude, target.accel_mps2);
}

fn turned(rotation: &nalgebra::UnitQuaternion<f64>, axes: [Option<f64>; 3]) -> [Option<f64>; 3] {
    let v = rotation * Vector3::from(axes.map(|axis| axis.unwrap_or(0.0)));
    let has_horizontal = axes[0].is_some() || axes[1].is_some();
    [has_horizontal.then_some(v.x), has_horizontal.then_some(v.y), axes[2].map(|_| v.z)]
}
