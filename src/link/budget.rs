//! Whether a serial line carries what is asked of it.
//!
//! ```text
//! needed = Σ rate × frame,   there are baud / 10 bytes per second: 8 data bits, start and stop bit
//! ```
//! Frames are MAVLink 2 at their longest, unsigned; a signature adds 13 bytes to each.

use super::settings::{Address, Settings};

/// A line is not to be filled further than this; the rest is for texts, answers and parameters.
const LARGEST_LOAD: f64 = 0.9;
const SIGNATURE_BYTES: f64 = 13.0;

/// Bytes of a frame and times per second, from the autopilot; rates of the settings come on top.
const FROM_AUTOPILOT: [(f64, f64); 4] = [(21.0, 30.0), (14.0, 5.0), (66.0, 1.0), (30.0, 20.0)];
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
        // 200 × 75 + 10 × 100 + 30 × 21 + 5 × 14 + 66 + 20 × 30 = 17366 bytes/s in,
        // 30 × 245 + 30 × 65 + 20 × 30 + 21 + 6 × 66 = 10317 bytes/s out.
        let slow = budget("serial:/dev/ttyS0:57600", 200.0).unwrap();
        assert!((slow.inbound_bytes_per_s - 17_366.0).abs() < 1e-9);
        assert!((slow.outbound_bytes_per_s - 10_317.0).abs() < 1e-9);
        assert!(!slow.fits());
        assert!(!budget("serial:/dev/ttyS0:115200", 200.0).unwrap().fits());
        assert!(budget("serial:/dev/ttyS0:230400", 200.0).unwrap().fits());
        assert!(budget("serial:/dev/ttyS0:921600", 200.0).unwrap().fits());
        assert_eq!(budget("udpin:127.0.0.1:0", 200.0), None);
    }
}
