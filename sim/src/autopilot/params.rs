//! The parameters that matter here, with the defaults of PX4 v1.16.

use mavlink::dialects::ardupilotmega::MavParamType;
use std::collections::BTreeMap;

/// The value of a parameter, in one of PX4's two types.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ParamValue {
    /// INT32; travels as a bit pattern in the float field.
    Int(i32),
    /// FLOAT.
    Real(f32),
}

impl ParamValue {
    /// The float field of `PARAM_VALUE`.
    #[must_use]
    pub const fn to_wire(self) -> f32 {
        match self {
            Self::Int(value) => f32::from_bits(value.cast_unsigned()),
            Self::Real(value) => value,
        }
    }

    /// The type that `PARAM_VALUE` names.
    pub(super) const fn wire_type(self) -> MavParamType {
        match self {
            Self::Int(_) => MavParamType::MAV_PARAM_TYPE_INT32,
            Self::Real(_) => MavParamType::MAV_PARAM_TYPE_REAL32,
        }
    }

    /// The value with the type of `self` from the float field of `PARAM_SET`.
    #[must_use]
    pub const fn with_wire(self, field: f32) -> Self {
        match self {
            Self::Int(_) => Self::Int(field.to_bits().cast_signed()),
            Self::Real(_) => Self::Real(field),
        }
    }
}

use ParamValue::{Int, Real};

/// External vision after PX4's `params_external_vision.yaml`. Entries that the stub does not act on
/// (lever arm, battery actions, RC) are there to be read and written.
const DEFAULTS: [(&str, ParamValue); 57] = [
    ("BAT1_CAPACITY", Real(-1.0)),
    ("BAT1_N_CELLS", Int(0)),
    ("BAT_CRIT_THR", Real(0.07)),
    ("BAT_LOW_THR", Real(0.15)),
    ("COM_ARM_WO_GPS", Int(1)),
    ("COM_DISARM_LAND", Real(2.0)),
    ("COM_DISARM_PRFLT", Real(10.0)),
    ("COM_FAIL_ACT_T", Real(5.0)),
    ("COM_LOW_BAT_ACT", Int(0)),
    ("COM_OBC_LOSS_T", Real(5.0)),
    ("COM_OBL_RC_ACT", Int(0)),
    ("COM_OF_LOSS_T", Real(1.0)),
    ("COM_POS_FS_EPH", Real(5.0)),
    ("COM_RCL_EXCEPT", Int(0)),
    ("COM_RC_IN_MODE", Int(3)),
    ("COM_RC_LOSS_T", Real(0.5)),
    ("COM_RC_OVERRIDE", Int(1)),
    ("COM_SPOOLUP_TIME", Real(1.0)),
    ("EKF2_BARO_CTRL", Int(1)),
    ("EKF2_DELAY_MAX", Real(200.0)),
    ("EKF2_EVA_NOISE", Real(0.1)),
    ("EKF2_EVP_GATE", Real(5.0)),
    ("EKF2_EVP_NOISE", Real(0.1)),
    ("EKF2_EVV_GATE", Real(3.0)),
    ("EKF2_EVV_NOISE", Real(0.1)),
    ("EKF2_EV_CTRL", Int(0)),
    ("EKF2_EV_DELAY", Real(0.0)),
    ("EKF2_EV_NOISE_MD", Int(0)),
    ("EKF2_EV_POS_X", Real(0.0)),
    ("EKF2_EV_POS_Y", Real(0.0)),
    ("EKF2_EV_POS_Z", Real(0.0)),
    ("EKF2_EV_QMIN", Int(0)),
    ("EKF2_GPS_CTRL", Int(7)),
    ("EKF2_HGT_REF", Int(1)),
    ("EKF2_MAG_TYPE", Int(0)),
    ("EKF2_NOAID_TOUT", Int(5_000_000)),
    ("EKF2_OF_CTRL", Int(1)),
    ("IMU_INTEG_RATE", Int(200)),
    ("MAV_1_RATE", Int(0)),
    ("MAV_COMP_ID", Int(1)),
    ("MAV_SYS_ID", Int(1)),
    ("MIS_TAKEOFF_ALT", Real(2.5)),
    ("MPC_LAND_SPEED", Real(0.7)),
    ("MPC_THR_HOVER", Real(0.5)),
    ("MPC_TILTMAX_AIR", Real(45.0)),
    ("MPC_TKO_RAMP_T", Real(3.0)),
    ("MPC_TKO_SPEED", Real(1.5)),
    ("MPC_XY_VEL_MAX", Real(12.0)),
    ("MPC_Z_VEL_MAX_DN", Real(1.5)),
    ("MPC_Z_VEL_MAX_UP", Real(3.0)),
    ("NAV_DLL_ACT", Int(0)),
    ("NAV_RCL_ACT", Int(2)),
    ("RTL_RETURN_ALT", Real(60.0)),
    ("SENS_EN_GPSSIM", Int(0)),
    ("SYS_AUTOSTART", Int(4001)),
    ("SYS_HAS_GPS", Int(1)),
    ("SYS_HAS_MAG", Int(1)),
];

/// What was seen to fly without GPS and without compass on external vision.
const INDOOR: [(&str, ParamValue); 12] = [
    ("COM_OBL_RC_ACT", Int(4)),
    ("COM_RCL_EXCEPT", Int(4)),
    ("COM_RC_IN_MODE", Int(4)),
    ("EKF2_EV_CTRL", Int(15)),
    ("EKF2_EV_DELAY", Real(10.0)),
    ("EKF2_GPS_CTRL", Int(0)),
    ("EKF2_HGT_REF", Int(3)),
    ("EKF2_MAG_TYPE", Int(5)),
    ("NAV_DLL_ACT", Int(0)),
    ("SENS_EN_GPSSIM", Int(1)),
    ("SYS_HAS_GPS", Int(0)),
    ("SYS_HAS_MAG", Int(0)),
];

/// Parameters by name; the order of names is the order of indices.
#[derive(Debug, Clone, PartialEq)]
pub struct ParamTable {
    values: BTreeMap<&'static str, ParamValue>,
}

impl ParamTable {
    /// The defaults of the firmware.
    #[must_use]
    pub fn defaults() -> Self {
        Self { values: BTreeMap::from(DEFAULTS) }
    }

    /// The defaults with the set that flies indoors on external vision.
    #[must_use]
    pub fn indoor() -> Self {
        let mut table = Self::defaults();
        table.values.extend(INDOOR);
        table
    }

    /// Number of parameters.
    #[must_use]
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// True without any parameter.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The value called `name`.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<ParamValue> {
        self.values.get(name).copied()
    }

    /// Sets a known parameter to a value of its type; false if either does not fit.
    pub fn set(&mut self, name: &str, value: ParamValue) -> bool {
        let Some(slot) = self.values.get_mut(name) else { return false };
        let fits = matches!((&*slot, value), (Int(_), Int(_)) | (Real(_), Real(_)));
        if fits {
            *slot = value;
        }
        fits
    }

    /// Name and value at `index`.
    #[must_use]
    pub fn at(&self, index: usize) -> Option<(&'static str, ParamValue)> {
        self.values.iter().nth(index).map(|(name, value)| (*name, *value))
    }

    /// Index of the parameter called `name`.
    #[must_use]
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.values.keys().position(|key| *key == name)
    }

    /// A whole-number parameter; 0 if there is none of this name.
    pub(super) fn int(&self, name: &str) -> i32 {
        match self.get(name) {
            Some(Int(value)) => value,
            _ => 0,
        }
    }

    /// A real parameter; 0 if there is none of this name.
    pub(super) fn real(&self, name: &str) -> f64 {
        match self.get(name) {
            Some(Real(value)) => f64::from(value),
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_travel_as_bit_patterns() {
        // Seen on PX4: INT32 1 arrives as 1.4e-45.
        assert_eq!(Int(1).to_wire().to_bits(), 1);
        assert_eq!(Int(0).with_wire(Int(-7).to_wire()), Int(-7));
        // A numeric 1.0 written into an INT32 is stored as 1065353216.
        assert_eq!(Int(0).with_wire(1.0), Int(1_065_353_216));
        assert_eq!(Real(0.0).with_wire(0.7), Real(0.7));
    }

    #[test]
    fn types_and_names_are_kept() {
        let mut table = ParamTable::indoor();
        assert!(!table.set("EKF2_EV_CTRL", Real(1.0)));
        assert!(!table.set("NO_SUCH_PARAM", Int(1)));
        assert!(table.set("EKF2_EV_CTRL", Int(11)));
        assert_eq!(table.int("EKF2_EV_CTRL"), 11);
        assert_eq!(table.len(), DEFAULTS.len());
        assert_eq!(table.index_of("BAT1_CAPACITY"), Some(0));
    }
}
