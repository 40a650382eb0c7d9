//! Campaigns on several threads, under many conditions at once.

use clap::Parser;
use std::num::NonZeroUsize;
use stockpilot_sim::campaign;
use stockpilot_sim::parallel::run_in_order;
use stockpilot_sim::report::{CampaignReport, RunReport};
use stockpilot_sim::scenario::ScenarioArgs;

#[derive(Debug, Parser)]
struct Options {
    #[command(flatten)]
    scenario: ScenarioArgs,
}

/// The campaign as JSON without the time that it took.
fn campaign_on(n_jobs: usize, options: &[&str]) -> (CampaignReport, String) {
    let scenario = Options::parse_from(["test"].iter().chain(options)).scenario;
    let fly = |seed| -> anyhow::Result<RunReport> {
        Ok(campaign::run(&scenario.scenario(seed)?, |_, _| {})?)
    };
    let n_jobs = NonZeroUsize::new(n_jobs).expect("not zero");
    let mut runs = run_in_order(0..2, n_jobs, fly, |_| {}).expect("flights with an end");
    runs.iter_mut().for_each(|run| run.wall_time_s = 1.0);
    let report = CampaignReport::new(runs);
    let json = serde_json::to_string(&report).expect("JSON");
    (report, json)
}

#[test]
fn a_parallel_campaign_equals_the_serial_one_byte_for_byte() {
    let options = [
        "--world=piles",
        "--planner=greedy",
        "--steps=1",
        "--draw-errors",
        "--steepness=1.2",
        "--marker-noise=2",
        "--dust=0.01",
        "--machine",
        "--gap",
    ];
    let (report, parallel) = campaign_on(2, &options);
    let (_, serial) = campaign_on(1, &options);
    assert_eq!(parallel, serial);
    for run in &report.runs {
        assert!(run.complete && !run.collided, "{run:?}");
        assert!(run.draws_errors && run.coverage > 0.02, "{run:?}");
    }
    assert!((report.runs[0].volume_true_m3 - report.runs[1].volume_true_m3).abs() > 0.1);
}
