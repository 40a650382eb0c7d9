//! A survey's report and its exports say what its log says: flown, recorded, read again.

#![expect(clippy::expect_used, reason = "a test may stop at the first surprise")]

use mavlink::dialects::ardupilotmega::MavCmd;
use std::path::{Path, PathBuf};
use stockpilot::audit::{AuditKey, Finding, Judgement, WISHES, make_key, pack, verify};
use stockpilot::config::{Config, SurfaceName};
use stockpilot::export::sha256_of_file;
use stockpilot::messages::{CellCoverage, Severity, VolumeAccount};
use stockpilot::mission::Phase;
use stockpilot::pilot::{Action, Event};
use stockpilot::record::{LogHeader, Recorder};
use stockpilot::report::{Facts, Report, Target, Verdict, Wishes};
use stockpilot::survey::{Flight, Origin, Reproduction, Survey};
use stockpilot_sim::autopilot::Flavour;
use stockpilot_sim::camera::CameraModel;
use stockpilot_sim::campaign::{DirectFlight, Witnessed};
use stockpilot_sim::hall::{Devices, config};
use stockpilot_sim::scenario::{Conditions, Lidar, Planner, Scenario, Surface};
use stockpilot_sim::world::World;

/// Two surveys of the same heaps for the tests of other programs' readers, and for those below.
const EARLIER: &str = "survey-earlier.mcap";
const LATER: &str = "survey-later.mcap";

fn scenario(seed: u64) -> Scenario {
    Scenario {
        world: World::piles(3).expect("a generated world"),
        planner: Planner::SquareWave,
        surface: Surface::MaternField,
        variance: None,
        lidar: Lidar::Ld19,
        autopilot: Flavour::Px4,
        camera: CameraModel::ahead(),
        n_steps: 50,
        seed,
        conditions: Conditions { leg_spacing_m: Some(5.0), ..Conditions::default() },
    }
}

/// Flies, records, and gives what the brain ended with.
fn fly(path: &Path, seed: u64) -> Vec<VolumeAccount> {
    let scenario = scenario(seed);
    let mut config: Config = config(&scenario, Devices::none());
    config.surface.method = SurfaceName::MaternField;
    // The result after landing is what counts here.
    config.surface.solve_interval_s = Some(60.0);
    config.hall.base_sigma_m = 0.01;
    for bay in &mut config.bays {
        bay.density_t_per_m3 = Some(1.6);
        bay.density_sigma_t_per_m3 = Some(0.03);
    }
    let notes = [("started_utc".to_owned(), "2026-03-04T05:06:07Z".to_owned())].into();
    let config_toml = config.to_toml().expect("TOML");
    let header = LogHeader { config_toml, notes, ..LogHeader::default() };
    let _absent = std::fs::remove_file(path);
    let mut recorder = Recorder::create(path, &header).expect("a log").waiting();
    let mut flight = DirectFlight::with_config(&scenario, &config).expect("a flight");
    while flight.summary().is_none() && flight.rig.now().seconds() < 300.0 {
        flight.step(&mut |now, seen| match seen {
            Witnessed::Event(event) => recorder.event(now, event),
            Witnessed::Action(action) => recorder.result(now, action),
            Witnessed::ToAutopilot(_) => {}
        });
    }
    assert_eq!(recorder.close().lost_in_queue, 0);
    flight.summary().expect("an end").accounts.clone()
}

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("survey");
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

/// All in one test: the flights are what takes time.
#[test]
fn a_report_says_what_the_log_says() {
    let folder = folder();
    let (earlier, later) = (folder.join(EARLIER), folder.join(LATER));
    fly(&earlier, 1);
    let accounts = fly(&later, 2);

    let flight = Flight::read(&later).expect("a flight");
    assert_eq!(flight.reproduction, Reproduction::Identical);
    assert!(flight.is_final && flight.is_complete);
    // To the last bit: what the brain ended with, what the log holds, what is reported.
    assert_eq!(flight.accounts, accounts);
    assert_states_make_the_shares(&flight);
    assert_hits_lie_on_the_surface(&flight);

    let wishes = Wishes {
        site: Some("Test hall".to_owned()),
        target: Target::default(),
        against: Some(Survey::read(&earlier).expect("a survey")),
        books: vec!["hall=300m3".parse().expect("an entry")],
        risk: 0.05,
        ..Wishes::default()
    };
    let facts = Facts::new(flight, wishes).expect("facts");
    let sha256 = sha256_of_file(&later).expect("a sum");
    let report = Report::new(&facts, &sha256).expect("a report");
    assert_eq!(report, Report::new(&facts, &sha256).expect("a report"), "not the same twice");
    assert_data_equal_the_accounts(&report, &accounts);
    assert_wording(&report);
    // Nothing has moved between the surveys, and the books are wrong by far.
    let hall = &facts.bays[0];
    let change = hall.change.as_ref().expect("a change");
    assert!(change.change.p_value > 1e-4, "{change}");
    assert!(change.change.sigma_m3 < hall.account.estimate.sigma_m3 * 1.5, "nothing cancels");
    assert!(hall.book.as_ref().expect("a book").is_significant);
    // Nothing cancels where everything was mounted, hung and laid anew.
    let wishes = Wishes { independent: Origin::ALL.to_vec(), ..facts.wishes.clone() };
    let renewed = Facts::new(facts.flight.clone(), wishes).expect("facts");
    let renewed = &renewed.bays[0].change.as_ref().expect("a change").change;
    let sigma_m3 = change.earlier.sigma_m3.hypot(change.later.sigma_m3);
    assert!((renewed.sigma_m3 - sigma_m3).abs() < 1e-9 * sigma_m3, "{renewed:?}");
    assert_a_signer_cannot_change_the_report(&facts, &folder);
    assert_another_build_says_what_it_cannot_judge(&facts, &folder);
    assert_a_rejected_survey_is_to_be_repeated(&facts, &later);
}

/// What a person decided beside the log is in the report, whatever the numbers are.
fn assert_a_rejected_survey_is_to_be_repeated(facts: &Facts, log: &Path) {
    let review = stockpilot::record::review_file(log);
    let ended_ns = facts.flight.place.ended_at[0].nanos();
    let line = format!(
        "{{\"flight_ended_at_ns\":{ended_ns},\"verdict\":\"rejected\",\"remark\":\"fog over bay B\",\
         \"remarks\":[],\"decided_utc\":\"2026-03-04T06:00:00Z\",\"decided_by\":\"Kim\"}}\n"
    );
    std::fs::write(&review, line).expect("a file");
    let flight = Flight::read(log);
    std::fs::remove_file(&review).expect("no file");
    let facts = Facts::new(flight.expect("a flight"), facts.wishes.clone()).expect("facts");
    assert!(facts.bays.iter().all(|bay| bay.verdict == Verdict::Repeat));
    let report = Report::new(&facts, "").expect("a report");
    let said = "the survey was rejected by Kim, 2026-03-04T06:00:00Z: fog over bay B";
    assert!(report.json.contains(said) && report.html.contains(&said.replace("the", "The")));
}

/// Whoever holds the key may sign anything: what does not follow from the log is found all the same.
fn assert_a_signer_cannot_change_the_report(facts: &Facts, folder: &Path) {
    let (key, out) = (folder.join("audit.key"), folder.join("pack"));
    let _absent = std::fs::remove_dir_all(&out);
    for name in ["audit.key", "audit.pub"] {
        let _absent = std::fs::remove_file(folder.join(name));
    }
    make_key(&key).expect("a key");
    let key = AuditKey::read(&key).expect("a key");
    let sum = sha256_of_file(&facts.flight.log).expect("a sum");
    pack(facts, &sum, &key, &out).expect("a pack");
    let check = || verify(&out, Some(key.public())).expect("a verification");
    let whole = check();
    assert_eq!(whole.findings, []);
    assert_eq!(whole.volumes.expect("volumes").volumes.len(), facts.bays.len());
    let hall = facts.bays[0].account.estimate.volume_m3;
    let more = format!("{}", hall + 10.0);
    let changes = [
        ("report.csv", format!("{hall}"), more.clone(), "report.csv"),
        ("report.json", format!("{hall}"), more, "report.json"),
        ("report.html", "k = 2".to_owned(), "k = 1".to_owned(), "report.html"),
        // Other books make another report.
        (WISHES, "300.0".to_owned(), "310.0".to_owned(), "report.csv"),
    ];
    for (name, from, to, found_in) in changes {
        let path = out.join(name);
        let before = std::fs::read_to_string(&path).expect("a text");
        let after = before.replacen(&from, &to, 1);
        assert_ne!(before, after, "{name} has no {from}");
        std::fs::write(&path, after).expect("a file");
        sign_anew(&out, &key);
        let found = check();
        let wanted = Finding::NotMadeOfLog(found_in.to_owned());
        assert!(found.findings.contains(&wanted), "{name}: {:?}", found.findings);
        assert!(found.volumes.is_none());
        std::fs::write(&path, before).expect("a file");
    }
    std::fs::write(out.join("addendum.pdf"), "%PDF-").expect("a file");
    sign_anew(&out, &key);
    assert_eq!(check().findings, [Finding::Foreign("addendum.pdf".to_owned())]);
}

/// A pack that names another build, as that one would have made it, and with what this one does not know.
fn assert_another_build_says_what_it_cannot_judge(facts: &Facts, folder: &Path) {
    let out = folder.join("pack-of-another-build");
    let _absent = std::fs::remove_dir_all(&out);
    let key = AuditKey::read(&folder.join("audit.key")).expect("a key");
    let sum = sha256_of_file(&facts.flight.log).expect("a sum");
    let (flight, wishes) = (facts.flight.clone(), facts.wishes.clone());
    let other = Facts::reported_by("9.9 (later)".to_owned(), flight, wishes).expect("facts");
    pack(&other, &sum, &key, &out).expect("a pack");
    let judged = || verify(&out, Some(key.public())).expect("a verification");
    // It comes to the same, so there is nothing to excuse.
    let whole = judged();
    assert!(whole.is_other_build() && whole.is_reproduced);
    assert_eq!(whole.judgement(), Judgement::Equal, "{:?}", whole.findings);
    let changed = |name: &str, from: &str, to: &str| {
        let path = out.join(name);
        let before = std::fs::read_to_string(&path).expect("a text");
        assert!(before.contains(from), "{name} has no {from}");
        std::fs::write(&path, before.replacen(from, to, 1)).expect("a file");
        sign_anew(&out, &key);
        let found = judged();
        std::fs::write(&path, before).expect("a file");
        sign_anew(&out, &key);
        found
    };
    let worded = changed("report.html", "Decision rule", "Rule");
    assert_eq!(worded.judgement(), Judgement::ReportNotJudged, "{:?}", worded.findings);
    let newer = changed(WISHES, "{", "{\"wind\": 1,");
    assert_eq!(newer.judgement(), Judgement::VolumesNotJudged, "{:?}", newer.findings);
    let hall = facts.bays[0].account.estimate.volume_m3;
    let forged = changed("volumes.json", &format!("{hall}"), &format!("{}", hall + 1.0));
    assert_eq!(forged.judgement(), Judgement::Differs, "{:?}", forged.findings);
    let config = changed("config.toml", "[hall]", "[hall] ");
    assert_eq!(config.judgement(), Judgement::Differs, "{:?}", config.findings);
}

/// Lists all files of a pack with the sums that they have now, and signs the list.
fn sign_anew(out: &Path, key: &AuditKey) {
    let mut sums = String::new();
    for entry in std::fs::read_dir(out).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        if !name.starts_with("SHA256SUMS") {
            sums.push_str(&format!("{}  {name}\n", sha256_of_file(&path).expect("a sum")));
        }
    }
    let signature = key.sign(sums.as_bytes(), "once more").expect("a signature");
    std::fs::write(out.join("SHA256SUMS.minisig"), signature).expect("a file");
    std::fs::write(out.join("SHA256SUMS"), sums).expect("a file");
}

/// The states of the cells, added up here, are the shares that the account states.
fn assert_states_make_the_shares(flight: &Flight) {
    let surface = flight.surface.as_ref().expect("a surface");
    let bays = flight.bays_on_surface();
    assert_eq!(bays.len(), flight.accounts.len());
    for (bay, account) in std::iter::zip(&bays, &flight.accounts) {
        let (mut all, mut measured) = (0.0, 0.0);
        for (cell, area_m2) in bay.base.cell_areas_m2.iter().enumerate() {
            let volume_m3 = area_m2 * (surface.mean_m[cell] - bay.base.cell_base_m[cell]).max(0.0);
            all += volume_m3;
            if flight.states[cell] == CellCoverage::Measured {
                measured += volume_m3;
            }
        }
        let share = measured / all;
        assert!((share - account.shares.measured_ratio).abs() < 1e-9, "{}: {share}", bay.name);
        assert!(share > 0.5);
        // Cells that a wall cuts are integrated more finely than this.
        let volume_m3 = account.estimate.volume_m3;
        assert!((all - volume_m3).abs() < 0.03 * volume_m3, "{}: {all} {volume_m3}", bay.name);
    }
}

fn assert_hits_lie_on_the_surface(flight: &Flight) {
    let surface = flight.surface.as_ref().expect("a surface");
    assert_eq!(flight.hits.len() as u64, flight.counts.used);
    let off_m = |hit: &stockpilot::mapping::KeptHit| {
        let [x, y, z] = hit.place_m;
        surface.grid.cell_at(x, y).map(|cell| (z - surface.mean_m[cell]).abs())
    };
    let mut off: Vec<f64> = flight.hits.iter().filter_map(off_m).collect();
    assert!(off.len() > 10_000);
    off.sort_by(f64::total_cmp);
    // A cell is 0.25 m wide and a heap at most 45° steep: half a cell up or down, and noise.
    assert!(
        off[off.len() / 2] < 0.05 && off[off.len() * 99 / 100] < 0.25,
        "{}",
        off[off.len() / 2]
    );
}

fn assert_data_equal_the_accounts(report: &Report, accounts: &[VolumeAccount]) {
    let json: serde_json::Value = serde_json::from_str(&report.json).expect("JSON");
    let stated = json["accounts"].as_array().expect("accounts");
    assert_eq!(stated.len(), accounts.len());
    let csv = String::from_utf8(report.csv.clone()).expect("text");
    let mut lines = csv.lines();
    assert!(
        lines.next().expect("a head").starts_with(
            "site,bay,measured_from_utc,measured_to_utc,volume_m3,volume_expanded_m3,"
        )
    );
    for ((stated, account), line) in std::iter::zip(std::iter::zip(stated, accounts), lines) {
        let number = |key: &str| stated[key].as_f64().expect("a number").to_bits();
        assert_eq!(number("volume_m3"), account.estimate.volume_m3.to_bits());
        assert_eq!(number("sigma_m3"), account.estimate.sigma_m3.to_bits());
        assert_eq!(number("mass_t"), account.mass.expect("a mass").mass_t.to_bits());
        assert_eq!(number("measured"), account.shares.measured_ratio.to_bits());
        assert_eq!(
            stated["budget_m6"].as_object().expect("a budget").len(),
            account.budget.rows.len()
        );
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells[1], account.name);
        let volume: f64 = cells[4].parse().expect("a number");
        assert_eq!(volume.to_bits(), account.estimate.volume_m3.to_bits());
        assert!(cells[2].starts_with("2026-03-04T05:0"), "{}", cells[2]);
    }
    assert_eq!(json["survey"]["log_started_utc"], "2026-03-04T05:06:07Z");
    // The ground station of the simulation says START four seconds after the log's beginning.
    let started = json["survey"]["started_utc"].as_str().expect("a time");
    assert!(started.starts_with("2026-03-04T05:06:11"), "{started}");
    let covariance = json["covariance"]["of_constant_errors_m6"].as_array().expect("rows");
    for (row, account) in covariance.iter().enumerate().map(|(k, _)| k).zip(accounts) {
        let variance = covariance[row][row].as_f64().expect("a number");
        assert!((variance - account.estimate.sigma_m3.powi(2)).abs() < 1e-9 * variance);
    }
}

/// What must never be printed, and what must.
fn assert_wording(report: &Report) {
    let text = report.html.to_lowercase();
    let words: Vec<&str> = text.split(|letter: char| !letter.is_alphabetic()).collect();
    for word in ["astm", "asprs", "certified", "accurate", "nan", "infinity", "inf"] {
        assert!(!words.contains(&word), "{word:?} is in the report");
    }
    for word in ["k = 2", "about 95 %", "not a legal-for-trade", "sha-256", "--verify"] {
        assert!(text.contains(word), "{word:?} is not in the report");
    }
    assert!(report.pdf.starts_with(b"%PDF-"));
    assert!(!report.html.contains("src=") && !report.html.contains("href="), "not self-contained");
}

/// The events of one survey as a witness of the flight saw them.
#[derive(Default)]
struct Seen {
    warnings: usize,
    frames: usize,
    first_place_m: Option<[f64; 3]>,
}

impl Seen {
    fn action(&mut self, action: &Action) {
        match action {
            Action::Say(text) if text.severity <= Severity::Warning => self.warnings += 1,
            Action::FixTreated(_) => self.frames += 1,
            Action::PublishOdometry(estimate) => {
                let place_m = estimate.hall_from_body.origin.coords.into();
                self.first_place_m.get_or_insert(place_m);
            }
            _ => {}
        }
    }
}

/// Flies twice with one brain and one log; a second log ends before the second START. Gives what was seen
/// from that START on, and when it came.
#[expect(clippy::panic, reason = "a test without its second survey has failed")]
fn fly_twice(first: &Path, both: &Path) -> (Seen, f64) {
    let scenario = scenario(3);
    let mut config: Config = config(&scenario, Devices::none());
    config.surface.method = SurfaceName::MaternField;
    config.surface.solve_interval_s = Some(60.0);
    config.planning.n_steps = 6;
    let config_toml = config.to_toml().expect("TOML");
    let notes = [("started_utc".to_owned(), "2026-03-04T05:06:07Z".to_owned())].into();
    let header = LogHeader { config_toml, notes, ..LogHeader::default() };
    let recorder = |path: &Path| {
        let _absent = std::fs::remove_file(path);
        Recorder::create(path, &header).expect("a log").waiting()
    };
    let (mut of_first, mut of_both) = (Some(recorder(first)), recorder(both));
    let mut flight = DirectFlight::with_config(&scenario, &config).expect("a flight");
    let (mut seen, mut began_s, mut first_end) = (Seen::default(), 0.0, None);
    let (mut has_flown, mut has_asked) = (false, false);
    while flight.rig.now().seconds() < 600.0 {
        flight.step(&mut |now, witnessed| match witnessed {
            Witnessed::Event(event) => {
                let is_start = matches!(event, Event::Operator(wish) if wish.verb.is_start());
                if is_start && first_end.is_some() && of_first.is_some() {
                    (of_first, seen, began_s) = (None, Seen::default(), now.seconds());
                }
                of_first.iter_mut().chain([&mut of_both]).for_each(|log| log.event(now, event));
            }
            Witnessed::Action(action) => {
                seen.action(action);
                of_first.iter_mut().chain([&mut of_both]).for_each(|log| log.result(now, action));
            }
            Witnessed::ToAutopilot(_) => {}
        });
        has_flown |= flight.phase() == Phase::Survey;
        if has_flown && !has_asked && flight.phase() == Phase::Idle {
            // Before the last solve is done: its volumes would count for the survey that begins.
            has_asked = true;
            flight.operator_mut().ask(MavCmd::MAV_CMD_USER_1);
        }
        let ended_at = flight.summary().map(|summary| summary.at);
        match (first_end, ended_at) {
            (None, Some(_)) => {
                first_end = ended_at;
                flight.operator_mut().ask(MavCmd::MAV_CMD_USER_1);
            }
            (Some(_), now) if now != first_end => {
                let is_refused = flight.texts().iter().any(|text| text.contains("no start yet"));
                assert!(is_refused, "{:?}", flight.texts());
                return (seen, began_s);
            }
            _ => {}
        }
    }
    panic!("no second survey: {:?}", flight.texts());
}

/// A report of one survey of a log holds nothing of the other.
#[test]
fn two_surveys_of_one_log_are_kept_apart() {
    let folder = folder();
    let (first, both) = (folder.join("one-survey.mcap"), folder.join("two-surveys.mcap"));
    let (seen, began_s) = fly_twice(&first, &both);

    let alone = Flight::read(&first).expect("a flight");
    let one = Flight::read_one(&both, Some(1)).expect("a flight");
    assert_eq!((one.place.number, one.place.n_in_log), (1, 2));
    // What the books know it by, though the log has gone on.
    assert_eq!(one.identity, alone.identity);
    assert_eq!(one.reproduction, Reproduction::Identical);
    assert!(one.is_final && one.is_complete);
    let same_log = Flight { log: one.log.clone(), place: one.place.clone(), ..alone };
    assert!(one == same_log, "the second survey shows in the first");

    let two = Flight::read(&both).expect("a flight");
    assert_eq!((two.place.number, two.place.n_in_log), (2, 2));
    assert_eq!(two.reproduction, Reproduction::Identical);
    assert_eq!(two.warnings.len(), seen.warnings);
    assert_eq!(two.fixes.n_all(), seen.frames);
    assert_eq!(two.path_m.first().copied(), seen.first_place_m);
    assert!((two.place.began_at.seconds() - began_s).abs() < 0.1, "{:?}", two.place);
    assert_eq!(two.started, two.civil(two.place.began_at));
    assert!(two.started > one.started);
    assert_eq!(two.hits.len() as u64, two.counts.used);
    assert!(two.hits.iter().all(|hit| hit.at.seconds() > began_s));
    assert!(one.hits.iter().all(|hit| hit.at.seconds() < began_s));
    assert!(two.phases.iter().all(|change| change.at.seconds() >= began_s - 0.1));
    assert_the_second_is_compared_with_the_first(&one, two, &folder);
}

/// Both in one log, in the report and in the pack.
fn assert_the_second_is_compared_with_the_first(one: &Flight, two: Flight, folder: &Path) {
    let log = two.log.clone();
    let earlier = Survey::read_one(&log, Some(1)).expect("a survey");
    assert_eq!(earlier.accounts, one.accounts);
    let wishes = Wishes { against: Some(earlier), risk: 0.05, ..Wishes::default() };
    let facts = Facts::new(two, wishes).expect("facts");
    let change = facts.bays[0].change.as_ref().expect("a change").change;
    let volume_m3 = |accounts: &[VolumeAccount]| accounts[0].estimate.volume_m3;
    let expected_m3 = volume_m3(&facts.flight.accounts) - volume_m3(&one.accounts);
    assert!(
        (change.change_m3 - expected_m3).abs() < 1e-9 && expected_m3.abs() > 1e-9,
        "{change:?}"
    );
    let sum = sha256_of_file(&log).expect("a sum");
    let report = Report::new(&facts, &sum).expect("a report");
    assert!(report.html.contains("two-surveys.mcap, number 1 of 2"), "not named");
    let (key, out) = (folder.join("two.key"), folder.join("pack-of-two"));
    let _absent = std::fs::remove_dir_all(&out);
    for name in ["two.key", "two.pub"] {
        let _absent = std::fs::remove_file(folder.join(name));
    }
    make_key(&key).expect("a key");
    let key = AuditKey::read(&key).expect("a key");
    pack(&facts, &sum, &key, &out).expect("a pack");
    let found = verify(&out, Some(key.public())).expect("a verification");
    assert_eq!(found.findings, []);
}
