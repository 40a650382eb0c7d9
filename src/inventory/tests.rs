use super::*;
use crate::config::Config;
use crate::mapping::change::USUAL_RISK;
use crate::messages::{
    BudgetRow, BudgetSource, HitCounts, Mass, VolumeAccount, VolumeBudget, VolumeEstimate,
    VolumeShares,
};
use crate::pilot::{Action, FlightSummary};
use crate::record::{LogHeader, Recorder};
use crate::survey::Origin;
use crate::time::{Mono, Stamp};
use std::path::{Path, PathBuf};

mod grown;

fn account(name: &str, volume_m3: f64) -> VolumeAccount {
    let mut budget = VolumeBudget {
        rows: vec![BudgetRow { source: BudgetSource::Pose, var_m6: 0.25 }],
        shared: Vec::new(),
    };
    // A floor that is wrong by 5 mm under 400 m²: it cancels between surveys.
    budget.push_shared(BudgetSource::Base, &[(-400.0, 0.005)]);
    VolumeAccount {
        name: name.to_owned(),
        estimate: VolumeEstimate {
            at: Stamp::ZERO,
            volume_m3,
            sigma_m3: budget.var_m6().sqrt(),
            coverage_ratio: 1.0,
        },
        mass: Some(Mass { mass_t: 1.6 * volume_m3, sigma_t: 4.0 }),
        budget,
        shares: VolumeShares { measured_ratio: 1.0, ..VolumeShares::default() },
    }
}

/// A whole flight that ended with these volumes.
fn summary(at: Stamp<Mono>, accounts: &[VolumeAccount]) -> FlightSummary {
    FlightSummary {
        at,
        volume: accounts[0].estimate,
        accounts: accounts.to_vec(),
        hits: HitCounts::default(),
        steps_done: 0,
        path_length_m: 0.0,
        is_complete: true,
        is_final: true,
    }
}

/// A log as `merge` writes it: results only.
fn log(folder: &Path, name: &str, started_utc: &str, volume_m3: f64) -> PathBuf {
    log_of(folder, name, started_utc, vec![account("hall", volume_m3)])
}

fn log_of(folder: &Path, name: &str, started_utc: &str, accounts: Vec<VolumeAccount>) -> PathBuf {
    let path = folder.join(name);
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/config.example.toml");
    let config: Config = crate::config::load(&example, &[]).expect("the example");
    let header = LogHeader {
        started_at: Stamp::ZERO,
        config_toml: config.to_toml().expect("TOML"),
        notes: [("started_utc".to_owned(), started_utc.to_owned())].into(),
        body_from_lidar: None,
    };
    let summary = summary(Stamp::ZERO, &accounts);
    let mut recorder = Recorder::create(&path, &header).expect("a log").waiting();
    recorder.result(Stamp::ZERO, &Action::VolumesAccounted(accounts));
    recorder.result(Stamp::ZERO, &Action::Ended(Box::new(summary)));
    let _stats = recorder.close();
    path
}

fn once() -> AddOptions {
    AddOptions::default()
}

fn new_id(added: Added) -> String {
    match added {
        Added::New { id, .. } => id,
        Added::Known { id, .. } | Added::Updated { id, .. } => panic!("{id} was there already"),
    }
}

#[test]
fn a_history_stands_in_the_order_of_time_and_shared_errors_cancel() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let mut books = Inventory::open(&folder.join("books.sqlite")).expect("books");
    // Added out of order.
    let logs = [
        ("b.mcap", "2026-03-02T06:00:00Z", 412.0),
        ("a.mcap", "2026-03-01T06:00:00Z", 410.0),
        ("c.mcap", "2026-03-03T06:00:00Z", 300.0),
    ];
    for (name, at, volume_m3) in logs {
        new_id(books.add("Nord", &log(folder, name, at, volume_m3), &once()).expect("added"));
    }
    new_id(
        books
            .add("Süd", &log(folder, "d.mcap", "2026-03-01T00:00:00Z", 9.0), &once())
            .expect("added"),
    );
    let surveys = books.surveys(Some("Nord")).expect("surveys");
    let lines = history(&surveys, None, USUAL_RISK, &[]);
    let volumes: Vec<f64> = lines.iter().map(|line| line.volume_m3).collect();
    assert_eq!(volumes, [410.0, 412.0, 300.0]);
    assert_eq!(lines[0].change_m3, None);
    // √(0.25 + 0.25) = 0.707 m³, times 2: the floor's 2 m³ are gone.
    let expanded = lines[1].change_expanded_m3.expect("a change");
    assert!((expanded - 2.0_f64.sqrt()).abs() < 1e-9, "{expanded}");
    assert!(lines[1].change_is_significant.expect("a verdict"), "2 m³ are 2.8 σ");
    assert!((lines[2].change_m3.expect("a change") + 112.0).abs() < 1e-9);
    assert_eq!(lines[0].bay_id, lines[2].bay_id);
    assert_eq!(history(&surveys, Some("no such bay"), USUAL_RISK, &[]), []);
    // Another hall's survey is no earlier one of this.
    let all = history(&books.surveys(None).expect("surveys"), None, USUAL_RISK, &[]);
    assert_eq!(all.iter().filter(|line| line.change_m3.is_none()).count(), 2);
    assert_ne!(all[0].bay_id, all[3].bay_id);
    let table = history_table(&lines);
    assert!(table.contains("Nord, hall") && table.contains("significant"), "{table}");
}

/// Surveys of a hall on three days: the second has one of its bays only, and was flown after the floor was laid
/// anew.
fn three_days(folder: &Path) -> Vec<StoredSurvey> {
    let mut books = Inventory::open(&folder.join("books.sqlite")).expect("books");
    let days: [(&str, &[&str], &[Origin]); 3] = [
        ("2026-03-01T06:00:00Z", &["hall", "salt"], &[]),
        ("2026-03-02T06:00:00Z", &["hall"], &[Origin::Base]),
        ("2026-03-03T06:00:00Z", &["hall", "salt", "sand"], &[]),
    ];
    for (day, names, independent) in days {
        let accounts = names.iter().map(|name| account(name, 100.0)).collect();
        let log = log_of(folder, &format!("{day}.mcap"), day, accounts);
        let options = AddOptions { independent: independent.to_vec(), ..once() };
        new_id(books.add("Nord", &log, &options).expect("added"));
    }
    books.surveys(None).expect("surveys")
}

#[test]
fn a_bay_is_compared_with_the_newest_survey_that_has_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let surveys = three_days(folder.path());
    let lines = history(&surveys, None, USUAL_RISK, &[]);
    let of = |day: &str, bay: &str| {
        let found = lines.iter().find(|line| {
            line.bay == bay && line.started_utc.as_deref().is_some_and(|at| at.contains(day))
        });
        found.expect("a line")
    };
    let with = |line: &HistoryLine| line.compared_with.clone();
    assert_eq!(with(of("03-02", "hall")).as_deref(), Some(surveys[0].id.as_str()));
    assert_eq!(with(of("03-03", "hall")).as_deref(), Some(surveys[1].id.as_str()));
    assert_eq!(with(of("03-03", "salt")).as_deref(), Some(surveys[0].id.as_str()));
    assert_eq!(of("03-03", "salt").change_m3, Some(0.0));
    let sand = of("03-03", "sand");
    assert_eq!((sand.change_m3, with(sand)), (None, None));
    assert!(sand.not_compared.as_ref().expect("a reason").contains("no earlier survey"));
    assert_eq!(of("03-01", "salt").not_compared, None, "there is nothing before the first survey");
}

#[test]
fn errors_that_are_independent_do_not_cancel() {
    let folder = tempfile::tempdir().expect("a folder");
    let surveys = three_days(folder.path());
    assert_eq!(surveys[1].independent, [Origin::Base]);
    // Each pose adds 0.25 m⁶; a floor of its own (400 m² by 5 mm) adds 4 m⁶ to either survey.
    let (shared, unshared) = (2.0 * 0.5_f64.sqrt(), 2.0 * 8.5_f64.sqrt());
    let expanded = |independent: &[Origin]| -> Vec<f64> {
        let lines = history(&surveys, None, USUAL_RISK, independent);
        lines.iter().filter_map(|line| line.change_expanded_m3).collect()
    };
    let close = |found: &[f64], wanted: &[f64]| {
        found.len() == wanted.len()
            && std::iter::zip(found, wanted).all(|(found, wanted)| (found - wanted).abs() < 1e-9)
    };
    // The hall on the second day, the hall on the third, and salt across the day on which the floor was laid.
    let found = expanded(&[]);
    assert!(close(&found, &[unshared, shared, unshared]), "{found:?}");
    let found = expanded(&[Origin::Base]);
    assert!(close(&found, &[unshared; 3]), "{found:?}");
}

#[test]
fn a_survey_that_a_person_rejected_is_added_only_on_demand() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let mut books = Inventory::open(&folder.join("books.sqlite")).expect("books");
    let log = log(folder, "a.mcap", "2026-03-01T06:00:00Z", 410.0);
    std::fs::write(
        folder.join("a.review.jsonl"),
        "{\"flight_ended_at_ns\":0,\"verdict\":\"rejected\",\"remark\":\"fog\",\"remarks\":[],\
         \"decided_utc\":\"2026-03-01T07:00:00Z\",\"decided_by\":\"Kim\"}\n",
    )
    .expect("a file");
    match books.add("Nord", &log, &once()) {
        Err(InventoryError::Rejected { said, .. }) => {
            assert_eq!(said, "rejected by Kim, 2026-03-01T07:00:00Z: fog");
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(books.surveys(None).expect("surveys"), []);
    let options = AddOptions { although_rejected: true, ..once() };
    new_id(books.add("Nord", &log, &options).expect("added"));
    // Who has decided what stands with it, also when that comes later, and is not lost by a copy without it.
    let decision = || {
        let mut books = Inventory::open(&folder.join("books.sqlite")).expect("books");
        books.add("Nord", &log, &options).expect("known");
        books.surveys(None).expect("surveys").remove(0).decision
    };
    assert_eq!(decision().as_deref(), Some("rejected by Kim, 2026-03-01T07:00:00Z: fog"));
    let review = folder.join("a.review.jsonl");
    std::fs::write(
        &review,
        "{\"flight_ended_at_ns\":0,\"verdict\":\"accepted\",\"remark\":\"\",\"remarks\":[],\
         \"decided_utc\":\"2026-03-01T08:00:00Z\",\"decided_by\":\"Lee\"}\n",
    )
    .expect("a file");
    for _ in 0..2 {
        assert_eq!(decision().as_deref(), Some("accepted by Lee, 2026-03-01T08:00:00Z"));
        let _absent = std::fs::remove_file(&review);
    }
}

#[test]
fn the_same_log_counts_once_under_any_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let path = folder.join("books.sqlite");
    let first = log(folder, "a.mcap", "2026-03-01T06:00:00Z", 410.0);
    let copy = folder.join("copy.mcap");
    std::fs::copy(&first, &copy).expect("a copy");
    let id =
        new_id(Inventory::open(&path).expect("books").add("Nord", &first, &once()).expect("added"));
    // Also after the books were closed, and for another hall.
    let mut books = Inventory::open(&path).expect("books");
    for (hall, log) in [("Nord", &first), ("Nord", &copy), ("Süd", &copy)] {
        let known = books.add(hall, log, &once()).expect("known");
        assert!(matches!(&known, Added::Known { id: found, .. } if *found == id), "{known:?}");
    }
    let surveys = books.surveys(None).expect("surveys");
    assert_eq!(surveys.len(), 1);
    // What is read back is what the log holds, to the last bit.
    assert_eq!(surveys[0].survey.accounts, [account("hall", 410.0)]);
    assert_eq!(books.check().expect("a check"), "ok");
}

#[test]
fn what_is_no_survey_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut books = Inventory::open(&folder.path().join("books.sqlite")).expect("books");
    assert!(matches!(
        books.add("Nord", &folder.path().join("none.mcap"), &once()),
        Err(InventoryError::File { .. })
    ));
    let text = folder.path().join("text.mcap");
    std::fs::write(&text, "no log").expect("a file");
    assert!(matches!(books.add("Nord", &text, &once()), Err(InventoryError::Log(_))));
    assert!(Inventory::open(&text).is_err(), "a text is no database");
    assert_eq!(books.surveys(None).expect("surveys"), []);
}
