//! Every beam is stamped with the instant at which it was measured: on noisy lines, on lines that lose
//! whole frames, and with sensors that sample faster or slower than their makers state.
//!
//! The sensor sees nothing but the time: its range tells when it was measured.

use crate::support::{Bench, Clean, Line, Noisy, STEP};
use std::collections::VecDeque;
use std::time::Duration;
use stockpilot::lidar::{Family, Model, Request, ScanAssembler};
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::{Mono, Stamp};
use stockpilot_sim::lidar::{Echo, Frame, Scene};

/// One of each family, and each kind of counting: with a clock of its own, by capsules, by packets,
/// by nodes without a checksum.
const MODELS: [Model; 10] = [
    Model::Ld19,
    Model::Stl27l,
    Model::RplidarA3,
    Model::RplidarS1,
    Model::RplidarC1,
    Model::YdlidarX4,
    Model::YdlidarG4,
    Model::YdlidarTg15,
    Model::YdlidarTminiPro,
    Model::HokuyoUrg04lx,
];
/// The range grows by this in a second, then begins anew, m.
const NEAREST_M: f64 = 0.6;
const RISE_M: f64 = 4.5;
/// Nothing is judged before, s: motors start.
const SETTLING_S: f64 = 8.0;
/// The driver looks at the line every 2 ms, and a frame leaves one or two samples after its last.
/// Ranges tell the time to 4 mm, which is 1 ms.
const MEDIAN_LIMIT_MS: f64 = 2.5;
const WORST_LIMIT_MS: f64 = 6.0;

/// Nothing but time. `pace` is the speed of the sensor's clock.
struct Times {
    start: Stamp<Mono>,
    pace: f64,
}

impl Times {
    /// The sensor's instant at the computer's `now`.
    fn device_at(&self, now: Stamp<Mono>) -> Stamp<Mono> {
        self.start.plus(Duration::from_secs_f64(now.seconds_since(self.start) * self.pace))
    }

    /// The other way round.
    fn at(&self, device_at: Stamp<Mono>) -> Stamp<Mono> {
        self.start.plus(Duration::from_secs_f64(device_at.seconds_since(self.start) / self.pace))
    }
}

impl Scene for Times {
    fn distance_m(&mut self, at: Stamp<Mono>, _clockwise_deg: f64) -> Option<f64> {
        let true_s = at.seconds_since(self.start) / self.pace;
        Some(NEAREST_M + RISE_M * true_s.rem_euclid(1.0))
    }

    fn echo(&mut self, at: Stamp<Mono>, clockwise_deg: f64) -> Option<Echo> {
        let range_m = self.distance_m(at, clockwise_deg)?;
        Some(Echo { range_m, intensity: 100 })
    }
}

/// The sensor's transmitter: bytes leave at the line's speed, frame by frame.
struct Wire {
    byte_time_s: f64,
    free_at: Stamp<Mono>,
    under_way: VecDeque<(Stamp<Mono>, Vec<u8>)>,
}

impl Wire {
    fn new(model: Model, now: Stamp<Mono>) -> Self {
        Self {
            byte_time_s: baud(model).map_or(0.0, |baud| 10.0 / f64::from(baud)),
            free_at: now,
            under_way: VecDeque::new(),
        }
    }

    fn send(&mut self, ready_at: Stamp<Mono>, bytes: Vec<u8>) {
        #[expect(clippy::cast_precision_loss, reason = "a frame has less than 2^20 bytes")]
        let span_s = self.byte_time_s * bytes.len() as f64;
        self.free_at = ready_at.max(self.free_at).plus(Duration::from_secs_f64(span_s));
        self.under_way.push_back((self.free_at, bytes));
    }

    /// The next frame that has wholly come by `now`.
    fn receive(&mut self, now: Stamp<Mono>) -> Option<Vec<u8>> {
        let (sent_at, _) = self.under_way.front()?;
        if *sent_at > now { None } else { self.under_way.pop_front().map(|(_, bytes)| bytes) }
    }
}

/// The line's speed; none on USB.
fn baud(model: Model) -> Option<u32> {
    (model.family() != Family::Hokuyo).then(|| model.default_baud())
}

/// What stamps came to, ms; negative ones are early.
#[derive(Debug)]
struct Outcome {
    n_beams: usize,
    median_ms: f64,
    /// 1 % of the beams lie beyond each.
    lowest_ms: f64,
    highest_ms: f64,
    n_missing: u64,
    clock_restarts: u64,
}

/// A sensor whose clock has this pace, for so long on a clean line and then on this one.
fn stamped(model: Model, pace: f64, seconds: f64, line: &mut dyn Line) -> Outcome {
    let mut bench = Bench::new(model);
    bench.assembler = ScanAssembler::new(baud(model).unwrap_or(0));
    let mut wire = Wire::new(model, bench.now);
    let mut times = Times { start: bench.now, pace };
    let judged_from = bench.now.plus(Duration::from_secs_f64(SETTLING_S));
    let end = judged_from.plus(Duration::from_secs_f64(seconds));
    while bench.now < judged_from {
        step(&mut bench, &mut times, &mut wire, &mut Clean);
    }
    let before = bench.assembler.stats();
    bench.scans.clear();
    while bench.now < end {
        step(&mut bench, &mut times, &mut wire, line);
    }
    let beams = bench.scans.iter().flat_map(|scan| scan.beams.iter().map(move |b| (scan, b)));
    let mut errors_ms: Vec<f64> = beams
        .filter(|(_, beam)| beam.range_m > 0.0)
        .map(|(scan, beam)| {
            let told_s = (f64::from(beam.range_m) - NEAREST_M) / RISE_M;
            let error_s = scan.beam_at(beam).seconds_since(times.start) - told_s;
            1e3 * (error_s - error_s.round())
        })
        .collect();
    errors_ms.sort_by(f64::total_cmp);
    let at = |permille: usize| errors_ms[(errors_ms.len() - 1) * permille / 1000];
    let stats = bench.assembler.stats();
    Outcome {
        n_beams: errors_ms.len(),
        median_ms: at(500),
        lowest_ms: at(10),
        highest_ms: at(990),
        n_missing: stats.missing_samples - before.missing_samples,
        clock_restarts: stats.clock_restarts - before.clock_restarts,
    }
}

fn step(bench: &mut Bench, times: &mut Times, wire: &mut Wire, line: &mut dyn Line) {
    bench.now = bench.now.plus(STEP);
    let device_now = times.device_at(bench.now);
    while let Some(request) = bench.sensor.poll(bench.now) {
        if let Request::Send(bytes) = request {
            bench.device.hear(&bytes, device_now);
        }
    }
    let mut frames = Vec::new();
    bench.device.advance(device_now, times, &mut frames);
    for Frame { bytes, ready_at, .. } in frames {
        wire.send(times.at(ready_at), bytes);
    }
    let Bench { sensor, assembler, scans, now, .. } = bench;
    while let Some(bytes) = wire.receive(*now) {
        let bytes = line.carry(bytes);
        sensor.feed(&bytes, *now, &mut |packet| {
            assembler.push(packet, |scan| scans.push(scan));
        });
    }
}

fn judge(what: &str, model: Model, outcome: &Outcome) {
    assert!(outcome.n_beams > 500, "{model:?}, {what}: {outcome:?}");
    assert!(outcome.median_ms.abs() < MEDIAN_LIMIT_MS, "{model:?}, {what}: {outcome:?}");
    assert!(
        outcome.lowest_ms > -WORST_LIMIT_MS && outcome.highest_ms < WORST_LIMIT_MS,
        "{model:?}, {what}: {outcome:?}"
    );
}

#[test]
fn stamps_are_right_on_a_noisy_line() {
    for model in MODELS {
        for byte_ratio in [0.0, 0.001, 0.002, 0.005, 0.01] {
            // Of a UTM-30LX or URG-04LX block nothing comes through with so many wrong bytes.
            if model == Model::HokuyoUrg04lx && byte_ratio > 0.001 {
                continue;
            }
            let outcome = stamped(model, 1.0, 40.0, &mut Noisy::new(byte_ratio, 0.0));
            judge(&format!("{:.1} % wrong", 100.0 * byte_ratio), model, &outcome);
            let is_whole = outcome.n_missing == 0 && outcome.clock_restarts == 0;
            assert!(byte_ratio > 0.0 || is_whole, "{model:?}: {outcome:?}");
        }
    }
}

/// Loses whole frames, so that no byte tells of it, and halves others.
struct Losing(Noise);

impl Line for Losing {
    fn carry(&mut self, mut bytes: Vec<u8>) -> Vec<u8> {
        if self.0.chance(0.05) {
            bytes.clear();
        } else if self.0.chance(0.05) {
            bytes.truncate(bytes.len() / 3);
        }
        bytes
    }
}

#[test]
fn stamps_are_right_on_a_line_that_loses_frames() {
    for model in MODELS.into_iter().filter(|model| *model != Model::RplidarC1) {
        let mut line = Losing(SeedBook::new(21).stream("losses"));
        judge("loses frames", model, &stamped(model, 1.0, 30.0, &mut line));
    }
}

/// Loses everything for a while, once, from the middle of a frame to the middle of another.
struct Hole {
    n_frames: u32,
    lost: std::ops::RangeInclusive<u32>,
}

impl Line for Hole {
    fn carry(&mut self, mut bytes: Vec<u8>) -> Vec<u8> {
        self.n_frames += 1;
        let half = bytes.len() / 2;
        if self.n_frames == *self.lost.start() {
            bytes.truncate(half);
        } else if self.n_frames == *self.lost.end() {
            bytes.drain(..half);
        } else if self.lost.contains(&self.n_frames) {
            bytes.clear();
        }
        bytes
    }
}

#[test]
fn whole_turns_that_never_came_are_found_by_the_arrivals() {
    // At 10 turns/s an A3 sends 16.7 capsules in a turn, an X4 13.5 packets.
    for (model, n_frames) in
        [(Model::RplidarA3, 17), (Model::RplidarA3, 34), (Model::YdlidarX4, 14)]
    {
        let mut line = Hole { n_frames: 0, lost: 200..=200 + n_frames };
        judge("a hole", model, &stamped(model, 1.0, 8.0, &mut line));
    }
}

#[test]
fn stamps_are_right_at_another_rate_than_the_stated_one() {
    let without_clock = MODELS
        .into_iter()
        .filter(|model| matches!(model.family(), Family::Rplidar | Family::Ydlidar));
    for model in without_clock {
        for pace in [0.97, 0.98, 0.993, 1.02] {
            judge(&format!("pace {pace}"), model, &stamped(model, pace, 30.0, &mut Clean));
        }
        let noisy = stamped(model, 0.98, 30.0, &mut Noisy::new(0.002, 0.0));
        judge("0.98, noisy", model, &noisy);
    }
}

/// Loses the frame with this number.
struct One {
    n_frames: u32,
    lost: u32,
}

impl Line for One {
    fn carry(&mut self, bytes: Vec<u8>) -> Vec<u8> {
        self.n_frames += 1;
        if self.n_frames == self.lost { Vec::new() } else { bytes }
    }
}

#[test]
fn one_lost_capsule_is_one_gap() {
    for (model, n_capsule) in [(Model::RplidarA3, 96), (Model::RplidarS1, 40)] {
        for lost in 100..120 {
            let outcome = stamped(model, 1.0, 1.5, &mut One { n_frames: 0, lost });
            // The capsule before it is lost too: its angles need the start of the next. The head's
            // speed tells the number to a per cent.
            let n_off = outcome.n_missing.abs_diff(2 * n_capsule);
            assert!(n_off <= 2, "{model:?}: {outcome:?}");
            judge("one lost", model, &outcome);
        }
    }
}
