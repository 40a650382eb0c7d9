//! Logs that have grown since they were added, and books of earlier programs.

use super::*;
use crate::messages::{OperatorCommand, OperatorRequest, OperatorVerb};
use crate::mission::Phase;
use crate::pilot::{Event, PhaseChange};

/// Flights of a log: when each was started, s, how, and what the whole came to, m³.
type Flights<'a> = &'a [(i64, OperatorVerb, f64)];

const FIRST: (i64, OperatorVerb, f64) = (10, OperatorVerb::Start, 410.0);
const GAPS: (i64, OperatorVerb, f64) = (100, OperatorVerb::FlyGaps, 411.5);
const SECOND: (i64, OperatorVerb, f64) = (900, OperatorVerb::Start, 95.0);

/// The log of a service that flew these and has idled since; the same flights are the same bytes.
fn flown(folder: &Path, name: &str, flights: Flights<'_>) -> PathBuf {
    let path = folder.join(name);
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/config.example.toml");
    let config: Config = crate::config::load(&example, &[]).expect("the example");
    let header = LogHeader {
        config_toml: config.to_toml().expect("TOML"),
        notes: [("started_utc".to_owned(), "2026-03-01T06:00:00Z".to_owned())].into(),
        ..LogHeader::default()
    };
    let at = |s: i64| Stamp::from_nanos(s * 1_000_000_000);
    let step = |at, to| PhaseChange { at, from: Phase::Idle, to, reason: String::new() };
    let mut recorder = Recorder::create(&path, &header).expect("a log").waiting();
    for (s, verb, volume_m3) in flights {
        let from = OperatorRequest { system: 255, component: 190 };
        let wish = OperatorCommand { at: at(*s), verb: *verb, from };
        recorder.event(at(*s), &Event::Operator(wish));
        recorder.result(at(*s), &Action::PhaseChanged(step(at(*s), Phase::Preflight)));
        recorder.event(at(s + 5), &Event::Ticked(at(s + 5)));
        recorder.result(at(s + 5), &Action::PhaseChanged(step(at(s + 5), Phase::TakeOff)));
        let accounts = vec![account("hall", *volume_m3)];
        let summary = summary(at(s + 50), &accounts);
        recorder.result(at(s + 50), &Action::VolumesAccounted(accounts));
        recorder.result(at(s + 50), &Action::Ended(Box::new(summary)));
    }
    let _stats = recorder.close();
    path
}

fn one(number: usize) -> AddOptions {
    AddOptions { number: Some(number), ..once() }
}

fn volumes_m3(books: &Inventory) -> Vec<f64> {
    let surveys = books.surveys(None).expect("surveys");
    surveys.iter().map(|stored| stored.survey.accounts[0].estimate.volume_m3).collect()
}

fn row(books: &Path, sql: &str) {
    let database = rusqlite::Connection::open(books).expect("a database");
    database.execute_batch(sql).expect("a change");
}

#[test]
fn a_log_that_has_grown_counts_once_and_is_brought_up_to_date() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let mut books = Inventory::open(&folder.join("books.sqlite")).expect("books");
    let short = flown(folder, "short.mcap", &[FIRST]);
    let gaps = flown(folder, "gaps.mcap", &[FIRST, GAPS]);
    let long = flown(folder, "long.mcap", &[FIRST, GAPS, SECOND]);
    let sum = |log: &Path| crate::export::sha256_of_file(log).expect("a sum");
    assert_ne!(sum(&short), sum(&gaps));
    let id = new_id(books.add("Nord", &short, &once()).expect("added"));
    let known = books.add("Nord", &short, &once()).expect("known");
    assert!(matches!(known, Added::Known { .. }), "{known:?}");
    // More was flown: under the same id, and what stood there is kept.
    let options = AddOptions { independent: vec![Origin::Base], ..once() };
    match books.add("Nord", &gaps, &options).expect("updated") {
        Added::Updated { id: found, place } => assert_eq!((found, place.number), (id.clone(), 1)),
        other => panic!("{other:?}"),
    }
    assert_eq!(volumes_m3(&books), [411.5]);
    let stored = books.surveys(None).expect("surveys").remove(0);
    assert_eq!((stored.log_sha256, stored.replaced_sha256), (sum(&gaps), vec![sum(&short)]));
    assert_eq!(stored.independent, [Origin::Base]);
    // Neither a copy from before nor one with more of something else changes it.
    for (log, options) in [(&short, once()), (&gaps, once()), (&long, one(1))] {
        let known = books.add("Nord", log, &options).expect("known");
        assert!(matches!(&known, Added::Known { id: found, .. } if *found == id), "{known:?}");
        assert_eq!(volumes_m3(&books), [411.5]);
    }
    new_id(books.add("Nord", &long, &once()).expect("another survey"));
    assert_eq!(volumes_m3(&books), [411.5, 95.0]);
    assert_eq!(books.check().expect("a check"), "ok");
}

/// As the first program left them: the last survey of a log, without its number.
const FORGET: &str = "UPDATE survey SET identity = NULL, number = NULL, newest_at_ns = NULL,
    started_utc = '2026-03-01T06:00:00Z';";

#[test]
fn a_survey_without_a_number_is_found_by_its_volumes() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, folder) = (folder.path().join("books.sqlite"), folder.path());
    let log = flown(folder, "a.mcap", &[FIRST, SECOND]);
    let id =
        new_id(Inventory::open(&path).expect("books").add("Nord", &log, &one(2)).expect("added"));
    row(&path, FORGET);
    let mut books = Inventory::open(&path).expect("books");
    assert_eq!(books.surveys(None).expect("surveys")[0].number, None);
    // The first survey of the log is not the one that stands there.
    new_id(books.add("Nord", &log, &one(1)).expect("added"));
    let known = books.add("Nord", &log, &once()).expect("known");
    assert!(matches!(&known, Added::Known { id: found, .. } if *found == id), "{known:?}");
    let numbers: Vec<_> =
        books.surveys(None).expect("surveys").iter().map(|stored| stored.number).collect();
    assert_eq!(numbers, [Some(1), Some(2)]);
    // From now on it is known, also when more is flown of it.
    let more = (960, OperatorVerb::FlyGaps, 96.0);
    let long = flown(folder, "b.mcap", &[FIRST, SECOND, more]);
    let updated = books.add("Nord", &long, &once()).expect("updated");
    assert!(matches!(updated, Added::Updated { .. }), "{updated:?}");
    assert_eq!(volumes_m3(&books), [410.0, 96.0]);
}

/// An earlier program took a log that had grown for another one, and counted it twice.
#[test]
fn a_log_that_stands_there_twice_is_found() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, folder) = (folder.path().join("books.sqlite"), folder.path());
    let mut books = Inventory::open(&path).expect("books");
    let id = new_id(books.add("Nord", &flown(folder, "a.mcap", &[FIRST]), &once()).expect("added"));
    let grown = flown(folder, "b.mcap", &[FIRST, GAPS]);
    books.add("Nord", &grown, &once()).expect("updated");
    drop(books);
    let twice = "INSERT INTO survey (rowid, id, hall_id, log_sha256, log_path, started_utc, version, build,
            config_toml, independent)
            SELECT -1, 'survey-old', hall_id, 'old', log_path, started_utc, version, build, config_toml, ''
            FROM survey;
        INSERT INTO volume SELECT 'survey-old', bay_id, position, 410.0, sigma_m3, mass_t, mass_sigma_t,
            (SELECT json_extract(accounts_json, '$') FROM replaced) FROM volume;";
    row(&path, &[FORGET, twice].concat());
    let mut books = Inventory::open(&path).expect("books");
    assert_eq!(volumes_m3(&books).len(), 2);
    let known = books.add("Nord", &grown, &once()).expect("known");
    assert!(matches!(&known, Added::Known { id: found, .. } if *found == id), "{known:?}");
}

#[test]
fn what_nobody_can_tell_apart_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, folder) = (folder.path().join("books.sqlite"), folder.path());
    let short = flown(folder, "a.mcap", &[FIRST]);
    let id =
        new_id(Inventory::open(&path).expect("books").add("Nord", &short, &once()).expect("added"));
    row(&path, FORGET);
    let mut books = Inventory::open(&path).expect("books");
    let grown = flown(folder, "b.mcap", &[FIRST, GAPS, SECOND]);
    match books.add("Nord", &grown, &once()) {
        Err(InventoryError::Unclear { id: found, .. }) => assert_eq!(found, id),
        other => panic!("{other:?}"),
    }
    assert_eq!(volumes_m3(&books), [410.0]);
}
