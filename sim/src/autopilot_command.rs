//! The stub autopilot as a program of its own, in real time, for ground stations and companions
//! that others wrote.
//!
//! It flies an open floor without walls. Where it is, it learns from the ODOMETRY of its
//! companion's link, or, with `--vision tracking`, from a motion capture system in the same
//! program, so that a client without any estimator can fly it.

mod gate;
mod machine;

pub use gate::GateAddress;

use crate::autopilot::{
    ApParams, Flavour, ParamTable, ParamValue, StubArduPilot, StubAutopilot, StubPx4,
};
use anyhow::{Context, anyhow, ensure};
use clap::{Args, ValueEnum};
use gate::Gate;
use machine::Machine;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MavHeader, SigningConfig, SigningData};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
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
    /// The companion's link, with the port that was taken.
    listen: String,
    /// The ground station's link.
    ground: Option<String>,
}

/// Runs until SIGINT or SIGTERM.
///
/// # Errors
/// A parameter that does not exist, a key that cannot be read, or an address that cannot be had.
pub fn run(args: &AutopilotArgs) -> anyhow::Result<()> {
    let autopilot = autopilot(args)?;
    let machine = Machine::new(autopilot, args.vision == Vision::Tracking, args.seed);
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

/// Signs and checks with the `mavlink` crate's own code.
fn signing(path: &Path, link: u8) -> anyhow::Result<Arc<SigningData>> {
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("cannot read the key {}", path.display()))?;
    let digits = text.trim().as_bytes();
    ensure!(digits.len() == 64 && digits.is_ascii(), "a key has 64 hexadecimal digits");
    let mut key = [0; 32];
    for (byte, pair) in key.iter_mut().zip(digits.chunks(2)) {
        *byte = u8::from_str_radix(std::str::from_utf8(pair)?, 16)
            .map_err(|_| anyhow!("a key has 64 hexadecimal digits"))?;
    }
    Ok(Arc::new(SigningData::from_config(SigningConfig::new(key, link, true, false))))
}

async fn serve(args: &AutopilotArgs, mut machine: Machine) -> anyhow::Result<()> {
    let stop = CancellationToken::new();
    let signing_of = |link| args.signing_key.as_deref().map(|path| signing(path, link)).transpose();
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
    tell(&Opened {
        listen: companion.local().to_string(),
        ground: ground.as_ref().map(|gate| gate.local().to_string()),
    })?;
    if args.origin {
        let now = machine.now();
        machine.autopilot.forward(now, GROUND_STATION, &origin());
    }
    let mut ending = std::pin::pin!(ending());
    let mut pace = Pace::new(Clock::real());
    loop {
        tokio::select! {
            result = &mut ending => {
                stop.cancel();
                return result;
            }
            () = pace.next() => {
                machine.step();
                pace.stepped();
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
async fn next_of(gate: Option<&mut Gate>) -> Option<gate::Parcel> {
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
