//! A survey's report and its exports say what its log says: flown, recorded, read again.

#![expect(clippy::expect_used, reason = "a test may stop at the first surprise")]

use std::path::{Path, PathBuf};
use stockpilot::config::{Config, SurfaceName};
use stockpilot::export::sha256_of_file;
use stockpilot::messages::{CellCoverage, VolumeAccount};
use stockpilot::record::{LogHeader, Recorder};
use stockpilot::report::{Facts, Report, Target, Wishes};
use stockpilot::survey::{Flight, Reproduction, Survey};
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
    config.surface.solve_interval_s = 60.0;
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
    assert_eq!(json["survey"]["started_utc"], "2026-03-04T05:06:07Z");
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
