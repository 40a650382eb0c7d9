//! What the controller and the take-off may do, read from either firmware's parameters.

use super::ardupilot::ApParams;
use super::params::ParamTable;

/// Bounds of the cascade.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    pub(super) tilt_rad: f64,
    pub(super) level_mps: f64,
    pub(super) up_mps: f64,
    pub(super) down_mps: f64,
}

/// How the rotors come up and the climb is let go.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lift {
    pub(super) spool_up_s: f64,
    pub(super) ramp_s: f64,
    pub(super) climb_mps: f64,
}

impl Limits {
    pub(super) fn px4(params: &ParamTable) -> Self {
        Self {
            tilt_rad: params.real("MPC_TILTMAX_AIR").to_radians(),
            level_mps: params.real("MPC_XY_VEL_MAX"),
            up_mps: params.real("MPC_Z_VEL_MAX_UP"),
            down_mps: params.real("MPC_Z_VEL_MAX_DN"),
        }
    }

    /// `ArduPilot` keeps centidegrees and centimetres per second.
    pub(super) fn ardupilot(params: &ApParams) -> Self {
        Self {
            tilt_rad: (params.real("ANGLE_MAX") * 1e-2).to_radians(),
            level_mps: params.real("WPNAV_SPEED") * 1e-2,
            up_mps: params.real("WPNAV_SPEED_UP") * 1e-2,
            down_mps: params.real("WPNAV_SPEED_DN") * 1e-2,
        }
    }
}

impl Lift {
    pub(super) fn px4(params: &ParamTable) -> Self {
        Self {
            spool_up_s: params.real("COM_SPOOLUP_TIME"),
            ramp_s: params.real("MPC_TKO_RAMP_T").max(0.01),
            climb_mps: params.real("MPC_TKO_SPEED"),
        }
    }

    pub(super) fn ardupilot(params: &ApParams) -> Self {
        let climb_mps = params.real("WPNAV_SPEED_UP") * 1e-2;
        Self { spool_up_s: 0.5, ramp_s: 1.0, climb_mps }
    }
}
