use super::*;
use crate::mission::Phase;
use crate::pilot::{Action, Event, PhaseChange};
use crate::record::{LogHeader, Recorder};
use crate::time::Stamp;

/// Writes a log of a minute's ticks, with a take-off in the middle or without.
fn write_log(folder: &Path, name: &str, takes_off: bool) -> PathBuf {
    let path = folder.join(name);
    let mut recorder = Recorder::create(&path, &LogHeader::default()).unwrap().waiting();
    for n in 0..3_600_i64 {
        let at = Stamp::from_nanos(n * 16_666_667);
        recorder.event(at, &Event::Ticked(at));
        if takes_off && n == 1_800 {
            let (from, to) = (Phase::Preflight, Phase::TakeOff);
            let change = PhaseChange { at, from, to, reason: "checked".to_owned() };
            recorder.result(at, &Action::PhaseChanged(change));
        }
    }
    assert_eq!(recorder.close().lost_on_disk, 0);
    path
}

fn names(logs: &[ShelvedLog]) -> Vec<String> {
    logs.iter().map(|log| log.path.file_name().unwrap().to_string_lossy().into_owned()).collect()
}

#[test]
fn a_log_is_one_of_a_flight_if_somebody_took_off() {
    let folder = tempfile::tempdir().unwrap();
    let flown = write_log(folder.path(), "flight-1.mcap", true);
    let idle = write_log(folder.path(), "flight-2.mcap", false);
    assert!(has_flown(&flown).unwrap());
    assert!(!has_flown(&idle).unwrap());
}

#[test]
fn a_log_without_its_proper_end_may_hold_a_flight() {
    let folder = tempfile::tempdir().unwrap();
    let idle = write_log(folder.path(), "flight-1.mcap", false);
    let bytes = std::fs::read(&idle).unwrap();
    let mut turned = bytes.clone();
    turned[bytes.len() / 2] ^= 0x10;
    let cut = &bytes[..bytes.len() * 7 / 10];
    for (n, damaged) in [cut, turned.as_slice(), &[]].into_iter().enumerate() {
        let path = folder.path().join(format!("damaged-{n}.mcap"));
        std::fs::write(&path, damaged).unwrap();
        assert!(has_flown(&path).unwrap(), "{n}");
    }
}

#[test]
fn empty_logs_go_first_then_reported_surveys_and_no_other_ever() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name, takes_off| write_log(folder.path(), name, takes_off);
    let reported = [write("flight-1.mcap", true), write("flight-4.mcap", true)];
    write("flight-2.mcap", true);
    write("flight-3.mcap", false);
    let current = write("flight-5.mcap", false);
    for log in &reported {
        mark_reported(log, "report").unwrap();
    }
    let mut shelf = Shelf::new(folder.path().to_owned(), current);
    let mut n_looks = 0;
    let deleted = shelf
        .make_room(|| {
            n_looks += 1;
            n_looks > 2
        })
        .unwrap();
    assert_eq!(names(&deleted), ["flight-3.mcap", "flight-1.mcap"]);
    let deleted = shelf.make_room(|| false).unwrap();
    assert_eq!(names(&deleted), ["flight-4.mcap"]);
    assert!(shelf.make_room(|| false).unwrap().is_empty());
    let left = shelved_logs(folder.path()).unwrap();
    assert_eq!(names(&left), ["flight-2.mcap", "flight-5.mcap"]);
    assert!(left.iter().all(|log| log.standing == Standing::Kept));
    // What was said of a deleted survey stays.
    assert!(folder.path().join("flight-1.reported.json").exists());
    assert!(!folder.path().join("flight-3.empty").exists());
}

#[test]
fn room_is_judged_by_what_a_survey_needs() {
    let settings = ShelfSettings { folder: "/".into(), survey_bytes: 100, low_bytes: 1_000 };
    assert_eq!(settings.room(Some(99)), Room::TooLittle);
    assert_eq!(settings.room(Some(100)), Room::Low);
    assert_eq!(settings.room(Some(1_000)), Room::Enough);
    assert_eq!(settings.room(None), Room::Enough);
    assert_eq!(settings.enough_bytes(), 1_100);
    assert!(settings.free_bytes().is_some());
}
