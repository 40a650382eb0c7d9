//! Conversions between SI and what devices and people use, in one place.

/// Standard gravity, m/s².
pub const GRAVITY_MPS2: f64 = 9.806_65;

/// Radians from degrees.
#[must_use]
pub fn rad_from_deg(deg: f64) -> f64 {
    deg.to_radians()
}

/// Degrees from radians.
#[must_use]
pub fn deg_from_rad(rad: f64) -> f64 {
    rad.to_degrees()
}

/// The same angle inside (−π, π].
///
/// A non-finite angle comes back as it is.
#[must_use]
pub fn wrapped_rad(rad: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let wrapped = rad.rem_euclid(TAU);
    if wrapped > PI { wrapped - TAU } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn wraps_across_south() {
        // 190° is −170°; the border itself belongs to +π.
        assert!((wrapped_rad(190.0_f64.to_radians()) + 170.0_f64.to_radians()).abs() < 1e-12);
        assert!((wrapped_rad(-PI) - PI).abs() < 1e-12);
        assert!((wrapped_rad(7.0 * PI) - PI).abs() < 1e-12);
    }
}
