//! The flight battery: open-circuit curve, internal resistance, charge.

/// A lithium-polymer pack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BatterySettings {
    /// Cells in series.
    pub n_cells: u8,
    /// Charge of a full pack, A·h.
    pub capacity_ah: f64,
    /// Resistance of the pack, Ω.
    pub resistance_ohm: f64,
    /// Power that computers and sensors draw, W.
    pub avionics_w: f64,
    /// State of charge at the start, 0 to 1.
    pub initial_charge_ratio: f64,
}

impl Default for BatterySettings {
    fn default() -> Self {
        Self {
            n_cells: 4,
            capacity_ah: 5.0,
            resistance_ohm: 0.02,
            avionics_w: 8.0,
            initial_charge_ratio: 1.0,
        }
    }
}

/// Open-circuit voltage of one cell at 0, 10, … 100 % charge, V; a usual lithium-polymer curve.
const CELL_OPEN_CIRCUIT_V: [f64; 11] =
    [3.27, 3.61, 3.69, 3.71, 3.75, 3.80, 3.85, 3.92, 3.99, 4.08, 4.20];

/// A pack under load.
#[derive(Debug, Clone)]
pub struct Battery {
    settings: BatterySettings,
    charge_ratio: f64,
    voltage_v: f64,
    current_a: f64,
}

impl Battery {
    /// A pack at rest.
    #[must_use]
    pub fn new(settings: BatterySettings) -> Self {
        let charge_ratio = settings.initial_charge_ratio.clamp(0.0, 1.0);
        let mut battery = Self { settings, charge_ratio, voltage_v: 0.0, current_a: 0.0 };
        battery.voltage_v = battery.open_circuit_v();
        battery
    }

    /// Draws `rotor_w` and the avionics' power for `step_s`.
    ///
    /// ```text
    /// P = (V_oc − I R) I    ⇒    I = (V_oc − √(V_oc² − 4 R P)) / 2R
    /// ```
    pub fn step(&mut self, rotor_w: f64, step_s: f64) {
        let resistance = self.settings.resistance_ohm;
        let open_v = self.open_circuit_v();
        // Beyond the power that the pack can give at all, the current stays at that of the peak.
        let power_w =
            (rotor_w + self.settings.avionics_w).min(open_v * open_v / (4.0 * resistance));
        let root = (open_v * open_v - 4.0 * resistance * power_w).max(0.0).sqrt();
        self.current_a = (open_v - root) / (2.0 * resistance);
        self.voltage_v = open_v - self.current_a * resistance;
        let used_ah = self.current_a * step_s / 3600.0;
        self.charge_ratio = (self.charge_ratio - used_ah / self.settings.capacity_ah).max(0.0);
    }

    /// Sets the state of charge, 0 to 1.
    pub fn set_charge_ratio(&mut self, ratio: f64) {
        self.charge_ratio = ratio.clamp(0.0, 1.0);
    }

    /// State of charge, 0 to 1.
    #[must_use]
    pub const fn charge_ratio(&self) -> f64 {
        self.charge_ratio
    }

    /// Voltage under the present load, V.
    #[must_use]
    pub const fn voltage_v(&self) -> f64 {
        self.voltage_v
    }

    /// Current, A.
    #[must_use]
    pub const fn current_a(&self) -> f64 {
        self.current_a
    }

    /// Voltage without load at the present charge, V.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "the charge lies in 0 to 1")]
    #[expect(clippy::cast_sign_loss, reason = "the charge lies in 0 to 1")]
    pub fn open_circuit_v(&self) -> f64 {
        let place = self.charge_ratio * 10.0;
        let below = (place as usize).min(9);
        let share = place - f64::from(u8::try_from(below).unwrap_or(9));
        let cell_v =
            CELL_OPEN_CIRCUIT_V[below] * (1.0 - share) + CELL_OPEN_CIRCUIT_V[below + 1] * share;
        cell_v * f64::from(self.settings.n_cells)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn current_satisfies_the_power_balance() {
        let mut battery = Battery::new(BatterySettings::default());
        battery.step(222.0, 0.02);
        // 230 W from 16.8 V behind 0.02 Ω: I = 13.92 A by hand, 16.52 V remain.
        assert!((battery.current_a() - 13.92).abs() < 0.01);
        assert!((battery.voltage_v() * battery.current_a() - 230.0).abs() < 1e-9);
    }

    #[test]
    fn constant_power_empties_the_pack_after_its_energy() {
        let settings = BatterySettings { resistance_ohm: 1e-6, ..BatterySettings::default() };
        let mut battery = Battery::new(settings);
        let mut seconds = 0.0_f64;
        while battery.charge_ratio() > 0.0 {
            battery.step(222.0, 0.5);
            seconds += 0.5;
        }
        // Trapezoids under the curve: mean cell voltage 3.8135 V, so 4 · 3.8135 V · 5 Ah = 76.27 Wh.
        let expected_s = 76.27 * 3600.0 / 230.0;
        assert!((seconds / expected_s - 1.0).abs() < 1e-3, "{seconds} against {expected_s}");
    }
}
