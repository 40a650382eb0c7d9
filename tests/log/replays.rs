//! Replays against logs that are known.

use crate::support::{imu_event, write_log};
use std::convert::Infallible;
use std::path::Path;
use stockpilot::messages::{Declaration, OperatorVerb, Severity, StatusText};
use stockpilot::pilot::{Action, Event};
use stockpilot::record::replay::{ReplayError, ReplayReport, replay_by};
use stockpilot::record::{LogHeader, LogItem, LogReader, Recorder, Topic};
use stockpilot::time::Stamp;

/// A brain that says how many events it has seen, every third time.
fn counting_brain() -> impl FnMut(Event, &mut Vec<Action>) {
    let mut n_seen = 0;
    move |_, actions| {
        n_seen += 1;
        if n_seen % 3 == 0 {
            actions.push(say(n_seen));
        }
    }
}

fn say(n_seen: u32) -> Action {
    Action::Say(StatusText { severity: Severity::Info, text: format!("{n_seen} events") })
}

fn flight(n_events: u32) -> Vec<(Event, Vec<Action>)> {
    let mut brain = counting_brain();
    (0..n_events)
        .map(|n| {
            let mut actions = Vec::new();
            brain(imu_event(n), &mut actions);
            (imu_event(n), actions)
        })
        .collect()
}

fn replayed(path: &Path) -> ReplayReport {
    replay_by(LogReader::open(path).unwrap(), |_| Ok::<_, Infallible>(counting_brain())).unwrap()
}

fn replay_of(steps: &[(Event, Vec<Action>)]) -> ReplayReport {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    write_log(&path, steps);
    replayed(&path)
}

#[test]
fn the_same_brain_gives_the_same_bytes() {
    let report = replay_of(&flight(100));
    assert!(report.identical && report.is_complete);
    assert_eq!((report.events, report.results_compared), (100, 33));
    assert_eq!(report.first_difference, None);
}

#[test]
fn what_a_person_said_before_the_start_is_in_the_log_and_a_replay_passes_over_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let mut recorder = Recorder::create(&path, &LogHeader::default()).unwrap();
    let at = |n: u32| Stamp::from_nanos(i64::from(n) * 1_000_000);
    for (n, (event, actions)) in (0..).zip(flight(30)) {
        if n == 10 {
            let said =
                Declaration { verb: OperatorVerb::FlyGaps, by: "Zoë \"Z\" Pilot".to_owned() };
            recorder.declared(at(n), &said);
        }
        recorder.event(at(n), &event);
        actions.iter().for_each(|action| recorder.result(at(n), action));
    }
    assert_eq!(recorder.close().lost_on_disk, 0);
    let declared = LogReader::open(&path).unwrap().find_map(|item| match item {
        LogItem::Result { topic: Topic::Declared, json, .. } => Some(json),
        _ => None,
    });
    let declared: serde_json::Value = serde_json::from_slice(&declared.unwrap()).unwrap();
    let expected = serde_json::json!({
        "at_ns": 10_000_000, "verb": "fly_gaps", "by": "Zoë \"Z\" Pilot", "nobody_inside": true,
        "remote_in_hand": true, "hall_as_before": true, "no_dust_zone": true,
    });
    assert_eq!(declared, expected);
    let report = replayed(&path);
    assert!(report.identical && report.is_complete, "{report:?}");
    assert_eq!((report.events, report.results_compared), (30, 10));
}

#[test]
fn a_changed_event_shows_at_the_first_result_that_differs() {
    let mut steps = flight(100);
    steps.remove(40);
    let difference = replay_of(&steps).first_difference.unwrap();
    // Without event 40 the brain stays silent where the log has "42 events".
    assert_eq!(difference.event_idx, 40);
    assert_eq!(difference.logged.unwrap().0, Topic::Text);
    assert_eq!(difference.replayed, None);
}

#[test]
fn a_changed_result_shows_both_sides() {
    let mut steps = flight(10);
    steps[5].1 = vec![say(7)];
    let report = replay_of(&steps);
    assert!(!report.identical);
    let difference = report.first_difference.unwrap();
    assert!(difference.logged.unwrap().1.contains("7 events"));
    assert!(difference.replayed.unwrap().1.contains("6 events"));
}

#[test]
fn a_missing_result_shows_unless_the_log_ends_there() {
    let mut steps = flight(12);
    steps[11].1.clear();
    assert!(replay_of(&steps).identical);
    steps[5].1.clear();
    let difference = replay_of(&steps).first_difference.unwrap();
    assert_eq!((difference.event_idx, difference.logged), (5, None));
}

#[test]
fn a_cut_log_replays_up_to_the_cut() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    write_log(&path, &flight(8000));
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() * 7 / 10]).unwrap();
    let report = replayed(&path);
    assert!(report.identical && !report.is_complete);
    assert!(report.events > 2000 && report.events < 8000, "{}", report.events);
}

#[test]
fn a_waiting_recorder_loses_nothing_and_a_gap_ends_a_replay() {
    let folder = tempfile::tempdir().unwrap();
    let steps = flight(20_000);
    let written = |name: &str, waits: bool| {
        let path = folder.path().join(name);
        let recorder = Recorder::create(&path, &LogHeader::default()).unwrap();
        let mut recorder = if waits { recorder.waiting() } else { recorder };
        for (event, actions) in &steps {
            recorder.event(Stamp::ZERO, event);
            actions.iter().for_each(|action| recorder.result(Stamp::ZERO, action));
        }
        (recorder.close(), replayed(&path))
    };
    let (stats, report) = written("waits.mcap", true);
    assert_eq!((stats.written, stats.lost_in_queue), (26_666, 0));
    assert!(report.identical && report.is_complete);
    assert_eq!(report.events, 20_000);

    // Without waiting the disk may or may not keep up; what the file says is true either way.
    let (stats, report) = written("loses.mcap", false);
    assert!(report.identical);
    assert_eq!(report.is_complete, stats.lost_in_queue == 0);
}

#[test]
fn a_job_that_never_began_cannot_finish() {
    // The only way to such a log is another build's log, so it is made of recorded bytes.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let file = std::fs::File::create(&path).unwrap();
    let mut writer = mcap::Writer::new(file).unwrap();
    let none = std::collections::BTreeMap::new();
    let messages = [
        ("/config", r#"{"version":"0","build":"","config_toml":""}"#),
        ("/event/finished", r#"{"at_ns":5,"id":3}"#),
    ];
    for (topic, json) in messages {
        let channel_id = writer.add_channel(0, topic, "json", &none).unwrap();
        let header =
            mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 5, publish_time: 5 };
        writer.write_to_known_channel(&header, json.as_bytes()).unwrap();
    }
    writer.finish().unwrap();
    let difference = replayed(&path).first_difference.unwrap();
    assert_eq!(difference.logged.unwrap().0, Topic::Finished);
}

#[test]
fn what_is_no_log_is_refused_with_a_reason() {
    let no_log =
        replay_by(LogReader::new(&b"hello, hello"[..]), |_| Ok::<_, Infallible>(counting_brain()));
    assert!(matches!(no_log, Err(ReplayError::NoConfig { damage: Some(_) })));

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let mut recorder = Recorder::create(&path, &LogHeader::default()).unwrap();
    recorder.event(Stamp::ZERO, &imu_event(0));
    drop(recorder);
    let refused = replay_by(LogReader::open(&path).unwrap(), |_| {
        if true { Err("no such airframe") } else { Ok(counting_brain()) }
    });
    assert!(
        matches!(refused, Err(ReplayError::Config(cause)) if cause.to_string().contains("airframe"))
    );
}
