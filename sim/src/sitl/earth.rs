//! From degrees to metres, as the simulators went the other way.
//!
//! Each simulator turns the metres of its vehicle into degrees with an earth of its own. Turned back
//! with another one, 20 m would be 7 cm longer or shorter than what its inertial sensors felt.

use nalgebra::Vector3;

/// Semi-major axis of WGS84, m.
const WGS84_A_M: f64 = 6_378_137.0;
/// First eccentricity of WGS84, squared.
const WGS84_E2: f64 = 6.694_379_990_14e-3;
/// The radius of `ArduPilot`'s `Location`, m.
const ARDUPILOT_RADIUS_M: f64 = 6_378_100.0;

/// A place by degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// North of the equator, rad.
    pub latitude_rad: f64,
    /// East of Greenwich, rad.
    pub longitude_rad: f64,
    /// Over the simulator's zero, m.
    pub altitude_m: f64,
}

/// The shape that a simulator gives the earth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Earth {
    /// The ellipsoid of PX4's simulation in hardware (v1.16).
    Wgs84,
    /// The sphere of `ArduPilot`, degrees of longitude shortened at the middle latitude.
    ArduPilot,
}

impl Earth {
    /// North, east, down of `here` from `start`, m.
    ///
    /// ```text
    /// Wgs84      Rᵀ(φ₀, λ₀) (ecef(here) − ecef(start))
    /// ArduPilot  (R Δφ,  R Δλ cos ½(φ + φ₀),  h₀ − h)
    /// ```
    /// Checked: `one_degree_has_its_published_length`, `both_earths_agree_with_radii_of_curvature`.
    #[must_use]
    pub fn ned_m(self, start: &Place, here: &Place) -> Vector3<f64> {
        match self {
            Self::Wgs84 => {
                let d = ecef_m(here) - ecef_m(start);
                let (sin_lat, cos_lat) = start.latitude_rad.sin_cos();
                let (sin_lon, cos_lon) = start.longitude_rad.sin_cos();
                let outward = cos_lon * d.x + sin_lon * d.y;
                Vector3::new(
                    cos_lat * d.z - sin_lat * outward,
                    cos_lon * d.y - sin_lon * d.x,
                    -cos_lat * outward - sin_lat * d.z,
                )
            }
            Self::ArduPilot => {
                let middle_rad = f64::midpoint(start.latitude_rad, here.latitude_rad);
                let turn_rad = wrapped(here.longitude_rad - start.longitude_rad);
                Vector3::new(
                    ARDUPILOT_RADIUS_M * (here.latitude_rad - start.latitude_rad),
                    ARDUPILOT_RADIUS_M * turn_rad * middle_rad.cos(),
                    start.altitude_m - here.altitude_m,
                )
            }
        }
    }
}

fn ecef_m(place: &Place) -> Vector3<f64> {
    let (sin_lat, cos_lat) = place.latitude_rad.sin_cos();
    let (sin_lon, cos_lon) = place.longitude_rad.sin_cos();
    let normal_m = WGS84_A_M / (1.0 - WGS84_E2 * sin_lat * sin_lat).sqrt();
    let outward_m = (normal_m + place.altitude_m) * cos_lat;
    Vector3::new(
        outward_m * cos_lon,
        outward_m * sin_lon,
        (normal_m * (1.0 - WGS84_E2) + place.altitude_m) * sin_lat,
    )
}

fn wrapped(angle_rad: f64) -> f64 {
    stockpilot::units::wrapped_rad(angle_rad)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_deg(latitude: f64, longitude: f64, altitude_m: f64) -> Place {
        let [latitude_rad, longitude_rad] = [latitude, longitude].map(f64::to_radians);
        Place { latitude_rad, longitude_rad, altitude_m }
    }

    #[test]
    fn one_degree_has_its_published_length() {
        // WGS84 at 45°: 111 131.8 m of latitude and 78 846.8 m of longitude per degree; here from
        // a thousandth of a degree, so that chord and arc are the same.
        let start = at_deg(45.0, 7.0, 0.0);
        let north = Earth::Wgs84.ned_m(&start, &at_deg(45.001, 7.0, 0.0));
        let east = Earth::Wgs84.ned_m(&start, &at_deg(45.0, 7.001, 0.0));
        assert!((north.x * 1e3 - 111_131.8).abs() < 1.0, "{north}");
        assert!((east.y * 1e3 - 78_846.8).abs() < 0.6, "{east}");
        // 60 nautical miles of ArduPilot's sphere: 6 378 100 m · π/180.
        let north = Earth::ArduPilot.ned_m(&start, &at_deg(45.001, 7.0, 0.0));
        assert!((north.x * 1e3 - 111_318.845).abs() < 0.01, "{north}");
    }

    #[test]
    fn both_earths_agree_with_radii_of_curvature() {
        // Closed forms of a small step: (M + h) Δφ north, (N + h) cos φ Δλ east.
        for (latitude, longitude, altitude_m) in [
            (47.397_742, 8.545_594, 489.4),
            (-35.363_262, 149.165_237, 584.0),
            (3.1, -179.999_99, 0.0),
        ] {
            let start = at_deg(latitude, longitude, altitude_m);
            let (d_lat, d_lon) = (2.3e-4_f64, -3.1e-4_f64);
            let here = at_deg(latitude + d_lat, longitude + d_lon, altitude_m + 7.5);
            let w = (1.0 - WGS84_E2 * start.latitude_rad.sin().powi(2)).sqrt();
            let normal_m = WGS84_A_M / w;
            let meridian_m = WGS84_A_M * (1.0 - WGS84_E2) / w.powi(3);
            let expected = Vector3::new(
                (meridian_m + altitude_m) * d_lat.to_radians(),
                (normal_m + altitude_m) * start.latitude_rad.cos() * d_lon.to_radians(),
                -7.5,
            );
            let ned = Earth::Wgs84.ned_m(&start, &here);
            // The earth falls away by d²/2R = 0.1 mm, and parallels converge by as much.
            assert!((ned - expected).norm() < 2e-3, "{ned} {expected}");
            let ned = Earth::ArduPilot.ned_m(&start, &here);
            // A sphere for an ellipsoid: 0.7 % at most.
            assert!((ned - expected).norm() < 7e-3 * expected.norm(), "{ned} {expected}");
        }
    }

    #[test]
    fn north_east_and_down_have_their_signs_in_every_quarter_of_the_globe() {
        for (latitude, longitude) in [(50.0, 8.0), (-35.0, 149.0), (35.0, -120.0), (-20.0, -60.0)] {
            for earth in [Earth::Wgs84, Earth::ArduPilot] {
                let start = at_deg(latitude, longitude, 100.0);
                let ned = |here: Place| earth.ned_m(&start, &here);
                let north = ned(at_deg(latitude + 1e-4, longitude, 100.0));
                let east = ned(at_deg(latitude, longitude + 1e-4, 100.0));
                let up = ned(at_deg(latitude, longitude, 110.0));
                assert!(north.x > 11.0 && north.yz().norm() < 1e-3, "{north}");
                assert!(east.y > 5.0 && east.xz().norm() < 1e-3, "{east}");
                assert!((up.z + 10.0).abs() < 1e-6 && up.xy().norm() < 1e-6, "{up}");
            }
        }
    }

    #[test]
    fn the_date_line_is_no_way_round_the_world() {
        let start = at_deg(10.0, 179.999_95, 0.0);
        for earth in [Earth::Wgs84, Earth::ArduPilot] {
            let east = earth.ned_m(&start, &at_deg(10.0, -179.999_95, 0.0));
            assert!((east.y - 10.97).abs() < 0.05, "{east}");
        }
    }
}
