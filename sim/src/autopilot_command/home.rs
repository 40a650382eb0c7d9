//! Where on the globe the stub's open floor lies, and the truth of its vehicle in degrees.
//!
//! Each flavour goes the way of its own simulator: PX4's with the radii of curvature of WGS84,
//! `ArduPilot`'s with its sphere; both cut to whole steps, as theirs do.

use crate::autopilot::Flavour;
use crate::vehicle::Vehicle;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::MavMessage;
use nalgebra::Vector3;
use std::str::FromStr;

/// A place and a heading, as `ArduPilot`'s simulator takes them: `LAT,LON,ALT,HEADING`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Home {
    latitude_deg: f64,
    longitude_deg: f64,
    altitude_m: f64,
    /// Of the nose, from north to the east, degrees.
    heading_deg: f64,
}

impl FromStr for Home {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is not LAT,LON,ALT,HEADING in degrees and metres");
        let numbers = text.split(',').map(str::parse::<f64>).collect::<Result<Vec<_>, _>>();
        match numbers.map_err(|_| wrong())?.as_slice() {
            &[latitude_deg, longitude_deg, altitude_m, heading_deg]
                if latitude_deg.abs() < 89.0
                    && longitude_deg.abs() <= 180.0
                    && altitude_m.abs() < 1e4
                    && heading_deg.abs() <= 360.0 =>
            {
                Ok(Self { latitude_deg, longitude_deg, altitude_m, heading_deg })
            }
            _ => Err(wrong()),
        }
    }
}

impl Home {
    /// Heading of a vehicle that stands there, from x (north) towards y (west), rad.
    pub(super) const fn yaw_rad(&self) -> f64 {
        -self.heading_deg.to_radians()
    }

    /// What the flavour's simulator says of its vehicle.
    pub(super) fn truth(&self, flavour: Flavour, vehicle: &Vehicle) -> MavMessage {
        match flavour {
            Flavour::Px4 => MavMessage::HIL_STATE_QUATERNION(self.hil_state(vehicle)),
            Flavour::ArduPilot => MavMessage::SIM_STATE(self.sim_state(vehicle)),
        }
    }

    fn hil_state(&self, vehicle: &Vehicle) -> m::HIL_STATE_QUATERNION_DATA {
        let Told { place_m, velocity_mps, wxyz, rate_radps } = told(vehicle);
        let (sin, cos) = self.latitude_deg.to_radians().sin_cos();
        let w = (1.0 - WGS84_E2 * sin * sin).sqrt();
        let meridian_m = WGS84_A_M * (1.0 - WGS84_E2) / w.powi(3) + self.altitude_m;
        let parallel_m = (WGS84_A_M / w + self.altitude_m) * cos;
        let [vx, vy, vz] = <[f64; 3]>::from(velocity_mps * 100.0).map(cut_small);
        let [rollspeed, pitchspeed, yawspeed] = rate_radps;
        m::HIL_STATE_QUATERNION_DATA {
            attitude_quaternion: wxyz,
            rollspeed,
            pitchspeed,
            yawspeed,
            lat: cut((self.latitude_deg + (place_m.x / meridian_m).to_degrees()) * 1e7),
            lon: cut((self.longitude_deg + (place_m.y / parallel_m).to_degrees()) * 1e7),
            alt: cut((self.altitude_m - place_m.z) * 1e3),
            vx,
            vy,
            vz,
            ..m::HIL_STATE_QUATERNION_DATA::DEFAULT
        }
    }

    /// As `Location::offset` goes: the parallel's length is that of the middle latitude.
    fn sim_state(&self, vehicle: &Vehicle) -> m::SIM_STATE_DATA {
        let Told { place_m, velocity_mps, wxyz: [q1, q2, q3, q4], rate_radps } = told(vehicle);
        let (home_lat, home_lon) = (cut(self.latitude_deg * 1e7), cut(self.longitude_deg * 1e7));
        let d_lat = cut(place_m.x / ARDUPILOT_M_PER_E7);
        let middle_deg = f64::from(home_lat + d_lat / 2) * 1e-7;
        let d_lon = cut(place_m.y / ARDUPILOT_M_PER_E7 / middle_deg.to_radians().cos());
        let [vn, ve, vd] = <[f64; 3]>::from(velocity_mps).map(single);
        let [xgyro, ygyro, zgyro] = rate_radps;
        m::SIM_STATE_DATA {
            q1,
            q2,
            q3,
            q4,
            xgyro,
            ygyro,
            zgyro,
            lat: single(f64::from(home_lat + d_lat)),
            lon: single(f64::from(home_lon + d_lon)),
            alt: single(f64::from(cut((self.altitude_m - place_m.z) * 1e2)) * 1e-2),
            vn,
            ve,
            vd,
            lat_int: home_lat + d_lat,
            lon_int: home_lon + d_lon,
            ..m::SIM_STATE_DATA::DEFAULT
        }
    }
}

const WGS84_A_M: f64 = 6_378_137.0;
const WGS84_E2: f64 = 6.694_379_990_14e-3;
/// `LOCATION_SCALING_FACTOR`: metres per 1e-7° of latitude.
const ARDUPILOT_M_PER_E7: f64 = 0.011_131_884_502_145_034;

/// True motion in NED and FRD.
struct Told {
    place_m: Vector3<f64>,
    velocity_mps: Vector3<f64>,
    wxyz: [f32; 4],
    rate_radps: [f32; 3],
}

fn told(vehicle: &Vehicle) -> Told {
    let pose = vehicle.hall_from_body();
    let down = |v: &Vector3<f64>| Vector3::new(v.x, -v.y, -v.z);
    let q = pose.rotation.quaternion();
    Told {
        place_m: down(&pose.origin.coords),
        velocity_mps: down(&vehicle.velocity_mps().coords),
        wxyz: [q.w, q.i, -q.j, -q.k].map(single),
        rate_radps: <[f64; 3]>::from(down(vehicle.rate_radps())).map(single),
    }
}

/// A cast of the firmware: towards zero.
#[expect(clippy::cast_possible_truncation, reason = "as the firmware does; the cast saturates")]
const fn cut(value: f64) -> i32 {
    value as i32
}

#[expect(clippy::cast_possible_truncation, reason = "as the firmware does; the cast saturates")]
const fn cut_small(value: f64) -> i16 {
    value as i16
}

#[expect(clippy::cast_possible_truncation, reason = "the wire holds single precision")]
const fn single(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn homes_are_read_as_the_simulator_reads_them() {
        let home: Home = "-35.363261,149.165230,584,353".parse().expect("a home");
        assert!((home.latitude_deg + 35.363_261).abs() < 1e-12);
        assert!((home.yaw_rad() + 353_f64.to_radians()).abs() < 1e-12);
        for text in ["", "1,2,3", "1,2,3,4,5", "91,0,0,0", "a,b,c,d", "NaN,0,0,0"] {
            assert!(text.parse::<Home>().is_err(), "{text}");
        }
    }
}
