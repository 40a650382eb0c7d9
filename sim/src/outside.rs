//! A hall with a vehicle for a service in another process, in real time: what the installed program
//! meets in flight, but for the hardware.
//!
//! ```text
//!   rig ── LiDAR bytes ─▶ pseudo-terminal ─┐
//!       ── detections ──▶ Unix socket ─────┼─▶ stockpilot run --config hall.toml
//!       ◀─ MAVLink ─────▶ UDP ─────────────┘
//! ```
//! The service runs on this computer's own clock, and so does the rig. Nothing is known of the service
//! but what it says by MAVLink, as to a ground station.

mod child;
mod devices;

use crate::operator::Operator;
use crate::rig::Rig;
use crate::scenario::ScenarioArgs;
use anyhow::{Context as _, ensure};
use child::Child;
use clap::Args;
use devices::Devices;
use mavlink::dialects::ardupilotmega::{MavMessage, MavModeFlag};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Duration;
use stockpilot::service::clock::Clock;
use stockpilot::time::{Mono, Stamp};

/// The rig moves by one inertial sample.
const STEP: Duration = Duration::from_millis(5);
/// A computer that was late catches up by so many steps at a time.
const MOST_STEPS: usize = 20;
/// A flight that has not ended by then will not end by itself.
const LONGEST_FLIGHT: Duration = Duration::from_secs(900);
/// The last solve and its words come after the landing: so long are they waited for.
const LAST_WORDS: Duration = Duration::from_secs(20);
/// Once the final volume was said, what else there is follows within this.
const MORE_WORDS: Duration = Duration::from_secs(6);

/// Options of `stockpilot-sim world`.
#[derive(Debug, Args)]
pub struct WorldArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Seed of everything that is drawn.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The folder for `hall.toml` and the socket of the detections; it must be there.
    #[arg(long, value_name = "DIR")]
    dir: PathBuf,
    /// Where the service is to write its logs.
    #[arg(long, value_name = "DIR")]
    log: PathBuf,
    /// The service; `{config}` in its words stands for the configuration. Without it you start one.
    #[arg(last = true, value_name = "COMMAND")]
    command: Vec<String>,
}

/// The first line of the output.
#[derive(Debug, Serialize)]
struct Opened {
    config: PathBuf,
}

/// How the flight went, as seen from outside.
#[derive(Debug, Serialize)]
pub struct SeenFromOutside {
    /// It was armed, and is disarmed again.
    pub has_landed: bool,
    /// It touched something.
    pub has_collided: bool,
    /// Length of the true path, m.
    pub path_length_m: f64,
    /// The last VOLUME that a ground station saw, m³.
    pub volume_m3: Option<f32>,
    /// The truth, m³.
    pub volume_true_m3: f64,
    /// (measured − true) / true.
    pub relative_error: Option<f64>,
    /// What the people were told.
    pub texts: Vec<String>,
    /// How the service ended when it was asked to; none where somebody else started it.
    pub service_exit: Option<String>,
}

/// Lets the service fly one survey; gives whether it landed without touching anything, with a volume.
///
/// # Errors
/// A device or a program that cannot be had, a service that ends by itself, a flight without an end.
#[expect(clippy::print_stdout, reason = "the program's output")]
pub fn run(args: &WorldArgs) -> anyhow::Result<bool> {
    let scenario = args.scenario.scenario(args.seed)?;
    let clock = Clock::real();
    let mut rig = scenario.rig();
    let optics = rig.take_optics().context("the rig has no LiDAR")?;
    let devices = Devices::open(&scenario, optics, &args.dir, clock.now())?;
    let config = devices.write_config(&scenario, &args.dir, args.log.clone())?;
    println!("{}", serde_json::to_string(&Opened { config: config.clone() })?);
    let child = match args.command.as_slice() {
        [] => None,
        words => Some(Child::start(words, &config)?),
    };
    let mut flight = Flight { rig, devices, operator: Operator::default(), child, arming: None };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build()?;
    runtime.block_on(flight.fly(&clock))?;
    let seen = flight.seen()?;
    println!("{}", serde_json::to_string(&seen)?);
    Ok(seen.has_landed && !seen.has_collided && seen.relative_error.is_some())
}

struct Flight {
    rig: Rig,
    devices: Devices,
    operator: Operator,
    child: Option<Child>,
    /// The last armed heartbeat, then the instant of the first disarmed one after it.
    arming: Option<Arming>,
}

#[derive(Debug, Clone, Copy)]
enum Arming {
    Armed,
    DisarmedAt(Stamp<Mono>),
}

impl Flight {
    async fn fly(&mut self, clock: &Clock) -> anyhow::Result<()> {
        let began = clock.now();
        loop {
            clock.sleep_until(began.plus(self.rig.now().since(Stamp::ZERO)).plus(STEP)).await;
            for _ in 0..MOST_STEPS {
                if began.plus(self.rig.now().since(Stamp::ZERO)) >= clock.now() {
                    break;
                }
                self.step(began)?;
            }
            if let Some(child) = &mut self.child {
                child.must_run()?;
            }
            let now = self.rig.now();
            match self.arming {
                Some(Arming::DisarmedAt(at)) if now.since(at) > self.wait_for_words() => {
                    return Ok(());
                }
                _ => {}
            }
            let is_in_time = now.since(Stamp::ZERO) < LONGEST_FLIGHT;
            let words = &self.operator.texts;
            ensure!(is_in_time, "no flight has ended; last words: {words:?}");
        }
    }

    /// How long after the landing something may still be said.
    fn wait_for_words(&self) -> Duration {
        let is_said = self.operator.texts.iter().any(|text| text.starts_with("final volume"));
        if is_said { MORE_WORDS } else { LAST_WORDS }
    }

    /// 5 ms of flight; `began` is when the rig's time was zero.
    fn step(&mut self, began: Stamp<Mono>) -> anyhow::Result<()> {
        let output = self.rig.step();
        let now = self.rig.now();
        for (header, message) in &output.to_companion {
            self.note(message, now);
            self.devices.send(*header, message);
        }
        self.devices.scan(&self.rig, began)?;
        for frame in output.frames {
            self.devices.show(frame, began)?;
        }
        for (header, message) in self.devices.receive() {
            self.rig.autopilot_mut().on_message(now, header, &message);
        }
        for (header, message) in self.rig.autopilot_mut().take_outgoing() {
            self.note(&message, now);
            self.devices.send(header, &message);
        }
        self.operator.step(now, self.rig.autopilot_mut());
        Ok(())
    }

    fn note(&mut self, message: &MavMessage, now: Stamp<Mono>) {
        let MavMessage::HEARTBEAT(heartbeat) = message else { return };
        let is_armed = heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
        self.arming = match self.arming {
            _ if is_armed => Some(Arming::Armed),
            Some(Arming::Armed) => Some(Arming::DisarmedAt(now)),
            other => other,
        };
    }

    fn seen(&mut self) -> anyhow::Result<SeenFromOutside> {
        let service_exit = self.child.take().map(Child::end).transpose()?;
        let volume_true_m3 = self.rig.world().volume_m3();
        let relative_error =
            self.operator.volume_m3.map(|v| (f64::from(v) - volume_true_m3) / volume_true_m3);
        Ok(SeenFromOutside {
            has_landed: matches!(self.arming, Some(Arming::DisarmedAt(_))),
            has_collided: self.rig.vehicle().collision().is_some(),
            path_length_m: self.rig.flown_m(),
            volume_m3: self.operator.volume_m3,
            volume_true_m3,
            relative_error,
            texts: self.operator.texts.clone(),
            service_exit,
        })
    }
}
