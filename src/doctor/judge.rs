//! What was seen, judged.

use super::{Check, Verdict};
use crate::camera::CameraStats;
use crate::camera::images::ImageStats;
use crate::lidar::{Family, Identity, LidarHealth, LidarStatus, Model};
use crate::link::LinkBudget;
use crate::messages::TakeOff;
use crate::service::ServiceStatus;
use std::time::Duration;

/// A sensor's rate may differ this much from its data sheet.
const RATE_TOLERANCE: f64 = 0.1;
/// Turns of the head that sensors of these families work at, 1/s.
const TURNS_HZ: std::ops::RangeInclusive<f64> = 4.0..=45.0;
/// Hokuyo sensors look through three quarters of the turn at most, one through 240 of 360 degrees, and this share of their
/// samples comes at least.
const HOKUYO_SHARE: f64 = 0.64;
/// Samples in a thousand that may be missing: more is a line that loses bytes.
const MISSING_PERMILLE: f64 = 5.0;
/// Refused frames in a thousand that a good line may have.
const REFUSED_PERMILLE: f64 = 2.0;
/// Frames that detectors should deliver at least, 1/s.
const LEAST_FRAMES_HZ: f64 = 5.0;
/// Nothing earlier is the present, s since 1970: this program is younger.
const EARLIEST_S: u64 = 1_735_689_600;

/// The LiDAR's lines: who it is, how fast it measures, how its line is.
///
/// `expected` is what the configuration names.
#[must_use]
pub fn lidar(status: &LidarStatus, expected: Option<Model>) -> Vec<Check> {
    match &status.health {
        LidarHealth::Streaming => {}
        other => return vec![lidar_fault(other, status.baud)],
    }
    vec![lidar_identity(status, expected), lidar_rate(status), lidar_line(status)]
}

fn lidar_identity(status: &LidarStatus, expected: Option<Model>) -> Check {
    let Some(identity) = &status.identity else {
        return Check::with_cure(
            "lidar",
            Verdict::Warn,
            "it streams but does not tell who it is",
            "compare `lidar.model` with its label",
        );
    };
    let mut found = format!("{} at {} bit/s", identity.name, status.baud);
    for (what, value) in
        [("firmware", &identity.firmware), ("serial", &identity.serial), ("mode", &identity.mode)]
    {
        if let Some(value) = value {
            found.push_str(&format!(", {what} {value}"));
        }
    }
    match (identity.model, expected) {
        (Some(model), Some(expected)) if model != expected => Check::with_cure(
            "lidar",
            Verdict::Bad,
            format!("{found}; the configuration says {}", expected.full_name()),
            format!("write `model = \"{}\"` into [lidar] and check its ranges", model.name()),
        ),
        _ => Check::good("lidar", found),
    }
}

fn lidar_rate(status: &LidarStatus) -> Check {
    let rates = status.rates;
    let found = format!("{:.0} samples/s, {:.1} turns/s", rates.samples_hz, rates.turns_hz);
    let expected_hz = status.identity.as_ref().and_then(expected_samples_hz);
    let is_slow = expected_hz.is_some_and(|hz| rates.samples_hz < hz * (1.0 - RATE_TOLERANCE));
    if !TURNS_HZ.contains(&rates.turns_hz) {
        return Check::with_cure(
            "lidar rate",
            Verdict::Bad,
            found,
            "see whether the head turns freely and whether its supply gives an ampere at the start",
        );
    }
    if let Some(hz) = expected_hz.filter(|_| is_slow) {
        return Check::with_cure(
            "lidar rate",
            Verdict::Warn,
            format!("{found}; {hz:.0} samples/s should come"),
            "another USB port without a hub, a shorter cable; `lidar line` tells what was lost",
        );
    }
    Check::good("lidar rate", found)
}

/// How many samples of this sensor should come in a second: as its mode says, otherwise as its data sheet does.
fn expected_samples_hz(identity: &Identity) -> Option<f64> {
    let of_mode = identity.sample_period.map(|period| period.as_secs_f64().recip());
    let of_model = || {
        // What tells its own rate has none in the list.
        let model = identity.model.filter(|model| *model != Model::HokuyoScip2)?;
        let share = if model.family() == Family::Hokuyo { HOKUYO_SHARE } else { 1.0 };
        Some(share * f64::from(model.samples_per_s()))
    };
    of_mode.or_else(of_model)
}

fn lidar_line(status: &LidarStatus) -> Check {
    let stats = &status.stats;
    #[expect(clippy::cast_precision_loss, reason = "counts of some seconds")]
    let permille = 1e3 * stats.checksum_errors as f64 / (stats.frames.max(1)) as f64;
    let found = format!(
        "{} frames, {} refused, {} samples missing, {} beams lost, clock begun anew {} times",
        stats.frames,
        stats.checksum_errors,
        stats.missing_samples,
        stats.lost_beams,
        stats.clock_restarts
    );
    if permille > REFUSED_PERMILLE {
        return Check::with_cure(
            "lidar line",
            Verdict::Warn,
            found,
            "keep the cable short and away from motor leads, and give the sensor its own 5 V",
        );
    }
    let n_samples = stats.beams + stats.lost_beams + stats.missing_samples;
    #[expect(clippy::cast_precision_loss, reason = "counts of some seconds")]
    let missing_permille = 1e3 * stats.missing_samples as f64 / n_samples.max(1) as f64;
    if missing_permille > MISSING_PERMILLE {
        return Check::with_cure(
            "lidar line",
            Verdict::Warn,
            format!("{found}: {:.1} % of its samples never come", missing_permille / 10.0),
            "a USB port of its own without a hub, a shorter cable, the right baud; a UART needs its hardware \
             FIFO (`stty -F DEVICE`), and nothing else may read the port (`fuser -v DEVICE`)",
        );
    }
    if stats.lost_beams > 0 {
        return Check::with_cure(
            "lidar line",
            Verdict::Warn,
            found,
            "this computer is too slow for what runs on it: see `top`, stop other programs, plan and solve \
             less often, build with --release",
        );
    }
    Check::good("lidar line", found)
}

fn lidar_fault(health: &LidarHealth, baud: u32) -> Check {
    let (found, cure) = match health {
        LidarHealth::Starting | LidarHealth::Streaming => (
            "it has not begun to stream".to_owned(),
            "wait for its motor, then look again; `--seconds 20` waits longer".to_owned(),
        ),
        LidarHealth::Silent => (
            format!("nothing comes at {baud} bit/s"),
            "check that its head turns and that power, cable and plug are right; an LD06 or LD19 \
             talks by itself as soon as it has 5 V; an RPLIDAR or YDLIDAR understands no other \
             speed than its own: write `model = \"auto\"` into [lidar] without a baud"
                .to_owned(),
        ),
        LidarHealth::NoFrames { baud } => (
            format!("what comes makes no sense at {baud} bit/s"),
            "write `model = \"auto\"` into [lidar] without a baud, or the model on its label; if it \
             has worked before, another cable"
                .to_owned(),
        ),
        LidarHealth::Unknown { name, baud } => (
            format!("{name} answers at {baud} bit/s and is none that can be chosen by itself"),
            format!(
                "write the model with the same rate and range into [lidar], and `baud = {baud}`; \
                 then `stockpilot lidar check`"
            ),
        ),
        LidarHealth::Stalled => (
            "beams come, but its head stands still".to_owned(),
            "see whether the head turns freely; some models need an ampere to start".to_owned(),
        ),
        LidarHealth::Faulty { reason } => (
            reason.clone(),
            "take its power away for ten seconds; if the error stays, the sensor is broken"
                .to_owned(),
        ),
        LidarHealth::Disconnected { reason } => (
            format!("disconnected: {reason}"),
            "check plug and cable; `dmesg -w` shows whether the adapter comes and goes".to_owned(),
        ),
        LidarHealth::Stopped => (
            "its driver has ended".to_owned(),
            "start again with RUST_LOG=debug and look at the last lines".to_owned(),
        ),
    };
    Check::with_cure("lidar", Verdict::Bad, found, cure)
}

/// The detector's line after listening for `listened`.
#[must_use]
pub fn detector(stats: &CameraStats, address: &str, listened: Duration) -> Check {
    if stats.frames == 0 {
        let (found, cure) = stats.last_refusal.as_ref().map_or_else(
            || {
                (
                    format!("nothing came to {address}"),
                    format!("start the detector and let it send to {address}"),
                )
            },
            |refusal| {
                (
                    format!("{} lines came and all were refused: {refusal}", stats.lines),
                    "src/camera/schema.md describes the lines; stamps are CLOCK_MONOTONIC"
                        .to_owned(),
                )
            },
        );
        return Check::with_cure("detector", Verdict::Bad, found, cure);
    }
    #[expect(clippy::cast_precision_loss, reason = "counts of some seconds")]
    let rate_hz = stats.frames as f64 / listened.as_secs_f64();
    let found = format!("{rate_hz:.1} frames/s, {} lines refused", stats.refused);
    if rate_hz < LEAST_FRAMES_HZ {
        let cure = "the position needs five frames a second: less exposure, smaller pictures";
        return Check::with_cure("detector", Verdict::Warn, found, cure);
    }
    Check::good("detector", found)
}

/// An own camera and its tag detector after listening for `listened`.
#[must_use]
pub fn own_camera(number: u8, stats: &ImageStats, listened: Duration) -> Check {
    let said = |text: &str| format!("{number}: {text}");
    if stats.frames == 0 {
        let found = match &stats.last_error {
            Some(error) => said(&format!("no good picture of {}: {error}", stats.pictures)),
            None => said("no picture came"),
        };
        let cure = "see that the source of [cameras.images] sends pictures of the configured size";
        return Check::with_cure("camera", Verdict::Bad, found, cure);
    }
    #[expect(clippy::cast_precision_loss, reason = "counts of some seconds")]
    let rate_hz = stats.frames as f64 / listened.as_secs_f64();
    let delay_ms = 1e3 * stats.last_delay.as_secs_f64();
    let found = said(&format!(
        "{rate_hz:.1} frames/s, {delay_ms:.0} ms for a picture, {} left out, {} refused, {} tags",
        stats.skipped, stats.refused, stats.tags
    ));
    if rate_hz < LEAST_FRAMES_HZ {
        let cure = "the position needs five frames a second: a larger detector.decimation, smaller pictures";
        return Check::with_cure("camera", Verdict::Warn, found, cure);
    }
    if stats.tags == 0 {
        let cure = "no tag in any picture: show it one; less exposure against blur, more light, the right family";
        return Check::with_cure("camera", Verdict::Warn, found, cure);
    }
    Check::good("camera", found)
}

/// The autopilot's lines: its heartbeat, and the comparison of clocks with it.
#[must_use]
pub fn autopilot(status: &ServiceStatus, address: &str) -> Vec<Check> {
    let transport = status.stats.transport;
    let Some(vehicle) = &status.vehicle else {
        let (found, cure) = if transport.received > 0 {
            (
                format!(
                    "{} messages on {address}, but no heartbeat of an autopilot",
                    transport.received
                ),
                "see that the autopilot, not only a radio or a ground station, sends to this port"
                    .to_owned(),
            )
        } else {
            (
                format!("nothing comes on {address}"),
                "check `link.address`, the autopilot's port, its baud and that TX meets RX; \
                 firmware-params/README.md has the parameters"
                    .to_owned(),
            )
        };
        return vec![Check::with_cure("autopilot", Verdict::Bad, found, cure)];
    };
    let found = format!("heartbeat on {address}, {:?}", vehicle.mode);
    let clock = if status.is_clock_known {
        Check::good("autopilot clock", "compared")
    } else {
        Check::with_cure(
            "autopilot clock",
            Verdict::Bad,
            "the autopilot does not answer TIMESYNC",
            "set the link's MAVLink mode to Onboard (PX4: MAV_x_MODE 2), version 2",
        )
    };
    let mode = if vehicle.is_mode_prompt {
        Check::good("mode switch", "seen at once")
    } else {
        Check::with_cure(
            "mode switch",
            Verdict::Warn,
            "seen up to 1 s late: only the heartbeat tells the mode, once a second",
            "PX4 v1.15 or later sends CURRENT_MODE; before it, setpoints go on for a second after the \
             pilot's switch",
        )
    };
    vec![Check::good("autopilot", found), mode, clock]
}

/// The serial line to the autopilot: whether it carries what is asked, by what came.
#[must_use]
pub fn serial_line(budget: &LinkBudget, status: &ServiceStatus) -> Check {
    let found = format!(
        "{:.0} bytes/s asked, the line carries {:.0}, PX4 sends {:.0} unless MAV_x_RATE says more",
        budget.inbound_bytes_per_s,
        budget.capacity_bytes_per_s,
        budget.px4_bytes_per_s(),
    );
    let cure = format!(
        "921600 baud; or, with PX4, MAV_x_RATE {:.0} for the port of this line (MAV_1_RATE where \
         MAV_1_CONFIG is 102)",
        0.9 * budget.capacity_bytes_per_s,
    );
    if status.stats.link.thin_imu_windows > 0 {
        let found = format!("too few inertial samples come: {found}");
        return Check::with_cure("serial line", Verdict::Bad, found, cure);
    }
    // ArduPilot, which lifts by command, fills the line.
    let is_px4 = status.vehicle.is_none_or(|v| v.takes_off == TakeOff::BySetpoints);
    if is_px4 && !budget.fits_px4_default() {
        return Check::with_cure("serial line", Verdict::Warn, found, cure);
    }
    Check::good("serial line", found)
}

/// This computer's clock of the day, which names logs and dates results; `now_s` since 1970.
#[must_use]
pub fn wall_clock(now_s: u64, is_synchronised: Option<bool>) -> Check {
    if now_s < EARLIEST_S {
        return Check::with_cure(
            "clock",
            Verdict::Warn,
            "the date of this computer is years behind",
            "connect it to a network once, or `sudo date -s \"2026-01-31 12:00\"`; flights do not \
             need the date, results do",
        );
    }
    match is_synchronised {
        Some(true) => Check::good("clock", "set by the network"),
        Some(false) => Check::with_cure(
            "clock",
            Verdict::Warn,
            "not set by the network since the start",
            "`timedatectl set-ntp true`; flights do not need the date, results do",
        ),
        None => Check::good("clock", "plausible"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lidar::{Identity, LidarStats, Rates};

    fn streaming(model: Model) -> LidarStatus {
        LidarStatus {
            health: LidarHealth::Streaming,
            identity: Some(Identity {
                model: Some(model),
                name: model.full_name().into(),
                ..Identity::default()
            }),
            baud: model.default_baud(),
            rates: Rates { samples_hz: f64::from(model.samples_per_s()), turns_hz: 10.0 },
            last_frame_at: None,
            stats: LidarStats { frames: 1000, ..LidarStats::default() },
        }
    }

    fn verdicts(status: &LidarStatus, expected: Option<Model>) -> Vec<Verdict> {
        lidar(status, expected).iter().map(|check| check.verdict).collect()
    }

    #[test]
    fn a_sensor_as_it_should_be_is_good_and_each_flaw_is_named() {
        use Verdict::{Bad, Good, Warn};
        let good = streaming(Model::Ld19);
        assert_eq!(verdicts(&good, Some(Model::Ld19)), [Good, Good, Good]);
        assert_eq!(verdicts(&good, Some(Model::Stl27l)), [Bad, Good, Good]);
        let slow =
            LidarStatus { rates: Rates { samples_hz: 2000.0, turns_hz: 10.0 }, ..good.clone() };
        assert_eq!(verdicts(&slow, None), [Good, Warn, Good]);
        let held =
            LidarStatus { rates: Rates { samples_hz: 4500.0, turns_hz: 0.1 }, ..good.clone() };
        assert_eq!(verdicts(&held, None), [Good, Bad, Good]);
        let stats = LidarStats { frames: 1000, checksum_errors: 20, ..LidarStats::default() };
        assert_eq!(verdicts(&LidarStatus { stats, ..good.clone() }, None), [Good, Good, Warn]);
        let checks = |stats| lidar(&LidarStatus { stats, ..good.clone() }, None);
        let counted = LidarStats { frames: 1000, beams: 10_000, ..LidarStats::default() };
        // 0.5 % of 10 000 and the missing ones are 50.
        assert_eq!(checks(LidarStats { missing_samples: 50, ..counted })[2].verdict, Good);
        let thin = &checks(LidarStats { missing_samples: 60, ..counted })[2];
        assert_eq!(thin.verdict, Warn);
        assert!(thin.found.ends_with("0.6 % of its samples never come"), "{}", thin.found);
        let full = &checks(LidarStats { lost_beams: 1, ..counted })[2];
        assert!(full.verdict == Warn && full.cure.as_ref().unwrap().contains("too slow"));
        for health in [
            LidarHealth::Silent,
            LidarHealth::NoFrames { baud: 9600 },
            LidarHealth::Unknown { name: "YDLIDAR model 19".into(), baud: 230_400 },
            LidarHealth::Stalled,
            LidarHealth::Starting,
        ] {
            let checks = lidar(&LidarStatus { health, ..good.clone() }, None);
            assert_eq!(checks.len(), 1);
            assert!(checks[0].verdict == Bad && checks[0].cure.is_some());
        }
    }

    /// The S2 has 32 000 samples/s on its label, 16 000 in one of its modes; a UTM-30LX looks through 1080 of
    /// 1440 steps at 40 turns/s.
    #[test]
    fn a_rate_is_held_against_the_mode_that_runs() {
        let verdict = |model: Model, samples_hz: f64, period_us: Option<f64>| {
            let mut status = streaming(model);
            status.rates.samples_hz = samples_hz;
            let period = period_us.map(|us| Duration::from_secs_f64(1e-6 * us));
            status.identity.as_mut().unwrap().sample_period = period;
            lidar(&status, None)[1].verdict
        };
        let hz = |model: Model| f64::from(model.samples_per_s());
        for lost in [0.42, 0.2, 0.11] {
            for model in [Model::Ld19, Model::RplidarS2, Model::YdlidarX4] {
                assert_eq!(verdict(model, (1.0 - lost) * hz(model), None), Verdict::Warn);
            }
        }
        assert_eq!(verdict(Model::Ld19, 0.92 * 4500.0, None), Verdict::Good);
        assert_eq!(verdict(Model::RplidarS2, 15_900.0, Some(62.5)), Verdict::Good);
        assert_eq!(verdict(Model::RplidarS2, 12_000.0, Some(62.5)), Verdict::Warn);
        let hokuyo = Model::HokuyoUtm30lx;
        assert_eq!(verdict(hokuyo, 1080.0 * 40.0, None), Verdict::Good);
        assert_eq!(verdict(hokuyo, 0.5 * 1080.0 * 40.0, None), Verdict::Warn);
    }

    #[test]
    fn a_serial_line_is_judged_by_px4s_half_of_it_and_by_what_came() {
        let line = |baud: u32, thin_imu_windows| {
            let address = format!("serial:/dev/ttyAMA0:{baud}").parse().unwrap();
            let budget = LinkBudget::of(&crate::link::Settings::new(address)).unwrap();
            let mut status = ServiceStatus::default();
            status.stats.link.thin_imu_windows = thin_imu_windows;
            let check = serial_line(&budget, &status);
            (check.verdict, check.cure.unwrap_or_default())
        };
        assert_eq!(line(921_600, 0).0, Verdict::Good);
        let (verdict, cure) = line(230_400, 0);
        // 90 % of 23040 bytes/s.
        assert!(verdict == Verdict::Warn && cure.contains("MAV_x_RATE 20736"), "{cure}");
        assert_eq!(line(921_600, 3).0, Verdict::Bad, "whatever should fit");
    }

    #[test]
    fn a_detector_is_judged_by_its_frames() {
        let over_five_s = |frames| {
            let stats = CameraStats { frames, lines: frames, ..CameraStats::default() };
            detector(&stats, "udp:127.0.0.1:5600", Duration::from_secs(5)).verdict
        };
        assert_eq!(over_five_s(0), Verdict::Bad);
        assert_eq!(over_five_s(10), Verdict::Warn);
        assert_eq!(over_five_s(100), Verdict::Good);
    }

    #[test]
    fn an_own_camera_is_judged_by_pictures_and_tags() {
        let verdict = |stats: &ImageStats| own_camera(1, stats, Duration::from_secs(5));
        let silent = verdict(&ImageStats::default());
        assert!(silent.verdict == Verdict::Bad && silent.found.contains("no picture"));
        let seeing = ImageStats { pictures: 100, frames: 100, tags: 700, ..ImageStats::default() };
        assert_eq!(verdict(&seeing).verdict, Verdict::Good);
        assert_eq!(verdict(&ImageStats { tags: 0, ..seeing.clone() }).verdict, Verdict::Warn);
        assert_eq!(verdict(&ImageStats { frames: 10, ..seeing }).verdict, Verdict::Warn);
    }

    #[test]
    fn an_autopilot_that_is_silent_or_no_autopilot_is_bad() {
        let mut status = ServiceStatus::default();
        assert!(autopilot(&status, "udpin:…")[0].found.contains("nothing comes"));
        status.stats.transport.received = 9;
        assert!(autopilot(&status, "udpin:…")[0].found.contains("no heartbeat"));
        assert!(autopilot(&status, "udpin:…").iter().all(|check| check.cure.is_some()));
    }

    #[test]
    fn a_clock_of_1970_is_warned_of() {
        assert_eq!(wall_clock(1000, None).verdict, Verdict::Warn);
        assert_eq!(wall_clock(EARLIEST_S + 1, Some(false)).verdict, Verdict::Warn);
        assert_eq!(wall_clock(EARLIEST_S + 1, Some(true)).verdict, Verdict::Good);
    }
}
