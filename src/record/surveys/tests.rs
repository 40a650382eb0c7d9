use super::*;
use crate::messages::{
    Declaration, HitCounts, OperatorCommand, OperatorRequest, VolumeAccount, VolumeBudget,
    VolumeEstimate, VolumeShares,
};
use crate::mission::Phase;
use crate::pilot::{Action, FlightSummary, PhaseChange};
use crate::record::{LogHeader, Recorder, read_accounts, read_accounts_of};
use std::path::PathBuf;

/// A log as the brain and its service write it, but for all that does not matter here.
struct Script {
    recorder: Recorder,
    path: PathBuf,
}

fn at(seconds: i64) -> Stamp<Mono> {
    Stamp::from_nanos(seconds * 1_000_000_000)
}

impl Script {
    fn begin(folder: &Path) -> Self {
        let path = folder.join("flight-1.mcap");
        let notes = [("started_utc".to_owned(), "2026-03-01T06:00:00Z".to_owned())].into();
        let header = LogHeader { started_at: at(100), notes, ..LogHeader::default() };
        Self { recorder: Recorder::create(&path, &header).unwrap().waiting(), path }
    }

    fn phase(&mut self, s: i64, to: Phase) {
        let change = PhaseChange { at: at(s), from: Phase::Idle, to, reason: "why".to_owned() };
        self.recorder.result(at(s), &Action::PhaseChanged(change));
    }

    fn ask(&mut self, s: i64, verb: OperatorVerb) {
        let from = OperatorRequest { system: 255, component: 190 };
        let wish = OperatorCommand { at: at(s), verb, from };
        self.recorder.event(at(s), &Event::Operator(wish));
        self.phase(s, Phase::Preflight);
    }

    /// A flight that takes off five seconds after it was asked for.
    fn fly(&mut self, s: i64, verb: OperatorVerb) {
        self.ask(s, verb);
        self.recorder.event(at(s + 5), &Event::Ticked(at(s + 5)));
        self.phase(s + 5, Phase::TakeOff);
    }

    fn account(&mut self, s: i64, volume_m3: f64) -> VolumeAccount {
        let estimate = VolumeEstimate { at: at(s), volume_m3, sigma_m3: 1.0, coverage_ratio: 1.0 };
        let account = VolumeAccount {
            name: "hall".to_owned(),
            estimate,
            mass: None,
            budget: VolumeBudget::default(),
            shares: VolumeShares::default(),
        };
        self.recorder.event(at(s), &Event::Ticked(at(s)));
        self.recorder.result(at(s), &Action::VolumesAccounted(vec![account.clone()]));
        account
    }

    fn end(&mut self, s: i64, volume_m3: f64) {
        let account = self.account(s, volume_m3);
        let summary = FlightSummary {
            at: at(s - 1),
            volume: account.estimate,
            accounts: vec![account],
            hits: HitCounts::default(),
            steps_done: 0,
            path_length_m: 0.0,
            is_complete: true,
            is_final: true,
        };
        self.recorder.result(at(s), &Action::Ended(Box::new(summary)));
    }

    fn close(self) -> PathBuf {
        assert_eq!(self.recorder.close().lost_on_disk, 0);
        self.path
    }
}

fn volume_m3(log: &Path, number: usize) -> f64 {
    read_accounts_of(log, Some(number)).unwrap().accounts[0].estimate.volume_m3
}

#[test]
fn each_survey_of_a_log_has_its_own_volumes_and_its_own_start() {
    let folder = tempfile::tempdir().unwrap();
    let mut script = Script::begin(folder.path());
    script.fly(110, OperatorVerb::Start);
    script.end(200, 410.0);
    script.fly(300, OperatorVerb::FlyGaps);
    script.end(350, 411.5);
    script.fly(1_000, OperatorVerb::Start);
    script.account(1_020, 7.0);
    script.end(1_100, 95.0);
    let log = script.close();
    let contents = read_surveys(&log).unwrap();
    assert_eq!(contents.surveys.len(), 2);
    assert_eq!(
        [volume_m3(&log, 1), volume_m3(&log, 2)].map(f64::to_bits),
        [411.5, 95.0].map(f64::to_bits)
    );
    let last = read_accounts(&log).unwrap();
    assert_eq!((last.place.number, last.place.n_in_log, last.is_final), (2, 2, true));
    let first = read_accounts_of(&log, Some(1)).unwrap();
    // Ten and nine hundred seconds after the log's beginning at 100 s.
    assert_eq!(first.started_utc.unwrap(), "2026-03-01T06:00:10Z");
    assert_eq!(last.started_utc.unwrap(), "2026-03-01T06:15:00Z");
    // Both flights of the first one, by the end that they have themselves.
    assert_eq!(first.place.ended_at, [at(199), at(349)]);
    for number in [0, 3] {
        let refused = read_accounts_of(&log, Some(number));
        assert!(matches!(refused, Err(ReplayError::NoSuchSurvey { n_in_log: 2, .. })), "{number}");
    }
}

#[test]
fn what_never_took_off_is_no_survey_and_ends_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let mut script = Script::begin(folder.path());
    script.fly(110, OperatorVerb::Start);
    script.end(200, 410.0);
    script.ask(300, OperatorVerb::Start);
    script.end(310, 0.0);
    script.fly(400, OperatorVerb::Start);
    let log = script.close();
    let contents = read_surveys(&log).unwrap();
    let began: Vec<i64> = contents
        .surveys
        .iter()
        .map(|survey| survey.place.began_at.nanos() / 1_000_000_000)
        .collect();
    assert_eq!(began, [110, 400]);
    // The last one with volumes, though another was begun.
    let read = read_accounts(&log).unwrap();
    assert_eq!(read.place.number, 1);
    assert_eq!(read.accounts[0].estimate.volume_m3.to_bits(), 410.0_f64.to_bits());
    assert!(read.is_final);
    assert!(read_accounts_of(&log, Some(2)).unwrap().accounts.is_empty());
}

fn identities(folder: &Path, flights: &[(i64, OperatorVerb, f64)], until_s: i64) -> Vec<String> {
    let folder = tempfile::tempdir_in(folder).unwrap();
    let mut script = Script::begin(folder.path());
    for (s, verb, volume_m3) in flights {
        script.fly(*s, *verb);
        script.end(s + 50, *volume_m3);
    }
    // The service has nothing to do and writes all the same.
    script.recorder.event(at(until_s), &Event::Ticked(at(until_s)));
    let log = script.close();
    read_surveys(&log).unwrap().surveys.into_iter().map(|survey| survey.identity).collect()
}

#[test]
fn a_survey_is_known_by_the_same_however_its_log_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let of = |flights: &[_], until_s| identities(folder.path(), flights, until_s);
    let first = (110, OperatorVerb::Start, 410.0);
    let once = of(&[first], 200);
    assert_eq!((once.len(), once[0].len()), (1, 64));
    let gaps = (300, OperatorVerb::FlyGaps, 411.5);
    let again = (1_000, OperatorVerb::Start, 410.0);
    assert_eq!(of(&[first], 2_000), once, "the service idles");
    assert_eq!(of(&[first, gaps], 2_000), once, "gaps are flown");
    let twice = of(&[first, gaps, again], 2_000);
    assert_eq!((twice.len(), &twice[0]), (2, &once[0]), "another survey is flown");
    // It is another one, though it comes to the same.
    assert_ne!(twice[1], once[0]);
    assert_eq!(of(&[first, again], 2_000)[1], twice[1], "without gaps before it");
    let later = (111, OperatorVerb::Start, 410.0);
    assert_ne!(of(&[later], 200), once, "of another log");
}

#[test]
fn what_was_said_before_a_start_stands_with_the_survey_that_it_began() {
    let folder = tempfile::tempdir().unwrap();
    let mut script = Script::begin(folder.path());
    let say = |script: &mut Script, s: i64, verb: OperatorVerb, by: &str| {
        script.recorder.declared(at(s), &Declaration { verb, by: by.to_owned() });
    };
    say(&mut script, 110, OperatorVerb::Start, "Kim");
    // Something else reaches the brain before the wish does.
    script.recorder.event(at(110), &Event::Ticked(at(110)));
    script.fly(110, OperatorVerb::Start);
    script.end(200, 410.0);
    say(&mut script, 300, OperatorVerb::FlyGaps, "Lee");
    script.fly(300, OperatorVerb::FlyGaps);
    script.end(350, 411.5);
    // One that the mission refused, and then a start by the ground station.
    say(&mut script, 900, OperatorVerb::Start, "Kim");
    script.fly(1_000, OperatorVerb::Start);
    script.end(1_100, 95.0);
    let log = script.close();
    let said: Vec<Vec<(Stamp<Mono>, String)>> = read_surveys(&log)
        .unwrap()
        .surveys
        .into_iter()
        .map(|survey| survey.declarations.into_iter().map(|(at, said)| (at, said.by)).collect())
        .collect();
    let expected = [(at(110), "Kim".to_owned()), (at(300), "Lee".to_owned())];
    assert_eq!(said, [expected.to_vec(), Vec::new()]);
}
