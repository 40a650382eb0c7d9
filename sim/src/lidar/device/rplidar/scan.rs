//! A running scan: frame after frame while the head turns.

use super::Format;
use super::formats::Shot;
use crate::lidar::Scene;
use crate::lidar::device::{Frame, sample_at, whole};
use crate::lidar::head::Head;
use stockpilot::time::{Mono, Stamp};

/// The distance for which the beam's direction is guessed first, mm.
const TYPICAL_MM: f64 = 3000.0;

/// A scan since its first sample.
#[derive(Debug)]
pub(super) struct Scan {
    format: Format,
    samples_per_s: f64,
    start: Stamp<Mono>,
    n_samples: u64,
    /// Angle of the head at the next frame, ° since the start of its turn.
    angle_deg: f64,
    /// Where the next frame begins, 1/64°, as the receiver is told.
    start_q6: u32,
    is_first: bool,
    /// The first sample of the next frame, which the last of this one refers to.
    ahead: Option<Shot>,
}

impl Scan {
    pub(super) fn new(format: Format, period_us: f64, angle_deg: f64, start: Stamp<Mono>) -> Self {
        Self {
            format,
            samples_per_s: 1e6 / period_us,
            start,
            n_samples: 0,
            angle_deg,
            start_q6: whole(angle_deg * 64.0),
            is_first: true,
            ahead: None,
        }
    }

    /// All frames whose samples, and the one after them, are measured by `until`.
    pub(super) fn advance(
        &mut self,
        until: Stamp<Mono>,
        head: &mut Head,
        scene: &mut dyn Scene,
        out: &mut Vec<Frame>,
    ) {
        let n = u64::from(self.format.samples());
        loop {
            let ready_at = sample_at(self.start, self.n_samples + n, self.samples_per_s);
            if ready_at > until {
                return;
            }
            let speed_dps = head.next_speed_dps(ready_at);
            let bytes = self.frame(speed_dps, scene);
            out.push(Frame { bytes, n_samples: n, ready_at });
        }
    }

    fn frame(&mut self, speed_dps: f64, scene: &mut dyn Scene) -> Vec<u8> {
        let n = self.format.samples();
        let span_deg = speed_dps * f64::from(n) / self.samples_per_s;
        let end_deg = self.angle_deg + span_deg;
        // The receiver spreads the samples evenly between two starts in 1/64°, so the beams do.
        let (start_q6, end_q6) = (self.start_q6, whole(end_deg * 64.0));
        let step_q6 = f64::from(end_q6 - start_q6) / f64::from(n);
        let head_deg = |k: u32| (f64::from(start_q6) + step_q6 * f64::from(k)) / 64.0;
        let first = self.ahead.take().unwrap_or_else(|| self.shoot(head_deg(0), 0, scene));
        let mut shots = vec![first];
        for k in 1..n {
            let shot = self.shoot(head_deg(k), k, scene);
            let starts_turn = (head_deg(k) / 360.0).floor() > (head_deg(k - 1) / 360.0).floor();
            shots.push(Shot { starts_turn, ..shot });
        }
        let next = self.shoot(head_deg(n), n, scene);
        let starts_turn = (head_deg(n) / 360.0).floor() > (head_deg(n - 1) / 360.0).floor();
        let next = Shot { starts_turn, ..next };
        let bytes = self.format.pack(start_q6, self.is_first, &shots, next);
        self.is_first = false;
        self.ahead = Some(next);
        self.n_samples += u64::from(n);
        let turns = end_q6 / 23_040;
        self.start_q6 = end_q6 - turns * 23_040;
        self.angle_deg = end_deg - 360.0 * f64::from(turns);
        bytes
    }

    /// Measures where the receiver will think that it was measured: the direction depends on the
    /// distance, so the distance is looked for first.
    fn shoot(&self, head_deg: f64, k: u32, scene: &mut dyn Scene) -> Shot {
        let at = sample_at(self.start, self.n_samples + u64::from(k), self.samples_per_s);
        let beam_deg =
            |dist_mm: f64| (head_deg - self.format.compensation_deg(dist_mm)).rem_euclid(360.0);
        let mut angle_deg = beam_deg(TYPICAL_MM);
        if matches!(self.format, Format::Legacy | Format::Ultra) {
            for _ in 0..2 {
                let dist_mm = scene.distance_m(at, angle_deg).map_or(0.0, |m| 1000.0 * m);
                angle_deg = beam_deg(dist_mm);
            }
        }
        let echo = scene.echo(at, angle_deg);
        let (dist_mm, intensity) =
            echo.map_or((0.0, 0), |echo| (1000.0 * echo.range_m, echo.intensity));
        Shot { angle_deg, dist_mm, intensity, starts_turn: false }
    }
}
