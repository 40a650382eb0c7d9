//! How many frames lie between two that arrived.

use crate::lidar::Model;
use crate::lidar::ldrobot::{CLOCK_WRAP_MS, FRAME_SAMPLES, Frame, TURN_CDEG};

/// Below this speed the head is starting or stalled, and its angle says nothing about time, °/s.
const MIN_SPEED_DEG_PER_S: f64 = 360.0;

/// Frames from `previous` to `next`: 1 if none is missing, at least 1.
///
/// ```text
/// n = Δα/s + m · 360°/s        s = ω · T_frame        m = ⌊(Δt/T_frame − Δα/s) / (360°/s)⌉
/// ```
/// - `Δα`: angle from start to start, °, in [0, 360)
/// - `Δt`: device time between the frames, ms precise, so too coarse alone on fast sensors
/// - `ω`: speed of the head, °/s
///
/// The angle gives the fine count inside a turn, the device time the number of whole turns.
/// A loss of 30 s or more is undercounted: the device's clock has come round.
pub(super) fn frames_between(previous: &Frame, next: &Frame, model: Model) -> u32 {
    let frame_period_s = model.sample_period().as_secs_f64() * FRAME_SAMPLES as f64;
    let n_by_time = elapsed_s(previous, next) / frame_period_s;
    let speed = f64::midpoint(f64::from(previous.speed_deg_per_s), f64::from(next.speed_deg_per_s));
    if speed < MIN_SPEED_DEG_PER_S {
        return whole(n_by_time);
    }
    let step_deg = speed * frame_period_s;
    let n_by_angle = advance_deg(previous, next) / step_deg;
    let frames_per_turn = 360.0 / step_deg;
    let turns = ((n_by_time - n_by_angle) / frames_per_turn).round();
    whole(n_by_angle + turns * frames_per_turn)
}

/// Device time from one frame to the other, s; both lie in [0, 30).
pub(super) fn elapsed_s(previous: &Frame, next: &Frame) -> f64 {
    let elapsed_ms = i32::from(next.timestamp_ms) - i32::from(previous.timestamp_ms);
    f64::from(elapsed_ms.rem_euclid(i32::from(CLOCK_WRAP_MS))) * 1e-3
}

fn advance_deg(previous: &Frame, next: &Frame) -> f64 {
    let advance_cdeg = i32::from(next.start_cdeg) - i32::from(previous.start_cdeg);
    f64::from(advance_cdeg.rem_euclid(i32::from(TURN_CDEG))) * 0.01
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "thirty seconds hold less than 2^17 frames"
)]
fn whole(n_frames: f64) -> u32 {
    n_frames.round().max(1.0) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lidar::ldrobot::Sample;

    /// Frame number `frame_idx` of a sensor whose head turns at `speed` °/s.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "angles and times are wrapped to their ranges first"
    )]
    fn frame(model: Model, speed: u16, frame_idx: u32) -> Frame {
        let time_s = f64::from(frame_idx) * 12.0 / f64::from(model.samples_per_s());
        let start_deg = (123.0 + time_s * f64::from(speed)).rem_euclid(360.0);
        Frame {
            speed_deg_per_s: speed,
            start_cdeg: (start_deg * 100.0) as u16,
            end_cdeg: 0,
            timestamp_ms: ((time_s * 1000.0 + 29_000.0) % 30_000.0) as u16,
            samples: [Sample::default(); FRAME_SAMPLES],
        }
    }

    #[test]
    fn counts_frames_over_many_turns_on_both_sensors() {
        for model in Model::ALL {
            for speed in [2100, 3600, 4600] {
                for n_frames in [1, 2, 3, 10, 37, 38, 100, 179, 180, 181, 540, 1000] {
                    let first = frame(model, speed, 7);
                    let next = frame(model, speed, 7 + n_frames);
                    let counted = frames_between(&first, &next, model);
                    assert_eq!(counted, n_frames, "{model:?} at {speed} °/s");
                }
            }
        }
    }

    #[test]
    fn a_standing_head_leaves_the_count_to_the_device_time() {
        let (first, next) = (frame(Model::Ld19, 0, 0), frame(Model::Ld19, 0, 30));
        assert_eq!(frames_between(&first, &next, Model::Ld19), 30);
        assert_eq!(frames_between(&first, &first, Model::Ld19), 1);
    }
}
