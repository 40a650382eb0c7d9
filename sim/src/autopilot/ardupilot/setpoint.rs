//! `SET_POSITION_TARGET_LOCAL_NED` as `ArduPilot` reads it.

#![expect(deprecated, reason = "the firmware listens to the body frames by these names")]

use crate::autopilot::estimator::Belief;
use mavlink::dialects::ardupilotmega::{MavFrame, SET_POSITION_TARGET_LOCAL_NED_DATA};
use nalgebra::{UnitQuaternion, Vector3};

/// What the companion wishes, NED.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Wish {
    pub(super) position_m: Option<Vector3<f64>>,
    pub(super) velocity_mps: Option<Vector3<f64>>,
    pub(super) accel_mps2: Option<Vector3<f64>>,
    pub(super) yaw_rad: Option<f64>,
    pub(super) yaw_rate_radps: Option<f64>,
}

/// Reads a message: any ignore bit of a triple ignores the whole triple, and an unknown frame
/// leaves a wish that cannot be flown.
pub(super) fn wish(message: &SET_POSITION_TARGET_LOCAL_NED_DATA, belief: &Belief) -> Wish {
    let mask = u32::from(message.type_mask.bits());
    let triple = |values: [f32; 3], first_bit: u32| {
        let is_ignored = (mask >> first_bit) & 0b111 != 0;
        let v = Vector3::from(values).map(f64::from);
        (!is_ignored && v.iter().all(|c| c.is_finite())).then_some(v)
    };
    let single = |value: f32, bit: u32| {
        ((mask >> bit) & 1 == 0 && value.is_finite()).then(|| f64::from(value))
    };
    let heading = UnitQuaternion::from_euler_angles(0.0, 0.0, belief.yaw_rad);
    let (turns, is_offset) = match message.coordinate_frame {
        MavFrame::MAV_FRAME_LOCAL_NED => (false, false),
        MavFrame::MAV_FRAME_LOCAL_OFFSET_NED => (false, true),
        MavFrame::MAV_FRAME_BODY_NED => (true, false),
        MavFrame::MAV_FRAME_BODY_OFFSET_NED => (true, true),
        _ => return Wish::default(),
    };
    let turned = |v: Vector3<f64>| if turns { heading * v } else { v };
    let offset = if is_offset { belief.position_m } else { Vector3::zeros() };
    Wish {
        position_m: triple([message.x, message.y, message.z], 0).map(|p| turned(p) + offset),
        velocity_mps: triple([message.vx, message.vy, message.vz], 3).map(turned),
        accel_mps2: triple([message.afx, message.afy, message.afz], 6).map(turned),
        yaw_rad: single(message.yaw, 10).map(|y| if turns { y + belief.yaw_rad } else { y }),
        yaw_rate_radps: single(message.yaw_rate, 11),
    }
}
