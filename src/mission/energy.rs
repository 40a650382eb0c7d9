//! How far the battery still reaches, from what the flight has taken so far.

use crate::time::{Mono, Stamp};

/// Charge, metres and time since the flight began.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EnergyGauge {
    began: Option<Reading>,
    newest: Option<Reading>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Reading {
    charge_ratio: f64,
    flown_m: f64,
    at: Stamp<Mono>,
}

/// Less than this says nothing about the consumption: autopilots round to whole percents.
const LEAST_USED_RATIO: f64 = 0.02;

impl EnergyGauge {
    /// Forgets the last flight.
    pub const fn restart(&mut self) {
        self.began = None;
        self.newest = None;
    }

    /// Takes in the state of charge, 0 to 1, after so many metres of flight.
    pub fn read(&mut self, at: Stamp<Mono>, charge_ratio: f64, flown_m: f64) {
        let reading = Reading { charge_ratio, flown_m, at };
        self.began.get_or_insert(reading);
        self.newest = Some(reading);
    }

    /// Charge that `seconds` of flight will take at the consumption so far, 0 to 1; `None` while
    /// that is not known. By time, since a flight that stands still uses charge too.
    #[must_use]
    pub fn charge_for(&self, seconds: f64) -> Option<f64> {
        let (began, newest) = self.began.zip(self.newest)?;
        let used_ratio = began.charge_ratio - newest.charge_ratio;
        let flown_s = newest.at.seconds_since(began.at);
        let is_known = used_ratio >= LEAST_USED_RATIO && flown_s > 0.0;
        is_known.then(|| used_ratio / flown_s * seconds)
    }

    /// Seconds until the charge is down to `ratio`, at the consumption so far; `None` while that is
    /// not known.
    #[must_use]
    pub fn seconds_until(&self, ratio: f64) -> Option<f64> {
        let left_ratio = (self.newest?.charge_ratio - ratio).max(0.0);
        Some(left_ratio / self.charge_for(1.0)?)
    }

    /// Metres until the charge is down to `reserve_ratio`, at the consumption per metre so far;
    /// `None` while that is not known.
    ///
    /// A flight that stands still uses charge too: the metres per charge are those of the whole
    /// flight, so a slow one reaches less far.
    #[must_use]
    pub fn reach_m(&self, reserve_ratio: f64) -> Option<f64> {
        let (began, newest) = self.began.zip(self.newest)?;
        let used_ratio = began.charge_ratio - newest.charge_ratio;
        if used_ratio < LEAST_USED_RATIO {
            return None;
        }
        let metres_per_ratio = (newest.flown_m - began.flown_m) / used_ratio;
        Some(((newest.charge_ratio - reserve_ratio) * metres_per_ratio).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reach_is_that_of_a_calculation_by_hand() {
        let mut gauge = EnergyGauge::default();
        let at = |seconds| Stamp::ZERO.plus(std::time::Duration::from_secs(seconds));
        gauge.read(at(0), 0.90, 0.0);
        assert_eq!(gauge.reach_m(0.25), None);
        gauge.read(at(12), 0.89, 12.0);
        assert_eq!(gauge.charge_for(10.0), None);
        assert_eq!(gauge.reach_m(0.25), None, "one percent may be rounding");
        // 60 m for a tenth of the charge; 0.80 − 0.25 are 330 m.
        gauge.read(at(50), 0.80, 60.0);
        assert!((gauge.reach_m(0.25).unwrap() - 330.0).abs() < 1e-9);
        assert_eq!(gauge.reach_m(0.85), Some(0.0));
        // A tenth in 50 s: 30 s take 0.06.
        assert!((gauge.charge_for(30.0).unwrap() - 0.06).abs() < 1e-12);
        gauge.restart();
        assert_eq!(gauge.reach_m(0.25), None);
    }
}
