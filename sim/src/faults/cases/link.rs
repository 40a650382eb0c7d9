//! What happens on the way between companion and autopilot.

use super::Lab;
use super::companion::left_alone;
use crate::autopilot::Flavour;
use crate::faults::bench::Bench;
use crate::faults::link_layer::{Addressed, Way};
use anyhow::Context;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage};
use mavlink::{MAVLinkMessageRaw, MavHeader, MavlinkReader};
use std::collections::BTreeSet;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;
use stockpilot::link::signing::{SigningSettings, WallClock};
use stockpilot::link::{Guard, SecuritySettings, wire};
use stockpilot::mission::Phase;
use stockpilot::stats::SeedBook;

const AUTOPILOT: MavHeader = MavHeader { system_id: 1, component_id: 1, sequence: 0 };

pub(super) fn unplugged(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.link.is_cut = true;
        left_alone(bench);
        bench.run((5.0 - bench.since_s()).max(0.0));
        bench.flight.link.mend();
        // PX4 has left the mode: the companion lets go. ArduPilot waits, and is told to land.
        let is_settled =
            bench.until(3.0, |b| matches!(b.phase(), Phase::Abort | Phase::Idle | Phase::Land));
        bench.demand(is_settled, "lets go or lands after the link is back");
        let is_down = bench.until(40.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
    })
}

/// The vehicle must not be led in one go to where it would be by now.
pub(super) fn one_way_lost(lab: &mut Lab) -> anyhow::Result<()> {
    for gap_s in [1.0, 3.0, 7.0] {
        lab.fly(|bench| {
            bench.survey();
            bench.strike();
            bench.flight.link.tamper_with(|way, _, one| match way {
                Way::ToAutopilot => Vec::new(),
                Way::ToCompanion => vec![one],
            });
            // It stands or lands meanwhile, and its setpoints may run ahead of it for a moment only.
            bench.tolerate(f64::INFINITY);
            bench.run(gap_s);
            bench.flight.link.mend();
            bench.tolerate(LED_WITHIN_M);
            bench.safe_now();
            let is_slow = !bench.until(10.0, |b| b.speed_mps() > FASTEST_AFTER_MPS);
            bench.demand(is_slow, &format!("after {gap_s} s it flies no faster than planned"));
            let is_settled = bench.until(90.0, |b| b.is_down() || b.phase() == Phase::Survey);
            bench.demand(is_settled, "goes on or is down in the end");
        })?;
    }
    samples_lost(lab)
}

/// The autopilot hears everything and is not heard: where the vehicle is now is not known, and nothing is
/// concluded from where it was.
fn samples_lost(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.link.tamper_with(|way, _, one| match way {
            Way::ToAutopilot => vec![one],
            Way::ToCompanion => Vec::new(),
        });
        let setpoints = |bench: &mut Bench| {
            let before = bench.seen.setpoint;
            bench.step();
            before.zip(bench.seen.setpoint)
        };
        let mut worst_m = 0.0_f64;
        for step in 0..1_600 {
            if step == 240 {
                bench.flight.link.mend();
            }
            if let Some(((_, before), (_, now))) = setpoints(bench) {
                let away_m = (now - bench.place()).norm() - (before - bench.place()).norm();
                worst_m = worst_m.max(away_m);
            }
        }
        // At 2 m/s for 33 ms ahead of a vehicle that begins to brake, and for a setpoint that was lost.
        let text = format!("a setpoint jumped {worst_m:.2} m away from the vehicle");
        bench.demand(worst_m < LONGEST_STEP_M, &text);
        bench.safe_already();
        let is_settled = bench.until(30.0, |b| b.phase() == Phase::Survey);
        bench.demand(is_settled, "the survey goes on");
        bench.demand(!bench.said("off its path"), "nothing is made of it");
    })
}

/// Setpoints 33 ms apart at 2 m/s, with room for one that was lost.
const LONGEST_STEP_M: f64 = 0.15;

/// A vehicle that does not follow for 0.3 s at 2 m/s, and the distance at which that counts.
const LED_WITHIN_M: f64 = 2.0;
/// The survey's speed, and what a setpoint that far ahead adds.
const FASTEST_AFTER_MPS: f64 = 2.7;

pub(super) fn timesync(lab: &mut Lab) -> anyhow::Result<()> {
    // Milliseconds towards the companion and towards the autopilot.
    for (to_companion, to_autopilot) in [(2, 3), (25, 25), (100, 100), (0, 40), (40, 0)] {
        lab.fly(|bench| {
            bench.survey();
            bench.strike();
            bench.safe_already();
            bench.flight.link.delay_to_companion = Duration::from_millis(to_companion);
            bench.flight.link.delay_to_autopilot = Duration::from_millis(to_autopilot);
            bench.run(15.0);
            let is_safe = matches!(
                bench.phase(),
                Phase::Survey | Phase::Hold | Phase::Return | Phase::Land | Phase::Idle
            );
            bench.demand(is_safe, &format!("{to_companion} and {to_autopilot} ms"));
        })?;
    }
    lab.fly(|bench| {
        bench.flight.link.tamper_with(|way, _, (header, message)| match &message {
            MavMessage::TIMESYNC(data) if way == Way::ToCompanion && data.tc1 != 0 => Vec::new(),
            _ => vec![(header, message)],
        });
        bench.strike();
        bench.safe_already();
        bench.run(70.0);
        bench.demand(bench.seen.commands.is_empty(), "no start without a common clock");
    })
}

/// Every eighth inertial sample for five seconds, then none for `gap_s`, then each one twice.
fn thin_out(bench: &mut Bench, gap_s: f64) {
    let struck_at = bench.now();
    let mut n_samples = 0_u32;
    let mut last_passed_s = 0.0_f64;
    bench.flight.link.tamper_with(move |way, now, one| {
        if way != Way::ToCompanion || !matches!(one.1, MavMessage::HIGHRES_IMU(_)) {
            return vec![one];
        }
        n_samples += 1;
        let age_s = now.seconds_since(struck_at);
        let is_thin = age_s < 5.0;
        // The gap is counted from the last sample that passed.
        let is_kept =
            if is_thin { n_samples.is_multiple_of(8) } else { age_s >= last_passed_s + gap_s };
        if !is_kept {
            return Vec::new();
        }
        if is_thin {
            last_passed_s = age_s;
            return vec![one];
        }
        last_passed_s = f64::NEG_INFINITY;
        vec![one.clone(), one]
    });
}

/// A belief that is further off is wrong, m.
const RIGHT_WITHIN_M: f64 = 0.15;

pub(super) fn thin_imu(lab: &mut Lab) -> anyhow::Result<()> {
    // What the filter bridges: nothing happens.
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        thin_out(bench, 0.095);
        let mut worst_m = 0.0_f64;
        for _ in 0..2_600 {
            bench.step();
            worst_m = worst_m.max(bench.belief_error_m());
        }
        bench.demand(worst_m < RIGHT_WITHIN_M, &format!("{worst_m:.2} m off"));
        bench.demand(bench.phases().is_empty() && bench.is_steered(), "the survey goes on");
    })?;
    // What it cannot: the place is lost, found anew by the markers, and the survey goes on.
    lab.fly(|bench| {
        bench.survey();
        thin_out(bench, 0.3);
        bench.run(5.0);
        bench.strike();
        // A frame with the first sample after the gap gives it a place at once.
        bench.safe_within(1.0, "holds, or knows its place", |b| {
            let is_over = b.since_s() > 0.5;
            b.phase() == Phase::Hold || (is_over && b.belief_error_m() < RIGHT_WITHIN_M)
        });
        let is_back = bench.until(4.0, |b| b.phase() == Phase::Survey);
        bench.demand(is_back, "goes on with a place of its own");
        bench.run(3.0);
        bench.demand(bench.belief_error_m() < RIGHT_WITHIN_M, "the place found anew is right");
    })?;
    // No more of them at all: the flight is over, and the camera keeps the landing where it began.
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.link.tamper_with(|_, _, one| {
            let is_sample = matches!(one.1, MavMessage::HIGHRES_IMU(_) | MavMessage::RAW_IMU(_));
            if is_sample { Vec::new() } else { vec![one] }
        });
        bench.safe_within(6.0, "lands", |bench| bench.phase() == Phase::Land);
        let began_at = bench.place();
        let is_down = bench.until(60.0, Bench::is_down);
        let drift_m = (bench.place() - began_at).xy().norm();
        bench.demand(is_down, "on the ground in the end");
        bench.demand(drift_m < 1.0, &format!("{drift_m:.2} m beside where the landing began"));
    })?;
    // The request for more of them never arrives: PX4 sends 50 a second, ArduPilot none.
    lab.fly(|bench| {
        bench.flight.link.tamper_with(|_, _, (header, message)| match &message {
            MavMessage::COMMAND_LONG(data)
                if data.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL =>
            {
                Vec::new()
            }
            _ => vec![(header, message)],
        });
        bench.strike();
        bench.safe_already();
        let (mut worst_m, mut is_flown) = (0.0_f64, false);
        for _ in 0..15_000 {
            bench.step();
            worst_m = worst_m.max(bench.belief_error_m());
            is_flown |= bench.phase() == Phase::Survey;
        }
        match bench.flavour() {
            Flavour::Px4 => {
                bench.demand(is_flown && !bench.said("holding"), "flies with 50 a second");
                bench.demand(worst_m < RIGHT_WITHIN_M, &format!("{worst_m:.2} m off"));
            }
            Flavour::ArduPilot => {
                bench.demand(bench.seen.commands.is_empty(), "no start without inertial samples");
                bench.demand(bench.said("no take-off"), "people are told");
            }
        }
    })
}

/// Messages of the autopilot in which every number is broken.
fn broken(number: f32) -> Vec<MavMessage> {
    let imu = m::HIGHRES_IMU_DATA { xacc: number, ygyro: number, ..m::HIGHRES_IMU_DATA::DEFAULT };
    let position =
        m::LOCAL_POSITION_NED_DATA { x: number, vz: number, ..m::LOCAL_POSITION_NED_DATA::DEFAULT };
    let attitude =
        m::ATTITUDE_QUATERNION_DATA { q1: number, ..m::ATTITUDE_QUATERNION_DATA::DEFAULT };
    let battery =
        m::BATTERY_STATUS_DATA { battery_remaining: -1, ..m::BATTERY_STATUS_DATA::DEFAULT };
    let clock = m::TIMESYNC_DATA { tc1: i64::MIN, ts1: i64::MAX, ..m::TIMESYNC_DATA::DEFAULT };
    let odometry = m::ODOMETRY_DATA { x: number, ..m::ODOMETRY_DATA::DEFAULT };
    vec![
        MavMessage::HIGHRES_IMU(imu),
        MavMessage::LOCAL_POSITION_NED(position),
        MavMessage::ATTITUDE_QUATERNION(attitude),
        MavMessage::BATTERY_STATUS(battery),
        MavMessage::TIMESYNC(clock),
        MavMessage::ODOMETRY(odometry),
    ]
}

pub(super) fn broken_numbers(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        for k in 0..1_000_u32 {
            let numbers = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX];
            for message in broken(numbers[k as usize % 4]) {
                bench.flight.link.inject(AUTOPILOT, message);
            }
            bench.step();
        }
        bench.run(3.0);
        bench.demand(bench.phases().is_empty() && bench.is_steered(), "the survey goes on");
    })
}

/// One of `n`.
fn pick(bits: u64, n: usize) -> usize {
    usize::try_from(bits % n as u64).unwrap_or(0)
}

/// The frames that are found in these bytes, as a transport finds them.
fn frames(bytes: &[u8]) -> Vec<MAVLinkMessageRaw> {
    let padding = [0_u8; 300];
    let mut reader = MavlinkReader::new(std::io::Read::chain(bytes, padding.as_slice()));
    std::iter::from_fn(|| reader.read_any_raw_message::<MavMessage>().ok()).collect()
}

fn read(bytes: &[u8]) -> Vec<Addressed> {
    frames(bytes).iter().filter_map(|raw| wire::decode(raw).ok()).collect()
}

pub(super) fn rubbish(lab: &mut Lab) -> anyhow::Result<()> {
    let seed = lab.seed;
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        let mut noise = SeedBook::new(seed).stream("rubbish");
        bench.flight.link.tamper_with(move |way, _, (header, message)| {
            let mut bytes = wire::encode(header, &message);
            if way == Way::ToCompanion && noise.chance(0.1) {
                let n = bytes.len();
                let at = pick(noise.bits(), n);
                match pick(noise.bits(), 4) {
                    // A bad byte, a short frame, a false beginning, other bytes before it.
                    0 => bytes[at] ^= 0x5a,
                    1 => bytes.truncate(at),
                    2 => bytes.splice(0..0, [0xfd, 0xff, 0, 0, 0, 1, 1]).for_each(drop),
                    _ => bytes.splice(0..0, [0x55, 0xfe, 0x09, 0xaa]).for_each(drop),
                }
            }
            read(&bytes)
        });
        bench.run(12.0);
        bench.demand(bench.phases().is_empty() && bench.is_steered(), "the survey goes on");
    })
}

/// Gates with keys in a directory of their own.
struct Keys {
    directory: PathBuf,
}

impl Keys {
    fn new(seed: u64) -> anyhow::Result<Self> {
        let name = format!("stockpilot-keys-{}-{seed}-{:p}", std::process::id(), &raw const seed);
        let directory = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&directory).context("no directory for keys")?;
        Ok(Self { directory })
    }

    /// A gate with the key of this digit whose clock is this far ahead.
    fn gate(&self, name: &str, digit: char, ahead: Duration) -> anyhow::Result<Guard> {
        let key_file = self.directory.join(format!("{name}.key"));
        let digits: String = std::iter::repeat_n(digit, 64).collect();
        write_private(&key_file, &digits)?;
        let signing = SigningSettings {
            key_file,
            stamp_file: self.directory.join(format!("{name}.stamp")),
            link_id: 1,
            max_ahead: Duration::from_secs(60),
            accept_unsigned: BTreeSet::new(),
        };
        let settings = SecuritySettings { peers: Vec::new(), signing: Some(signing) };
        // Any fixed instant will do: the stamps count on from it by themselves.
        let now = Duration::from_secs(1_800_000_000) + ahead;
        Ok(Guard::open(&settings, WallClock::new(move || now))?)
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        if let Err(error) = std::fs::remove_dir_all(&self.directory) {
            tracing::warn!(%error, "keys were left behind");
        }
    }
}

fn write_private(path: &Path, text: &str) -> anyhow::Result<()> {
    use std::io::Write as _;
    let mut options = std::fs::OpenOptions::new();
    let mut file = options.write(true).create(true).truncate(true).mode(0o600).open(path)?;
    Ok(file.write_all(text.as_bytes())?)
}

/// What somebody without the key would send: a person's command to land.
fn land_command() -> MavMessage {
    MavMessage::COMMAND_LONG(m::COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_USER_5,
        target_system: 1,
        target_component: 191,
        ..m::COMMAND_LONG_DATA::DEFAULT
    })
}

pub(super) fn signing(lab: &mut Lab) -> anyhow::Result<()> {
    let keys = Keys::new(lab.seed)?;
    let own = keys.gate("own", 'a', Duration::ZERO)?;
    let autopilot = keys.gate("autopilot", 'a', Duration::ZERO)?;
    let stranger = keys.gate("stranger", 'b', Duration::ZERO)?;
    let future = keys.gate("future", 'a', Duration::from_secs(86_400))?;
    let person = MavHeader { system_id: 255, component_id: 190, sequence: 0 };
    lab.fly(move |bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        let mut n = 0_u32;
        let mut recorded = Vec::new();
        bench.flight.link.tamper_with(move |way, now, (header, message)| {
            if way == Way::ToAutopilot {
                return vec![(header, message)];
            }
            n += 1;
            let mut bytes = autopilot.frame(header, &message);
            match n % 500 {
                100 => bytes.extend(wire::encode(person, &land_command())),
                200 => bytes.extend(stranger.frame(person, &land_command())),
                300 => bytes.extend(future.frame(person, &land_command())),
                400 => recorded.clone_from(&bytes),
                450 => bytes.extend(&recorded),
                _ => {}
            }
            let admitted = frames(&bytes).into_iter().filter(|frame| own.admits(frame, now));
            admitted.filter_map(|frame| wire::decode(&frame).ok()).collect()
        });
        bench.run(15.0);
        bench.demand(bench.phases().is_empty() && bench.is_steered(), "the survey goes on");
    })
}
