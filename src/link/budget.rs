//! Whether a serial line carries what is asked of it.
//!
//! ```text
//! needed = Σ rate × frame,   there are baud / 10 bytes per second: 8 data bits, start and stop bit
//! ```
//! Frames are MAVLink 2 at their longest, unsigned; a signature adds 13 bytes to each.
//!
//! PX4 sends no more than `MAV_x_RATE` bytes/s of its port, by default half of what the line carries,
//! and slows all its streams down alike until they fit: it is judged by that half.

use super::settings::{Address, Settings};

/// A line is not to be filled further than this; the rest is for texts, answers and parameters.
const LARGEST_LOAD: f64 = 0.9;
const SIGNATURE_BYTES: f64 = 13.0;

/// Bytes of a frame and times per second, from the autopilot; rates of the settings come on top: mode,
/// landed state, battery, TIMESYNC, and the dozen that PX4 keeps sending once to five times a second.
const FROM_AUTOPILOT: [(f64, f64); 5] =
    [(21.0, 51.0), (14.0, 5.0), (66.0, 1.0), (30.0, 20.0), (55.0, 30.0)];
/// What a port of PX4 is allowed by default, of what its line carries.
const PX4_SHARE: f64 = 0.5;
/// The same to the autopilot: ODOMETRY, setpoint, TIMESYNC, heartbeat, values and texts.
const TO_AUTOPILOT: [(f64, f64); 5] =
    [(245.0, 30.0), (65.0, 30.0), (30.0, 20.0), (21.0, 1.0), (66.0, 6.0)];
const HIGHRES_IMU_BYTES: f64 = 75.0;
/// `LOCAL_POSITION_NED` and `ATTITUDE_QUATERNION`.
const POSE_BYTES: f64 = 100.0;

/// What a serial line has to carry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkBudget {
    /// From the autopilot, bytes/s.
    pub inbound_bytes_per_s: f64,
    /// To the autopilot, bytes/s.
    pub outbound_bytes_per_s: f64,
    /// What the line carries in each direction, bytes/s.
    pub capacity_bytes_per_s: f64,
}

impl LinkBudget {
    /// The budget of a serial line; `None` where the way is no serial line.
    #[must_use]
    pub fn of(settings: &Settings) -> Option<Self> {
        let Address::Serial { baud, .. } = settings.address else { return None };
        let signature = if settings.security.signing.is_some() { SIGNATURE_BYTES } else { 0.0 };
        let sum = |frames: &[(f64, f64)]| -> f64 {
            frames.iter().map(|(bytes, hz)| (bytes + signature) * hz).sum()
        };
        let asked = [
            (HIGHRES_IMU_BYTES, settings.imu_rate_hz),
            // Two messages, so one signature more.
            (POSE_BYTES + signature, settings.autopilot_pose_rate_hz),
        ];
        Some(Self {
            inbound_bytes_per_s: sum(&FROM_AUTOPILOT) + sum(&asked),
            outbound_bytes_per_s: sum(&TO_AUTOPILOT),
            capacity_bytes_per_s: f64::from(baud) / 10.0,
        })
    }

    /// What PX4 sends at most while nobody has set `MAV_x_RATE` of its port, bytes/s.
    #[must_use]
    pub const fn px4_bytes_per_s(&self) -> f64 {
        PX4_SHARE * self.capacity_bytes_per_s
    }

    /// True if PX4 sends what is asked of it although nobody has set `MAV_x_RATE`.
    #[must_use]
    pub fn fits_px4_default(&self) -> bool {
        self.inbound_bytes_per_s <= self.px4_bytes_per_s()
    }

    /// True if the line carries both directions with room to spare.
    #[must_use]
    pub fn fits(&self) -> bool {
        let fullest = self.inbound_bytes_per_s.max(self.outbound_bytes_per_s);
        fullest <= LARGEST_LOAD * self.capacity_bytes_per_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn budget(address: &str, imu_rate_hz: f64) -> Option<LinkBudget> {
        let address = address.parse().unwrap();
        LinkBudget::of(&Settings { imu_rate_hz, ..Settings::new(address) })
    }

    #[test]
    fn a_slow_line_is_refused_and_a_usual_one_is_not() {
        // 200 × 75 + 10 × 100 + 51 × 21 + 5 × 14 + 66 + 20 × 30 + 30 × 55 = 19457 bytes/s in,
        // 30 × 245 + 30 × 65 + 20 × 30 + 21 + 6 × 66 = 10317 bytes/s out.
        let slow = budget("serial:/dev/ttyS0:57600", 200.0).unwrap();
        assert!((slow.inbound_bytes_per_s - 19_457.0).abs() < 1e-9);
        assert!((slow.outbound_bytes_per_s - 10_317.0).abs() < 1e-9);
        assert!(!slow.fits());
        assert!(!budget("serial:/dev/ttyS0:115200", 200.0).unwrap().fits());
        assert!(budget("serial:/dev/ttyS0:230400", 200.0).unwrap().fits());
        assert!(budget("serial:/dev/ttyS0:921600", 200.0).unwrap().fits());
        assert_eq!(budget("udpin:127.0.0.1:0", 200.0), None);
    }

    #[test]
    fn px4_sends_half_of_what_the_line_carries() {
        for (baud, fits) in [(230_400, false), (460_800, true), (921_600, true)] {
            let budget = budget(&format!("serial:/dev/ttyS0:{baud}"), 200.0).unwrap();
            assert!((budget.px4_bytes_per_s() - f64::from(baud) / 20.0).abs() < 1e-9);
            assert_eq!(budget.fits_px4_default(), fits, "{baud}");
        }
    }
}
