//! `stockpilot change`: what has changed between two surveys.

use crate::logs;
use crate::report::is_same_file;
use clap::{Args, ValueEnum};
use serde::Serialize;
use std::path::PathBuf;
use std::process::ExitCode;
use stockpilot::mapping::change::USUAL_RISK;
use stockpilot::survey::{BayChange, ChangeReport, Origin, Survey, compare};

#[derive(Debug, Args)]
pub(crate) struct ChangeArgs {
    /// Log of the earlier survey, or what `merge` has written.
    earlier: PathBuf,
    /// Log of the later survey.
    later: PathBuf,
    /// Which survey of the earlier log, from 1: each START that measures anew begins one. The last if left out.
    #[arg(long, value_name = "N")]
    earlier_flight: Option<usize>,
    /// Which survey of the later log. With both numbers, two surveys of one log can be compared.
    #[arg(long, value_name = "N")]
    flight: Option<usize>,
    /// How often noise may be called significant, for each line by itself.
    #[arg(long, default_value_t = USUAL_RISK)]
    risk: f64,
    /// Errors that the surveys do not share although their configurations are equal.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "ORIGINS")]
    independent: Vec<OriginName>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Where constant errors come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum OriginName {
    /// The LiDAR on its vehicle: another vehicle, or mounted anew.
    Lidar,
    /// The marker map: hung or surveyed anew.
    Markers,
    /// What the material lies on.
    Base,
}

impl From<OriginName> for Origin {
    fn from(name: OriginName) -> Self {
        match name {
            OriginName::Lidar => Self::Lidar,
            OriginName::Markers => Self::Markers,
            OriginName::Base => Self::Base,
        }
    }
}

#[derive(Debug, Serialize)]
struct ChangeLine {
    bays: Vec<BayChangeLine>,
    is_hall_left_out: bool,
    shared: Vec<&'static str>,
    only_earlier: Vec<String>,
    only_later: Vec<String>,
}

#[derive(Debug, Serialize)]
struct BayChangeLine {
    name: String,
    earlier_m3: f64,
    later_m3: f64,
    change_m3: f64,
    sigma_m3: f64,
    unshared_sigma_m3: f64,
    statement: Option<String>,
    change_t: Option<f64>,
    sigma_t: Option<f64>,
    verdict: &'static str,
    p_value: f64,
    risk: f64,
    detectable_m3: f64,
}

impl From<&BayChange> for BayChangeLine {
    fn from(bay: &BayChange) -> Self {
        let change = &bay.change;
        Self {
            name: bay.name.clone(),
            earlier_m3: bay.earlier.volume_m3,
            later_m3: bay.later.volume_m3,
            change_m3: change.change_m3,
            sigma_m3: change.sigma_m3,
            unshared_sigma_m3: change.unshared_sigma_m3,
            statement: change.statement().ok().map(|statement| statement.to_string()),
            change_t: bay.mass.map(|mass| mass.mass_t),
            sigma_t: bay.mass.map(|mass| mass.sigma_t),
            verdict: change.verdict.name(),
            p_value: change.p_value,
            risk: change.risk,
            detectable_m3: change.detectable_m3,
        }
    }
}

/// Compares the bays of two surveys, errors that they share taken out.
pub(crate) fn run(args: &ChangeArgs) -> anyhow::Result<ExitCode> {
    let earlier = Survey::read_one(&args.earlier, args.earlier_flight)?;
    let later = Survey::read_one(&args.later, args.flight)?;
    anyhow::ensure!(
        !is_same_file(&args.earlier, &args.later) || earlier.place.number < later.place.number,
        "surveys {} and {} of one log: --earlier-flight must name one before --flight",
        earlier.place.number,
        later.place.number
    );
    let named =
        [(&earlier, "--earlier-flight", args.earlier_flight), (&later, "--flight", args.flight)];
    for (survey, option, _) in named.into_iter().filter(|(.., number)| number.is_none()) {
        logs::tell_others(&survey.place, option);
    }
    for survey in [&earlier, &later] {
        if !survey.is_final {
            tracing::warn!(
                log = %survey.path.display(),
                "the volume is one of the flight under way; `stockpilot merge` uses all it saw"
            );
        }
    }
    let independent: Vec<Origin> = args.independent.iter().map(|name| (*name).into()).collect();
    let report = compare(&earlier, &later, args.risk, &independent)?;
    print_change(&report, args.json)?;
    Ok(ExitCode::SUCCESS)
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_change(report: &ChangeReport, as_json: bool) -> anyhow::Result<()> {
    let shared: Vec<&str> = report.shared.iter().map(|origin| origin.name()).collect();
    if as_json {
        let line = ChangeLine {
            bays: report.bays.iter().map(BayChangeLine::from).collect(),
            is_hall_left_out: report.is_hall_left_out,
            shared,
            only_earlier: report.only_earlier.clone(),
            only_later: report.only_later.clone(),
        };
        println!("{}", serde_json::to_string(&line)?);
        return Ok(());
    }
    for bay in &report.bays {
        println!("{bay}");
    }
    if report.is_hall_left_out {
        println!("hall: not compared, the bays that it is the sum of have other outlines");
    }
    let shared = if shared.is_empty() { "none".to_owned() } else { shared.join(", ") };
    println!("errors that both surveys share: {shared}");
    for (names, which) in [(&report.only_earlier, "earlier"), (&report.only_later, "later")] {
        if !names.is_empty() {
            println!("only in the {which} survey: {}", names.join(", "));
        }
    }
    Ok(())
}
