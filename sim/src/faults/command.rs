//! `stockpilot-sim faults`: runs the cases and tells what they came to.

use super::bench::Verdict;
use super::cases::{CASES, Case, Lab};
use crate::autopilot::Flavour;
use crate::parallel::{n_cores, run_in_order};
use clap::Args;
use serde::Serialize;
use std::num::NonZeroUsize;

/// Options of `stockpilot-sim faults`.
#[derive(Debug, Args)]
pub struct FaultsArgs {
    /// Only the cases with these numbers.
    #[arg(long = "case", value_name = "N")]
    cases: Vec<u32>,
    /// Only under this autopilot.
    #[arg(long, value_enum)]
    autopilot: Option<Flavour>,
    /// Seed of everything that is drawn.
    #[arg(long, default_value_t = 40)]
    seed: u64,
    /// Cases at once; as many as there are cores if left out.
    #[arg(long)]
    jobs: Option<NonZeroUsize>,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

/// What one case came to under one autopilot.
#[derive(Debug, Clone, Serialize)]
pub struct CaseReport {
    /// Its number.
    pub case: u32,
    /// What went wrong.
    pub name: &'static str,
    /// The family of the autopilot.
    pub autopilot: &'static str,
    /// Nothing was found wanting.
    pub passed: bool,
    /// From the fault to the safe state, s: the longest of its flights.
    pub time_to_safe_s: Option<f64>,
    /// What was found wanting.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub complaints: Vec<String>,
}

/// What all cases came to.
#[derive(Debug, Clone, Serialize)]
pub struct FaultsReport {
    /// In the order of their numbers.
    pub cases: Vec<CaseReport>,
}

impl FaultsReport {
    /// True if every case passed.
    #[must_use]
    pub fn is_passed(&self) -> bool {
        self.cases.iter().all(|case| case.passed)
    }
}

/// Runs one case under one autopilot.
///
/// # Errors
/// A world or a log that cannot be had.
pub fn run_case(case: &Case, flavour: Flavour, seed: u64) -> anyhow::Result<CaseReport> {
    let mut lab = Lab { flavour, seed, verdicts: Vec::new() };
    (case.script)(&mut lab)?;
    let Lab { verdicts, .. } = lab;
    let mut times = verdicts.iter().map(|verdict| verdict.time_to_safe_s);
    let longest_s = times.try_fold(0.0_f64, |longest, time| Some(longest.max(time?)));
    Ok(CaseReport {
        case: case.number,
        name: case.name,
        autopilot: flavour.name(),
        passed: !verdicts.is_empty() && verdicts.iter().all(|verdict| verdict.is_passed),
        time_to_safe_s: longest_s,
        complaints: verdicts.iter().enumerate().flat_map(numbered).collect(),
    })
}

/// Complaints with the number of their flight.
fn numbered((index, verdict): (usize, &Verdict)) -> Vec<String> {
    verdict.complaints.iter().map(|text| format!("flight {}: {text}", index + 1)).collect()
}

/// Runs the wanted cases and prints what they came to; true if all passed.
///
/// # Errors
/// No such case, or a world or a log that cannot be had.
pub fn run(args: &FaultsArgs) -> anyhow::Result<bool> {
    let is_wanted = |case: &Case| args.cases.is_empty() || args.cases.contains(&case.number);
    let wanted: Vec<(&Case, Flavour)> = CASES
        .iter()
        .filter(|case| is_wanted(case))
        .flat_map(|case| Flavour::ALL.map(|flavour| (case, flavour)))
        .filter(|(case, flavour)| case.only.is_none_or(|only| only == *flavour))
        .filter(|(_, flavour)| args.autopilot.is_none_or(|wanted| wanted == *flavour))
        .collect();
    anyhow::ensure!(!wanted.is_empty(), "no such case");
    let n_runs = u64::try_from(wanted.len())?;
    let run_one = |index: u64| {
        let (case, flavour) = wanted[usize::try_from(index)?];
        run_case(case, flavour, args.seed)
    };
    let jobs = args.jobs.unwrap_or_else(n_cores);
    let cases = run_in_order(0..n_runs, jobs, run_one, |report| {
        if !args.json {
            print(report);
        }
    })?;
    let report = FaultsReport { cases };
    if args.json {
        print_json(&report)?;
    }
    Ok(report.is_passed())
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print(report: &CaseReport) {
    let verdict = if report.passed { "passed" } else { "FAILED" };
    let time =
        report.time_to_safe_s.map_or_else(|| "never".to_owned(), |time| format!("{time:.2} s"));
    let CaseReport { case, name, autopilot, .. } = report;
    println!("{case:>3}  {name:<45} {autopilot:<10} {verdict}  {time}");
    for complaint in &report.complaints {
        println!("       {complaint}");
    }
}

#[expect(clippy::print_stdout, reason = "the program's output")]
fn print_json(report: &FaultsReport) -> anyhow::Result<()> {
    println!("{}", serde_json::to_string(report)?);
    Ok(())
}
