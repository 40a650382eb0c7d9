//! What each RPLIDAR says of itself. Where a real unit's answers are known, these are they.

use super::Format;

/// What turns the head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Motor {
    /// The modem line DTR.
    Dtr,
    /// A duty, by request F0.
    Pwm,
    /// A speed, by request A8.
    Speed,
    /// The sensor itself, while it scans.
    Internal,
}

/// One way to scan.
#[derive(Debug, Clone)]
pub(super) struct Mode {
    name: &'static str,
    pub(super) period_us: f64,
    max_distance_m: f64,
    pub(super) format: Format,
}

/// The firmware's answers.
#[derive(Debug, Clone)]
pub(super) struct Catalogue {
    model: u8,
    firmware: (u8, u8),
    hardware: u8,
    pub(super) motor: Motor,
    pub(super) modes: Vec<Mode>,
    typical: u16,
}

const fn mode(name: &'static str, period_us: f64, max_distance_m: f64, format: Format) -> Mode {
    Mode { name, period_us, max_distance_m, format }
}

impl Catalogue {
    /// Of the sensor with this model byte; an A1 for one that is unknown.
    pub(super) fn of(model: u8) -> Self {
        use Format::{Dense, Hq, Legacy, Standard, Ultra, UltraDense};
        let dense = |standard_us, dense_us, reach_m| {
            vec![
                mode("Standard", standard_us, reach_m, Standard),
                mode("DenseBoost", dense_us, reach_m, Dense),
                mode("UltraDense", dense_us, reach_m, UltraDense),
                mode("HQ", standard_us, reach_m, Hq),
            ]
        };
        let triangulating = |periods_us: [f64; 5], reach_m| {
            let names = ["Standard", "Express", "Boost", "Sensitivity", "Stability"];
            let formats = [Standard, Legacy, Ultra, Ultra, Ultra];
            let modes = names.into_iter().zip(periods_us).zip(formats);
            modes.map(|((name, us), format)| mode(name, us, reach_m, format)).collect()
        };
        let (firmware, hardware, motor, modes, typical) = match model >> 4 {
            2 if model == 0x2C => {
                let modes = triangulating([250.0, 125.0, 62.5, 62.5, 100.0], 12.0);
                ((1, 32), 6, Motor::Pwm, modes, 3)
            }
            2 => {
                let modes = triangulating([500.0, 250.0, 125.0, 125.0, 200.0], 12.0);
                ((1, 29), 4, Motor::Pwm, modes, 3)
            }
            3 => {
                let modes = triangulating([250.0, 125.0, 62.5, 62.5, 100.0], 25.0);
                ((1, 28), 7, Motor::Pwm, modes, 3)
            }
            4 => {
                let modes = vec![mode("Standard", 200.0, 16.0, Standard)];
                ((1, 2), 18, Motor::Internal, modes, 0)
            }
            6 => ((1, 28), 18, Motor::Speed, dense(244.0, 108.0, 40.0), 1),
            7 => ((1, 2), 18, Motor::Speed, dense(125.0, 31.25, 30.0), 1),
            8 => ((1, 2), 18, Motor::Speed, dense(125.0, 31.25, 40.0), 1),
            _ => {
                let modes = triangulating([508.0, 254.0, 127.0, 127.0, 201.0], 12.0);
                ((1, 29), 7, Motor::Dtr, modes, 3)
            }
        };
        Self { model, firmware, hardware, motor, modes, typical }
    }

    pub(super) fn info(&self) -> [u8; 20] {
        let mut info = [0; 20];
        info[..4].copy_from_slice(&[self.model, self.firmware.1, self.firmware.0, self.hardware]);
        for (byte, serial) in info[4..].iter_mut().zip(0xA0..) {
            *byte = serial;
        }
        info
    }

    pub(super) fn banner(&self) -> Vec<u8> {
        format!(
            "RP LIDAR System.\r\nFirmware Ver {}.{:02} - rtm, HW Ver {}\r\nModel: {:02X}\r\n",
            self.firmware.0, self.firmware.1, self.hardware, self.model,
        )
        .into_bytes()
    }

    /// Standard and express sample times, µs.
    pub(super) fn sample_rates(&self) -> [u8; 4] {
        let whole = |k: usize| {
            let us = self.modes.get(k).map_or(0.0, |mode| mode.period_us);
            u16::try_from(super::super::whole(us)).unwrap_or(u16::MAX).to_le_bytes()
        };
        let ([s0, s1], [e0, e1]) = (whole(0), whole(1));
        [s0, s1, e0, e1]
    }

    /// An item of the configuration; items that are not known are not answered.
    pub(super) fn conf(&self, item: u32, mode: Option<usize>) -> Option<Vec<u8>> {
        let of_mode = || mode.and_then(|mode| self.modes.get(mode));
        let q8 = |value: f64| super::super::whole(value * 256.0).to_le_bytes().to_vec();
        Some(match item {
            0x01 => [600_u16.to_le_bytes(), 660_u16.to_le_bytes()].concat(),
            0x70 => u16::try_from(self.modes.len()).ok()?.to_le_bytes().to_vec(),
            0x71 => q8(of_mode()?.period_us),
            0x74 => q8(of_mode()?.max_distance_m),
            0x75 => vec![of_mode()?.format.kind()],
            0x7C => self.typical.to_le_bytes().to_vec(),
            0x7F => [of_mode()?.name.as_bytes(), &[0]].concat(),
            _ => return None,
        })
    }
}
