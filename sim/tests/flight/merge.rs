//! Maps of several logs as one, and the change between two surveys, through files.

use crate::support::{record, short_survey, timeless};
use std::path::{Path, PathBuf};
use stockpilot::config::{Config, SurfaceName};
use stockpilot::mapping::change::ChangeVerdict;
use stockpilot::record::read_accounts;
use stockpilot::survey::{MergeOptions, MergedSurvey, Origin, Survey, compare, merge_logs};
use stockpilot_sim::hall::{Devices, config};
use stockpilot_sim::scenario::Scenario;
use stockpilot_sim::world::World;

/// A short flight over the same heaps, with noise of its own.
fn scenario(seed: u64) -> Scenario {
    Scenario { world: World::piles(3).expect("a generated world"), ..short_survey(seed, 1) }
}

fn field_config(scenario: &Scenario) -> Config {
    let mut config = config(scenario, Devices::none());
    config.surface.method = SurfaceName::MaternField;
    // The result after landing is what counts here.
    config.surface.solve_interval_s = Some(20.0);
    config
}

/// Flies and records; the log.
fn flown(folder: &Path, seed: u64) -> PathBuf {
    let scenario = scenario(seed);
    let path = folder.join(format!("flight-{seed}.mcap"));
    record(&scenario, &field_config(&scenario), &path);
    path
}

fn merge(logs: &[&PathBuf]) -> Result<MergedSurvey, String> {
    let logs: Vec<PathBuf> = logs.iter().map(|log| (*log).clone()).collect();
    merge_logs(&logs, MergeOptions::default()).map_err(|error| error.to_string())
}

#[test]
fn logs_merge_into_the_joint_survey_and_compare_with_each_other() {
    let folder = tempfile::tempdir().expect("a folder");
    let [first, second] = std::thread::scope(|scope| {
        let path = folder.path();
        [21, 22]
            .map(|seed| scope.spawn(move || flown(path, seed)))
            .map(|flight| flight.join().expect("no panic"))
    });

    // The merged map of one log is the flight's own result, to the last bit.
    let alone = merge(&[&first]).expect("one log");
    let recorded = read_accounts(&first).expect("a log");
    assert!(recorded.is_final && recorded.is_complete);
    assert_eq!(timeless(&alone.accounts), timeless(&recorded.accounts));
    assert_eq!(alone.accounts.len(), 5, "the hall and four bays");

    // Two flights know more than one, and their order is nothing but rounding.
    let both = merge(&[&first, &second]).expect("one hall");
    let other = merge(&[&second]).expect("one log");
    let turned = merge(&[&second, &first]).expect("one hall");
    let sigma = |survey: &MergedSurvey| survey.accounts[0].estimate.sigma_m3;
    assert!(sigma(&both) < sigma(&alone).min(sigma(&other)));
    for (a, b) in std::iter::zip(&both.accounts, &turned.accounts) {
        let (a, b) = (a.estimate, b.estimate);
        assert!((a.volume_m3 - b.volume_m3).abs() < 1e-6 * a.volume_m3, "{a:?} {b:?}");
        assert!((a.sigma_m3 - b.sigma_m3).abs() < 1e-6 * a.sigma_m3, "{a:?} {b:?}");
    }
    assert_eq!(both.hits.received, alone.hits.received + other.hits.received);
    assert!(both.logs.iter().all(|log| log.vehicle_idx == 0 && log.n_flights == 1));

    // A log without an end is read as far as it goes.
    let cut = folder.path().join("cut.mcap");
    let bytes = std::fs::read(&first).expect("a log");
    std::fs::write(&cut, &bytes[..bytes.len() * 6 / 10]).expect("written");
    let part = merge(&[&cut, &second]).expect("what is left");
    assert!(!part.logs[0].is_complete && part.logs[1].is_complete);
    assert!(part.logs[0].n_turns > 50 && part.logs[0].n_turns < alone.logs[0].n_turns);
    assert!(sigma(&part) < sigma(&other));

    // What does not fit is refused with the reason.
    assert!(merge(&[&first, &cut]).expect_err("twice").contains("hold the same flight"));
    let coarse = with_config(&second, folder.path(), |config| config.surface.cell_m = 0.3);
    assert!(merge(&[&cut, &coarse]).expect_err("cells").contains("another cell size"));
    let rehung = with_config(&second, folder.path(), |config| {
        config.tags.pop();
    });
    assert!(merge(&[&cut, &rehung]).expect_err("tags").contains("other tags"));

    // The merged survey is a log that compares with others: nothing has moved.
    let out = folder.path().join("merged.mcap");
    both.write(&out).expect("written");
    let merged = Survey::read(&out).expect("a survey");
    assert!(merged.is_final);
    assert_eq!(merged.accounts, both.accounts);
    let report =
        compare(&Survey::read(&first).expect("a survey"), &merged, 0.001, &[]).expect("one hall");
    assert_eq!(report.shared, Origin::ALL);
    assert_eq!(report.bays.len(), 5);
    for bay in &report.bays {
        assert_eq!(bay.change.verdict, ChangeVerdict::Noise, "{bay}");
        assert!(bay.mass.is_some(), "the simulated material has a density");
    }
}

/// The first events under another configuration, as a log of its own.
fn with_config(log: &Path, folder: &Path, change: impl Fn(&mut Config)) -> PathBuf {
    use stockpilot::record::{LogHeader, LogItem, LogReader, RecordedEvent, Recorder};
    let mut items = LogReader::open(log).expect("a log");
    let Some(LogItem::Config { config_toml, .. }) = items.next() else {
        unreachable!("a log begins with its configuration")
    };
    let mut config = Config::from_toml(&config_toml, log).expect("valid");
    change(&mut config);
    let n_before = std::fs::read_dir(folder).expect("a folder").count();
    let path = folder.join(format!("changed-{n_before}.mcap"));
    let header = LogHeader { config_toml: config.to_toml().expect("TOML"), ..LogHeader::default() };
    let mut recorder = Recorder::create(&path, &header).expect("a log").waiting();
    // Half a minute: enough to measure something.
    for item in items.take(9_000) {
        if let LogItem::Event { at, event: RecordedEvent::Plain(event) } = item {
            recorder.event(at, &event);
        }
    }
    let _stats = recorder.close();
    path
}
