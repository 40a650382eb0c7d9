//! The parameters that matter here, with the defaults of `ArduCopter` 4.7, and their way on the
//! wire: always a number, whatever the type.

use mavlink::dialects::ardupilotmega::MavParamType;
use std::collections::BTreeMap;

/// The type of a parameter; `PARAM_VALUE` names it 2, 4, 6 or 9.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ApType {
    /// 8 bits.
    Int8,
    /// 16 bits.
    Int16,
    /// 32 bits.
    Int32,
    /// FLOAT.
    Real,
}

impl ApType {
    pub(super) const fn wire_type(self) -> MavParamType {
        match self {
            Self::Int8 => MavParamType::MAV_PARAM_TYPE_INT8,
            Self::Int16 => MavParamType::MAV_PARAM_TYPE_INT16,
            Self::Int32 => MavParamType::MAV_PARAM_TYPE_INT32,
            Self::Real => MavParamType::MAV_PARAM_TYPE_REAL32,
        }
    }

    /// A number as the type keeps it: whole numbers are rounded and bounded.
    fn kept(self, value: f32) -> f32 {
        let (low, high) = match self {
            Self::Int8 => (-128.0, 127.0),
            Self::Int16 => (-32_768.0, 32_767.0),
            // Whole numbers beyond 2^24 are not exact on this wire anyway.
            Self::Int32 => (-16_777_216.0, 16_777_216.0),
            Self::Real => return value,
        };
        value.round().clamp(low, high)
    }
}

use ApType::{Int8, Int16, Int32, Real};

/// Entries that the stub does not act on are there to be read and written.
const DEFAULTS: [(&str, ApType, f32); 66] = [
    ("ANGLE_MAX", Int16, 3000.0),
    ("ARMING_CHECK", Int32, 1.0),
    ("AHRS_EKF_TYPE", Int8, 3.0),
    ("AHRS_GPS_USE", Int8, 1.0),
    ("AHRS_ORIENTATION", Int8, 0.0),
    ("BATT_CAPACITY", Int32, 3300.0),
    ("BATT_CRT_MAH", Real, 0.0),
    ("BATT_CRT_VOLT", Real, 0.0),
    ("BATT_FS_CRT_ACT", Int8, 0.0),
    ("BATT_FS_LOW_ACT", Int8, 0.0),
    ("BATT_LOW_VOLT", Real, 10.5),
    ("BATT_MONITOR", Int8, 4.0),
    ("COMPASS_ENABLE", Int8, 1.0),
    ("COMPASS_USE", Int8, 1.0),
    ("COMPASS_USE2", Int8, 1.0),
    ("COMPASS_USE3", Int8, 1.0),
    ("DISARM_DELAY", Int8, 10.0),
    ("EK2_ENABLE", Int8, 0.0),
    ("EK3_ENABLE", Int8, 1.0),
    ("EK3_POS_I_GATE", Int16, 300.0),
    ("EK3_SRC1_POSXY", Int8, 3.0),
    ("EK3_SRC1_POSZ", Int8, 1.0),
    ("EK3_SRC1_VELXY", Int8, 3.0),
    ("EK3_SRC1_VELZ", Int8, 3.0),
    ("EK3_SRC1_YAW", Int8, 1.0),
    ("EK3_SRC_OPTIONS", Int16, 1.0),
    ("FENCE_ACTION", Int8, 1.0),
    ("FENCE_ENABLE", Int8, 0.0),
    ("FS_CRASH_CHECK", Int8, 1.0),
    ("FS_DR_ENABLE", Int8, 2.0),
    ("FS_DR_TIMEOUT", Int16, 30.0),
    ("FS_EKF_ACTION", Int8, 1.0),
    ("FS_EKF_THRESH", Real, 0.8),
    ("FS_GCS_ENABLE", Int8, 0.0),
    ("FS_GCS_TIMEOUT", Real, 5.0),
    ("FS_OPTIONS", Int16, 16.0),
    ("FS_THR_ENABLE", Int8, 1.0),
    ("FS_VIBE_ENABLE", Int8, 1.0),
    ("GPS1_TYPE", Int8, 1.0),
    ("GUID_OPTIONS", Int32, 0.0),
    ("GUID_TIMEOUT", Real, 3.0),
    ("LAND_SPEED", Int16, 50.0),
    ("LAND_SPEED_HIGH", Int16, 0.0),
    ("MAV_GCS_SYSID", Int16, 255.0),
    ("MAV_SYSID", Int16, 1.0),
    ("MOT_THST_HOVER", Real, 0.5),
    ("PILOT_SPEED_DN", Int16, 0.0),
    ("PILOT_SPEED_UP", Int16, 250.0),
    ("PLND_ENABLED", Int8, 0.0),
    ("RC_OPTIONS", Int32, 32.0),
    ("RTL_ALT", Int16, 1500.0),
    ("RTL_ALT_FINAL", Int16, 0.0),
    ("RTL_LOIT_TIME", Int32, 5000.0),
    ("SCHED_LOOP_RATE", Int16, 400.0),
    ("VISO_DELAY_MS", Int16, 10.0),
    ("VISO_POS_M_NSE", Real, 0.2),
    ("VISO_POS_X", Real, 0.0),
    ("VISO_POS_Y", Real, 0.0),
    ("VISO_POS_Z", Real, 0.0),
    ("VISO_QUAL_MIN", Int8, 0.0),
    ("VISO_TYPE", Int8, 0.0),
    ("VISO_VEL_M_NSE", Real, 0.1),
    ("VISO_YAW_M_NSE", Real, 0.2),
    ("WPNAV_SPEED", Int16, 1000.0),
    ("WPNAV_SPEED_DN", Int16, 150.0),
    ("WPNAV_SPEED_UP", Int16, 250.0),
];

/// What was seen to fly without GPS and without compass on ODOMETRY, and what a hall asks for: a
/// return that does not climb into the roof, and velocity that ends soon after the companion.
const INDOOR: [(&str, f32); 15] = [
    ("BATT_CRT_VOLT", 14.0),
    ("COMPASS_ENABLE", 0.0),
    ("EK3_SRC1_POSXY", 6.0),
    ("EK3_SRC1_POSZ", 6.0),
    ("EK3_SRC1_VELXY", 6.0),
    ("EK3_SRC1_VELZ", 6.0),
    ("EK3_SRC1_YAW", 6.0),
    ("FS_DR_ENABLE", 1.0),
    ("GPS1_TYPE", 0.0),
    ("GUID_TIMEOUT", 0.5),
    ("RTL_ALT", 0.0),
    ("VISO_TYPE", 1.0),
    ("WPNAV_SPEED", 300.0),
    ("WPNAV_SPEED_UP", 100.0),
    ("WPNAV_SPEED_DN", 70.0),
];

/// Parameters by name; the order of names is the order of indices.
#[derive(Debug, Clone, PartialEq)]
pub struct ApParams {
    values: BTreeMap<&'static str, (ApType, f32)>,
}

impl ApParams {
    /// The defaults of the firmware.
    #[must_use]
    pub fn defaults() -> Self {
        let entries = DEFAULTS.iter().map(|&(name, kind, value)| (name, (kind, value)));
        Self { values: entries.collect() }
    }

    /// The defaults with the set that flies indoors on external vision.
    #[must_use]
    pub fn indoor() -> Self {
        let mut table = Self::defaults();
        for (name, value) in INDOOR {
            table.set(name, value);
        }
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

    /// Type and value of the parameter called `name`.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<(ApType, f32)> {
        self.values.get(name).copied()
    }

    /// Sets a known parameter, rounded to its type; false if there is none of this name or the
    /// value is no number.
    pub fn set(&mut self, name: &str, value: f32) -> bool {
        let Some((kind, slot)) = self.values.get_mut(name) else { return false };
        if value.is_finite() {
            *slot = kind.kept(value);
        }
        value.is_finite()
    }

    /// Name, type and value at `index`.
    #[must_use]
    pub fn at(&self, index: usize) -> Option<(&'static str, ApType, f32)> {
        self.values.iter().nth(index).map(|(name, (kind, value))| (*name, *kind, *value))
    }

    /// Index of the parameter called `name`.
    #[must_use]
    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.values.keys().position(|key| *key == name)
    }

    /// A parameter's value; 0 if there is none of this name.
    pub(in crate::autopilot) fn real(&self, name: &str) -> f64 {
        self.get(name).map_or(0.0, |(_, value)| f64::from(value))
    }

    /// True if a whole-number parameter has this value.
    pub(in crate::autopilot) fn is(&self, name: &str, wanted: i32) -> bool {
        (self.real(name) - f64::from(wanted)).abs() < 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_travel_as_numbers_and_keep_their_type() {
        let mut table = ApParams::indoor();
        assert_eq!(table.get("VISO_TYPE"), Some((Int8, 1.0)));
        // A whole-number parameter that is written 2.6 keeps 3, one out of range its bound.
        assert!(table.set("VISO_TYPE", 2.6));
        assert_eq!(table.get("VISO_TYPE"), Some((Int8, 3.0)));
        assert!(table.set("VISO_TYPE", 900.0));
        assert_eq!(table.get("VISO_TYPE"), Some((Int8, 127.0)));
        assert!(table.set("GUID_TIMEOUT", 0.25));
        assert_eq!(table.get("GUID_TIMEOUT"), Some((Real, 0.25)));
        assert!(!table.set("SYSID_THISMAV", 1.0), "its name up to 4.6");
        assert!(!table.set("GUID_TIMEOUT", f32::NAN));
        assert_eq!(table.len(), DEFAULTS.len());
    }

    #[test]
    fn no_name_is_longer_than_the_wire_allows() {
        assert!(DEFAULTS.iter().all(|(name, ..)| name.len() <= 16));
        assert!(INDOOR.iter().all(|(name, _)| ApParams::defaults().get(name).is_some()));
    }
}
