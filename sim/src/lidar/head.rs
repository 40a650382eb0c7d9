//! The turning head: its speed wanders, it starts slowly, and it can be held.

use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::{Mono, Stamp};

/// A motor reaches 63 % of its speed after this long, s.
const SPIN_UP_S: f64 = 0.4;
/// A head that runs on after its motor was switched off, s.
const SPIN_DOWN_S: f64 = 0.3;

/// A head and its motor.
#[derive(Debug, Clone)]
pub(super) struct Head {
    nominal_dps: f64,
    jitter_ratio: f64,
    error_ratio: f64,
    noise: Noise,
    /// Share of the nominal speed when the motor was last switched, and when that was.
    switched: (f64, Stamp<Mono>),
    is_driven: bool,
    is_held: bool,
}

impl Head {
    /// A head that has been turning for long.
    pub(super) fn turning(turns_per_s: f64, jitter_ratio: f64, seeds: SeedBook) -> Self {
        Self {
            nominal_dps: turns_per_s * 360.0,
            jitter_ratio,
            error_ratio: 0.0,
            noise: seeds.stream("lidar.speed"),
            switched: (1.0, Stamp::ZERO),
            is_driven: true,
            is_held: false,
        }
    }

    /// A head at rest.
    pub(super) fn at_rest(turns_per_s: f64, jitter_ratio: f64, seeds: SeedBook) -> Self {
        let head = Self::turning(turns_per_s, jitter_ratio, seeds);
        Self { switched: (0.0, Stamp::ZERO), is_driven: false, ..head }
    }

    /// Switches the motor.
    pub(super) fn drive(&mut self, is_driven: bool, now: Stamp<Mono>) {
        if self.is_driven != is_driven {
            self.switched = (self.share(now), now);
            self.is_driven = is_driven;
        }
    }

    /// Holds the head, as a cable or a branch does, or lets it go.
    pub(super) fn hold(&mut self, is_held: bool, now: Stamp<Mono>) {
        if self.is_held != is_held {
            self.switched = (0.0, now);
            self.is_held = is_held;
        }
    }

    /// Share of the nominal speed.
    pub(super) fn share(&self, now: Stamp<Mono>) -> f64 {
        if self.is_held {
            return 0.0;
        }
        let (from, at) = self.switched;
        let (target, time_s) = if self.is_driven { (1.0, SPIN_UP_S) } else { (0.0, SPIN_DOWN_S) };
        target + (from - target) * (-now.since(at).as_secs_f64() / time_s).exp()
    }

    pub(super) const fn is_held(&self) -> bool {
        self.is_held
    }

    /// The speed of the next packet, °/s; it wanders with a memory of about 50 packets.
    pub(super) fn next_speed_dps(&mut self, now: Stamp<Mono>) -> f64 {
        const MEMORY: f64 = 0.98;
        let kick = (1.0 - MEMORY * MEMORY).sqrt() * self.jitter_ratio;
        self.error_ratio = MEMORY * self.error_ratio + kick * self.noise.normal();
        self.nominal_dps * (1.0 + self.error_ratio) * self.share(now)
    }
}
