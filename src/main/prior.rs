//! `stockpilot prior`.

use clap::Args;
use serde::Serialize;
use std::path::PathBuf;
use std::process::ExitCode;
use stockpilot::survey::{FieldNumbers, LearnedPrior, MergeOptions, learn_prior};

#[derive(Debug, Args)]
pub(crate) struct PriorArgs {
    /// Logs of flights over the same kind of material in the same region.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct PriorLine {
    configured: NumbersLine,
    found: NumbersLine,
}

#[derive(Debug, Serialize)]
struct NumbersLine {
    range_m: f64,
    sigma_m: f64,
    nugget_m: f64,
}

impl From<FieldNumbers> for NumbersLine {
    fn from(FieldNumbers { range_m, sigma_m, nugget_m }: FieldNumbers) -> Self {
        Self { range_m, sigma_m, nugget_m }
    }
}

#[expect(clippy::print_stdout, reason = "the program's output")]
pub(crate) fn run(args: &PriorArgs) -> anyhow::Result<ExitCode> {
    let Some(LearnedPrior { configured, found }) =
        learn_prior(&args.logs, MergeOptions::default())?
    else {
        anyhow::bail!(
            "the surface of these flights is no field: surface.method is not matern-field"
        );
    };
    if args.json {
        let line = PriorLine { configured: configured.into(), found: found.into() };
        println!("{}", serde_json::to_string(&line)?);
        return Ok(ExitCode::SUCCESS);
    }
    println!("[surface.field]");
    let rows = [
        ("range_m", found.range_m, configured.range_m),
        ("sigma_m", found.sigma_m, configured.sigma_m),
        ("nugget_m", found.nugget_m, configured.nugget_m),
    ];
    for (key, found, configured) in rows {
        println!("{key} = {found:.4}  # flown with {configured}");
    }
    Ok(ExitCode::SUCCESS)
}
