use super::*;
use crate::messages::{ImuSample, OperatorCommand, OperatorRequest, OperatorVerb};
use crate::mission::Phase;
use crate::pilot::{Action, Event, PhaseChange};
use crate::record::entry::{Entry, Written};
use crate::record::writer::LogWriter;
use crate::record::{LogHeader, Recorder};
use crate::time::{Mono, Stamp};

/// Writes a log of a minute on the ground, with a take-off in the middle or without; as long as several cuts.
fn write_log(folder: &Path, name: &str, takes_off: bool) -> PathBuf {
    let path = folder.join(name);
    let mut recorder = Recorder::create(&path, &LogHeader::default()).unwrap().waiting();
    for n in 0..3_600_i64 {
        let at = Stamp::from_nanos(n * 16_666_667);
        recorder.event(at, &Event::Ticked(at));
        (0..4_u32).for_each(|k| recorder.event(at, &inertial(at, k)));
        if takes_off && n == 1_800 {
            let (from, to) = (Phase::Preflight, Phase::TakeOff);
            let change = PhaseChange { at, from, to, reason: "checked".to_owned() };
            recorder.result(at, &Action::PhaseChanged(change));
        }
    }
    assert_eq!(recorder.close().lost_on_disk, 0);
    path
}

/// A sample that no compression shrinks much.
fn inertial(at: Stamp<Mono>, k: u32) -> Event {
    let [a, b, c] = [1.0, 2.0, 3.0].map(|n: f64| (at.seconds() * 1e3 + n * f64::from(k + 1)).sin());
    let (accel_mps2, gyro_radps) = ([a, b, 9.8 + c].into(), [c, a * b, b * c].into());
    Event::Imu(ImuSample { at, accel_mps2, gyro_radps })
}

/// The file with something done to its bytes.
fn altered(log: &Path, alter: impl FnOnce(&mut Vec<u8>)) -> PathBuf {
    let mut bytes = std::fs::read(log).unwrap();
    alter(&mut bytes);
    let path = log.with_file_name("altered.mcap");
    std::fs::write(&path, bytes).unwrap();
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
fn a_log_that_lost_its_power_on_the_ground_holds_no_flight() {
    let folder = tempfile::tempdir().unwrap();
    let idle = write_log(folder.path(), "flight-1.mcap", false);
    let n_bytes = std::fs::read(&idle).unwrap().len();
    for left in [n_bytes / 10, n_bytes * 7 / 10, n_bytes - 1] {
        let cut = altered(&idle, |bytes| bytes.truncate(left));
        assert!(!has_flown(&cut).unwrap(), "{left} of {n_bytes} bytes left");
    }
    // What is no log at all is left to people.
    for left in [0, 17] {
        let headless = altered(&idle, |bytes| bytes.truncate(left));
        assert!(has_flown(&headless).unwrap(), "{left} bytes left");
    }
    let flown = write_log(folder.path(), "flight-2.mcap", true);
    let cut = altered(&flown, |bytes| bytes.truncate(n_bytes * 7 / 10));
    assert!(has_flown(&cut).unwrap());
}

#[test]
fn no_damage_hides_a_flight() {
    let folder = tempfile::tempdir().unwrap();
    let flown = write_log(folder.path(), "flight-1.mcap", true);
    let n_bytes = std::fs::read(&flown).unwrap().len();
    // The take-off lies in the middle, and behind it more than a cut leaves unread.
    assert!(n_bytes as u64 / 2 > LONGEST_CUT_BYTES, "{n_bytes} bytes");
    for at in (0..n_bytes / 2).step_by(n_bytes / 61) {
        let damaged = altered(&flown, |bytes| bytes[at] ^= 0x41);
        assert!(has_flown(&damaged).unwrap(), "byte {at} of {n_bytes}");
    }
    // A length that reaches beyond the end looks as if the file had been cut there.
    let lengths = chunk_lengths_at(&std::fs::read(&flown).unwrap());
    assert!(lengths.len() > 3);
    for at in lengths {
        let damaged = altered(&flown, |bytes| bytes[at + 3] |= 0x08);
        let is_before = (at as u64) < n_bytes as u64 / 2;
        assert!(!is_before || has_flown(&damaged).unwrap(), "byte {at} of {n_bytes}");
    }
}

/// Where the lengths of the chunks stand: behind the magic come records of a kind (6 is a chunk), a length in
/// eight bytes, little-endian, and so many bytes more.
fn chunk_lengths_at(bytes: &[u8]) -> Vec<usize> {
    let (mut at, mut found) = (8, Vec::new());
    while let Some(head) = bytes.get(at..at + 9) {
        if head[0] == 6 {
            found.push(at + 1);
        }
        at += 9 + usize::try_from(u64::from_le_bytes(head[1..].try_into().unwrap())).unwrap();
    }
    found
}

#[test]
fn a_log_with_gaps_may_hold_a_flight() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight-1.mcap");
    let file = std::fs::File::create_new(&path).unwrap();
    let mut log = LogWriter::begin(file, &LogHeader::default()).unwrap();
    log.write_lost(Stamp::ZERO, 7).unwrap();
    log.finish().unwrap();
    assert!(has_flown(&path).unwrap());
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

/// A log that grows under the eyes of whoever reports it, as the service writes it.
struct Growing {
    path: PathBuf,
    log: LogWriter<std::fs::File>,
    at_s: i64,
}

impl Growing {
    fn begin(folder: &Path) -> Self {
        let path = folder.join("flight-1.mcap");
        let file = std::fs::File::create_new(&path).unwrap();
        let log = LogWriter::begin(file, &LogHeader::default()).unwrap();
        Self { path, log, at_s: 1 }
    }

    fn write(&mut self, entry: &Entry) {
        let at = self.now();
        self.log.write(at, &Written::new(at, entry, None).unwrap()).unwrap();
        self.log.flush().unwrap();
        self.at_s += 1;
    }

    fn now(&self) -> Stamp<Mono> {
        Stamp::from_nanos(self.at_s * 1_000_000_000)
    }

    /// A person asks for a flight, and it takes off.
    fn fly(&mut self, verb: OperatorVerb) {
        let (at, from) = (self.now(), OperatorRequest { system: 255, component: 190 });
        self.write(&Entry::from(&Event::Operator(OperatorCommand { at, verb, from })));
        for to in [Phase::Preflight, Phase::TakeOff] {
            let (from, reason) = (Phase::Idle, "operator".to_owned());
            let change = PhaseChange { at, from, to, reason };
            self.write(&Entry::from(&Action::PhaseChanged(change)));
        }
    }

    fn stand(&mut self) {
        (0..30).for_each(|_| self.write(&Entry::from(&Event::Ticked(Stamp::ZERO))));
    }
}

/// What is left of one log after its service has ended and room was made on a full disk.
fn left_after(grow: impl FnOnce(&mut Growing)) -> usize {
    let folder = tempfile::tempdir().unwrap();
    let mut growing = Growing::begin(folder.path());
    grow(&mut growing);
    growing.log.finish().unwrap();
    let current = folder.path().join("flight-2.mcap");
    let mut shelf = Shelf::new(folder.path().to_owned(), current);
    shelf.make_room(|| false).unwrap();
    shelved_logs(folder.path()).unwrap().len()
}

#[test]
fn a_log_that_was_flown_with_after_its_report_is_kept() {
    let report = |log: &Growing, number| Seen::look(&log.path).unwrap().mark("report", number);
    // Standing on the ground is nothing to report.
    let left = left_after(|log| {
        log.fly(OperatorVerb::Start);
        assert!(report(log, 1).unwrap());
        log.stand();
    });
    assert_eq!(left, 0);
    for verb in [OperatorVerb::Start, OperatorVerb::FlyGaps] {
        let left = left_after(|log| {
            log.fly(OperatorVerb::Start);
            assert!(report(log, 1).unwrap());
            log.stand();
            log.fly(verb);
        });
        assert_eq!(left, 1, "{verb:?}");
    }
    // Looked at before the second flight, marked after it.
    let left = left_after(|log| {
        log.fly(OperatorVerb::Start);
        let seen = Seen::look(&log.path).unwrap();
        log.fly(OperatorVerb::Start);
        assert!(seen.mark("report", 1).unwrap());
    });
    assert_eq!(left, 1);
}

#[test]
fn a_log_goes_once_each_of_its_surveys_is_reported() {
    let left = left_after(|log| {
        log.fly(OperatorVerb::Start);
        log.fly(OperatorVerb::Start);
        assert!(!Seen::look(&log.path).unwrap().mark("report", 2).unwrap());
    });
    assert_eq!(left, 1);
    let left = left_after(|log| {
        log.fly(OperatorVerb::Start);
        log.fly(OperatorVerb::Start);
        for (number, is_of_all) in [(2, false), (1, true)] {
            assert_eq!(Seen::look(&log.path).unwrap().mark("report", number).unwrap(), is_of_all);
        }
    });
    assert_eq!(left, 0);
}

#[test]
fn a_mark_of_a_program_that_did_not_say_of_what_is_none() {
    let left = left_after(|log| {
        log.fly(OperatorVerb::Start);
        let mark = log.path.with_extension("reported.json");
        std::fs::write(mark, br#"{"what":"report","at_utc":"2026-03-01T06:00:00Z"}"#).unwrap();
    });
    assert_eq!(left, 1);
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
