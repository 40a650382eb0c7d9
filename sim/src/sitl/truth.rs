//! What the simulators say of their vehicle.

use super::earth::{Earth, Place};
use mavlink::dialects::ardupilotmega::{HIL_STATE_QUATERNION_DATA, MavMessage, SIM_STATE_DATA};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Where a simulated vehicle truly is; north-east-down and forward-right-down, as on the wire.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Where.
    pub place: Place,
    /// Attitude: takes body axes (FRD) to NED.
    pub ned_from_body: UnitQuaternion<f64>,
    /// Velocity in NED, m/s.
    pub velocity_ned_mps: Vector3<f64>,
    /// Turn rate in FRD, rad/s.
    pub rate_frd_radps: Vector3<f64>,
    /// How its degrees were made.
    pub earth: Earth,
}

/// A message that should tell the truth and does not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum TruthError {
    /// `SIM_STATE` without whole degrees: single precision is good to half a metre only.
    #[error("SIM_STATE without lat_int and lon_int: ArduPilot is older than 4.1")]
    NoWholeDegrees,
    /// A number that is none.
    #[error("the truth is not finite")]
    NotFinite,
}

/// The truth in a message; `None` for every other message.
#[must_use]
pub fn truth_of(message: &MavMessage) -> Option<Result<Truth, TruthError>> {
    match message {
        MavMessage::HIL_STATE_QUATERNION(data) => Some(of_px4(data)),
        MavMessage::SIM_STATE(data) => Some(of_ardupilot(data)),
        _ => None,
    }
}

/// PX4's: latitude and longitude in 1e-7°, altitude in mm, velocity in cm/s. Its time is always 0,
/// and its accelerations are cut to whole m/s²: neither is read.
fn of_px4(data: &HIL_STATE_QUATERNION_DATA) -> Result<Truth, TruthError> {
    let velocity_cmps = Vector3::new(data.vx, data.vy, data.vz);
    Ok(Truth {
        place: place(data.lat, data.lon, f64::from(data.alt) * 1e-3),
        ned_from_body: attitude(data.attitude_quaternion)?,
        velocity_ned_mps: velocity_cmps.map(|v| f64::from(v) * 1e-2),
        rate_frd_radps: finite([data.rollspeed, data.pitchspeed, data.yawspeed])?,
        earth: Earth::Wgs84,
    })
}

/// `ArduPilot`'s: its `lat` and `lon` hold 1e-7° in single precision, so only the whole ones count.
fn of_ardupilot(data: &SIM_STATE_DATA) -> Result<Truth, TruthError> {
    if data.lat_int == 0 && data.lon_int == 0 {
        return Err(TruthError::NoWholeDegrees);
    }
    let [altitude_m, ..] = <[f64; 3]>::from(finite([data.alt; 3])?);
    Ok(Truth {
        place: place(data.lat_int, data.lon_int, altitude_m),
        ned_from_body: attitude([data.q1, data.q2, data.q3, data.q4])?,
        velocity_ned_mps: finite([data.vn, data.ve, data.vd])?,
        rate_frd_radps: finite([data.xgyro, data.ygyro, data.zgyro])?,
        earth: Earth::ArduPilot,
    })
}

fn place(latitude_e7: i32, longitude_e7: i32, altitude_m: f64) -> Place {
    let [latitude_rad, longitude_rad] =
        [latitude_e7, longitude_e7].map(|e7| (f64::from(e7) * 1e-7).to_radians());
    Place { latitude_rad, longitude_rad, altitude_m }
}

fn attitude(wxyz: [f32; 4]) -> Result<UnitQuaternion<f64>, TruthError> {
    let [w, x, y, z] = wxyz.map(f64::from);
    let q = Quaternion::new(w, x, y, z);
    let is_one = q.norm().is_finite() && q.norm() > 0.5;
    is_one.then(|| UnitQuaternion::new_normalize(q)).ok_or(TruthError::NotFinite)
}

fn finite(xyz: [f32; 3]) -> Result<Vector3<f64>, TruthError> {
    let v = Vector3::from(xyz.map(f64::from));
    v.iter().all(|c| c.is_finite()).then_some(v).ok_or(TruthError::NotFinite)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn px4s_units_are_read() {
        let told = truth_of(&MavMessage::HIL_STATE_QUATERNION(HIL_STATE_QUATERNION_DATA {
            // Yaw of 90°: east.
            attitude_quaternion: [0.5_f32.sqrt(), 0.0, 0.0, 0.5_f32.sqrt()],
            yawspeed: 0.25,
            lat: 473_977_420,
            lon: -85_455_940,
            alt: 489_400,
            vx: 150,
            vy: -20,
            vz: -100,
            ..HIL_STATE_QUATERNION_DATA::DEFAULT
        }));
        let truth = told.expect("a truth").expect("finite");
        assert!((truth.place.latitude_rad.to_degrees() - 47.397_742).abs() < 1e-9);
        assert!((truth.place.longitude_rad.to_degrees() + 8.545_594).abs() < 1e-9);
        assert!((truth.place.altitude_m - 489.4).abs() < 1e-9);
        assert!((truth.velocity_ned_mps - Vector3::new(1.5, -0.2, -1.0)).norm() < 1e-9);
        assert!((truth.ned_from_body * Vector3::x() - Vector3::y()).norm() < 1e-6);
        assert!((truth.rate_frd_radps.z - 0.25).abs() < 1e-9);
    }

    #[test]
    fn ardupilots_whole_degrees_are_read_and_demanded() {
        let data = SIM_STATE_DATA {
            q1: 1.0,
            // The firmware puts 1e-7° in single precision here: not to be read.
            lat: 1.0,
            lon: 2.0,
            alt: 584.09,
            vn: 1.0,
            vd: 0.5,
            lat_int: -353_632_621,
            lon_int: 1_491_652_374,
            ..SIM_STATE_DATA::DEFAULT
        };
        let truth = truth_of(&MavMessage::SIM_STATE(data.clone())).expect("one").expect("finite");
        assert!((truth.place.latitude_rad.to_degrees() + 35.363_262_1).abs() < 1e-9);
        assert!((truth.place.longitude_rad.to_degrees() - 149.165_237_4).abs() < 1e-9);
        assert!((truth.velocity_ned_mps - Vector3::new(1.0, 0.0, 0.5)).norm() < 1e-9);
        let old = SIM_STATE_DATA { lat_int: 0, lon_int: 0, ..data.clone() };
        let told = truth_of(&MavMessage::SIM_STATE(old)).expect("one");
        assert_eq!(told, Err(TruthError::NoWholeDegrees));
        let broken = SIM_STATE_DATA { vn: f32::NAN, ..data };
        let told = truth_of(&MavMessage::SIM_STATE(broken)).expect("one");
        assert_eq!(told, Err(TruthError::NotFinite));
    }
}
