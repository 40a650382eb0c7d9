//! The stub autopilot as a program of its own, in real time, for ground stations and companions
//! that others wrote.
//!
//! It flies an open floor without walls. Where it is, it learns from the ODOMETRY of its
//! companion's link, or, with `--vision tracking`, from a motion capture system in the same
//! program, so that a client without any estimator can fly it. Where it truly is, it says as the real
//! ones' simulators do: PX4 by `HIL_STATE_QUATERNION` 25 times a second on a link for simulators, both
//! on request on the companion's link.

mod home;
mod machine;

pub use crate::gate::GateAddress;
pub use home::Home;

use crate::autopilot::{
    ApParams, Flavour, ParamTable, ParamValue, StubArduPilot, StubAutopilot, StubPx4,
};
use crate::gate::{Gate, Parcel, signing_key};
use anyhow::{Context, ensure};
use clap::{Args, ValueEnum};
use machine::Machine;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::MavMessage;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Duration;
use stockpilot::service::clock::Clock;
use stockpilot::time::{Mono, Stamp};
use tokio_util::sync::CancellationToken;

/// The autopilot was switched on this long before its first inertial sample here.
const BOOT_LEAD: Duration = Duration::from_secs(5);
/// From one inertial sample to the next.
const STEP: Duration = Duration::from_millis(5);
/// A simulation that is this late lets its clock stand instead of catching up.
const LARGEST_LAG: Duration = Duration::from_millis(100);
/// Where a ground station would put the hall's origin; altitude 0, for any other makes PX4 jump.
const ORIGIN_DEG_E7: (i32, i32) = (473_977_418, 85_455_939);
/// PX4's simulation in hardware tells the truth this often.
const TRUTH_EVERY: Duration = Duration::from_millis(40);
const AUTOPILOT: MavHeader = MavHeader { system_id: 1, component_id: 1, sequence: 0 };
const GROUND_STATION: MavHeader = MavHeader { system_id: 255, component_id: 190, sequence: 0 };

/// Who tells the autopilot where it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Vision {
    /// The ODOMETRY that comes in on the link.
    Link,
    /// A motion capture system that knows the truth.
    Tracking,
}

/// Options of `stockpilot-sim autopilot`.
#[derive(Debug, Args)]
pub struct AutopilotArgs {
    /// Which autopilot.
    #[arg(long, value_enum, default_value_t = Flavour::Px4)]
    flavour: Flavour,
    /// The companion's link: `udpin:HOST:PORT`, `udpout:HOST:PORT` or `tcpin:HOST:PORT`; port 0 takes
    /// a free one.
    #[arg(long, value_name = "ADDRESS", default_value = "udpin:127.0.0.1:14580")]
    listen: GateAddress,
    /// The ground station's link, in the same forms; none if left out.
    #[arg(long, value_name = "ADDRESS")]
    ground: Option<GateAddress>,
    /// The simulator's link, where the true motion leaves 25 times a second, in the same forms.
    #[arg(long, value_name = "ADDRESS")]
    truth: Option<GateAddress>,
    /// Where it stands at first: latitude and longitude, degrees; altitude, m; heading, degrees.
    #[arg(long, value_name = "LAT,LON,ALT,HEADING", default_value = "47.397742,8.545594,489.4,0")]
    home: Home,
    /// Who tells the autopilot where it is.
    #[arg(long, value_enum, default_value_t = Vision::Link)]
    vision: Vision,
    /// Give it a global origin at altitude 0 at once, as a ground station would.
    #[arg(long)]
    origin: bool,
    /// Begin with the firmware's defaults instead of the set that flies indoors.
    #[arg(long)]
    defaults: bool,
    /// Set a parameter before the start; may be given several times.
    #[arg(long = "param", value_name = "NAME=VALUE")]
    params: Vec<String>,
    /// Sign with the key in this file (64 hexadecimal digits) and hear nobody who does not.
    #[arg(long, value_name = "FILE")]
    signing_key: Option<PathBuf>,
    /// Seed of everything that is drawn.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

/// The first line that the program prints.
#[derive(Debug, Serialize)]
struct Opened {
    /// The companion's link, with the port that was taken; none where it calls somebody by TCP.
    listen: Option<String>,
    /// The ground station's link.
    ground: Option<String>,
    /// The simulator's link.
    truth: Option<String>,
}

/// Runs until SIGINT or SIGTERM.
///
/// # Errors
/// A parameter that does not exist, a key that cannot be read, or an address that cannot be had.
pub fn run(args: &AutopilotArgs) -> anyhow::Result<()> {
    let autopilot = autopilot(args)?;
    let machine = Machine::new(autopilot, args.vision == Vision::Tracking, args.home, args.seed);
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .context("cannot start the runtime")?;
    runtime.block_on(serve(args, machine))
}

fn autopilot(args: &AutopilotArgs) -> anyhow::Result<StubAutopilot> {
    let pair = |text: &'_ String| {
        let pair = text.split_once('=').map(|(name, value)| (name.to_owned(), value.to_owned()));
        pair.with_context(|| format!("`{text}` has no `=`"))
    };
    let values = args.params.iter().map(pair).collect::<anyhow::Result<Vec<_>>>()?;
    Ok(match args.flavour {
        Flavour::Px4 => {
            StubAutopilot::Px4(StubPx4::new(px4_params(args.defaults, &values)?, BOOT_LEAD))
        }
        Flavour::ArduPilot => {
            let params = ardupilot_params(args.defaults, &values)?;
            StubAutopilot::ArduPilot(StubArduPilot::new(params, BOOT_LEAD))
        }
    })
}

fn ardupilot_params(defaults: bool, values: &[(String, String)]) -> anyhow::Result<ApParams> {
    let mut table = if defaults { ApParams::defaults() } else { ApParams::indoor() };
    for (name, value) in values {
        ensure!(table.set(name, value.parse()?), "there is no parameter {name}");
    }
    Ok(table)
}

fn px4_params(defaults: bool, values: &[(String, String)]) -> anyhow::Result<ParamTable> {
    let mut table = if defaults { ParamTable::defaults() } else { ParamTable::indoor() };
    for (name, value) in values {
        let old = table.get(name).with_context(|| format!("there is no parameter {name}"))?;
        let value = match old {
            ParamValue::Int(_) => ParamValue::Int(value.parse()?),
            ParamValue::Real(_) => ParamValue::Real(value.parse()?),
        };
        ensure!(table.set(name, value), "{name} does not take {value:?}");
    }
    Ok(table)
}

async fn serve(args: &AutopilotArgs, mut machine: Machine) -> anyhow::Result<()> {
    let stop = CancellationToken::new();
    let signing_of =
        |link| args.signing_key.as_deref().map(|path| signing_key(path, link)).transpose();
    let mut companion = Gate::open(&args.listen, signing_of(0)?, stop.clone())
        .await
        .context("cannot open the companion's link")?;
    let mut ground = match &args.ground {
        Some(address) => Some(
            Gate::open(address, signing_of(1)?, stop.clone())
                .await
                .context("cannot open the ground station's link")?,
        ),
        None => None,
    };
    let truth = match &args.truth {
        Some(address) => Some(
            Gate::open(address, None, stop.clone())
                .await
                .context("cannot open the simulator's link")?,
        ),
        None => None,
    };
    let local = |gate: &Gate| gate.local().map(|address| address.to_string());
    tell(&Opened {
        listen: local(&companion),
        ground: ground.as_ref().and_then(local),
        truth: truth.as_ref().and_then(local),
    })?;
    if args.origin {
        let now = machine.now();
        machine.autopilot.forward(now, GROUND_STATION, &origin());
    }
    let mut ending = std::pin::pin!(ending());
    let mut pace = Pace::new(Clock::real());
    let mut truth_due = Stamp::ZERO;
    loop {
        tokio::select! {
            result = &mut ending => {
                stop.cancel();
                return result;
            }
            () = pace.next() => {
                machine.step();
                pace.stepped();
                if let Some(truth) = truth.as_ref().filter(|_| machine.now() >= truth_due) {
                    truth_due = machine.now().plus(TRUTH_EVERY);
                    truth.send((AUTOPILOT, machine.truth()));
                }
            }
            Some((header, message)) = companion.incoming.recv() => {
                let now = machine.now().plus(pace.since_step());
                machine.autopilot.on_message(now, header, &message);
            }
            Some((header, message)) = next_of(ground.as_mut()) => {
                let now = machine.now().plus(pace.since_step());
                machine.autopilot.forward(now, header, &message);
            }
        }
        for parcel in machine.autopilot.take_outgoing() {
            companion.send(parcel);
        }
        for parcel in machine.autopilot.to_ground_station() {
            if let Some(ground) = &ground {
                ground.send(parcel);
            }
        }
    }
}

/// The next message of a link that may not exist.
async fn next_of(gate: Option<&mut Gate>) -> Option<Parcel> {
    match gate {
        Some(gate) => gate.incoming.recv().await,
        None => std::future::pending().await,
    }
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn tell(opened: &Opened) -> anyhow::Result<()> {
    println!("{}", serde_json::to_string(opened)?);
    Ok(())
}

#[expect(deprecated, reason = "PX4 v1.16 speaks it")]
fn origin() -> MavMessage {
    MavMessage::SET_GPS_GLOBAL_ORIGIN(m::SET_GPS_GLOBAL_ORIGIN_DATA {
        latitude: ORIGIN_DEG_E7.0,
        longitude: ORIGIN_DEG_E7.1,
        altitude: 0,
        target_system: 1,
        time_usec: 0,
    })
}

/// Returns at the first SIGINT or SIGTERM.
async fn ending() -> anyhow::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    let mut terminate = signal(SignalKind::terminate()).context("cannot listen for SIGTERM")?;
    tokio::select! {
        result = tokio::signal::ctrl_c() => result.context("cannot listen for SIGINT"),
        _ = terminate.recv() => Ok(()),
    }
}

/// Keeps the simulation at the wall's clock.
struct Pace {
    clock: Clock,
    due: Stamp<Mono>,
    stepped_at: Stamp<Mono>,
}

impl Pace {
    fn new(clock: Clock) -> Self {
        let now = clock.now();
        Self { clock, due: now, stepped_at: now }
    }

    async fn next(&self) {
        self.clock.sleep_until(self.due).await;
    }

    fn stepped(&mut self) {
        self.stepped_at = self.clock.now();
        self.due = self.due.plus(STEP);
        if self.stepped_at > self.due.plus(LARGEST_LAG) {
            self.due = self.stepped_at;
        }
    }

    /// How far the wall's clock is past the last step; never as far as the next one.
    fn since_step(&self) -> Duration {
        let now = self.clock.now();
        if now < self.stepped_at { Duration::ZERO } else { now.since(self.stepped_at).min(STEP) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_told_apart() {
        assert_eq!("udpin:127.0.0.1:0".parse(), Ok(GateAddress::UdpIn("127.0.0.1:0".to_owned())));
        assert_eq!("tcpin:[::1]:5760".parse(), Ok(GateAddress::TcpIn("[::1]:5760".to_owned())));
        for text in ["", "udpin", "udpin:14540", "serial:/dev/ttyS0:57600", "udpin:host:99999"] {
            assert!(text.parse::<GateAddress>().is_err(), "{text}");
        }
    }
}
