//! `stockpilot doctor`: its table or its JSON alone on the standard output; `RUST_LOG` brings the drivers' own
//! lines, on the standard error.

use anyhow::Context;
use clap::Args;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;
use stockpilot::config;
use stockpilot::doctor::{Check, Examination, Patience, Report, Verdict};
use stockpilot::service::clock::Clock;

#[derive(Debug, Args)]
pub(crate) struct DoctorArgs {
    /// The configuration file; without it only serial ports, video devices and sensors are looked at.
    #[arg(long)]
    config: Option<PathBuf>,
    /// Override a key of the file; may be given several times.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE", requires = "config")]
    overrides: Vec<String>,
    /// Look for a LiDAR on this port only.
    #[arg(long, conflicts_with = "config")]
    port: Option<PathBuf>,
    /// Compare the autopilot's parameters with this file, one of firmware-params/.
    #[arg(long, value_name = "FILE", requires = "config")]
    params: Option<PathBuf>,
    /// Wait at most this long for what does not come, s.
    #[arg(long, value_name = "S", default_value_t = 12)]
    seconds: u64,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[expect(clippy::print_stdout, reason = "the program's output")]
pub(crate) fn run(args: &DoctorArgs) -> anyhow::Result<ExitCode> {
    let report = match args.config.as_ref().map(|path| config::load(path, &args.overrides)) {
        Some(Err(error)) => {
            let cure = "mend the file; deploy/config.example.toml shows every key";
            let found = error.to_string();
            Report { checks: vec![Check::with_cure("configuration", Verdict::Bad, found, cure)] }
        }
        loaded => {
            let config = loaded.transpose()?;
            let examination = Examination {
                config: config.as_ref(),
                port: args.port.clone(),
                params: args.params.clone(),
                patience: Patience(Duration::from_secs(args.seconds)),
                clock: Clock::real(),
            };
            let runtime = tokio::runtime::Runtime::new().context("cannot start the runtime")?;
            runtime.block_on(Box::pin(examination.run()))
        }
    };
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        print!("{report}");
    }
    Ok(ExitCode::from(report.exit_code()))
}
