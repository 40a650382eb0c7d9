//! The paper's experiment and the comparison of planners, as short as they can be.

use clap::Parser;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::Path;
use stockpilot_sim::camera::CameraArgs;
use stockpilot_sim::comparison::{self, ComparisonArgs};
use stockpilot_sim::paper::{Experiment, Method, Settings, make};
use stockpilot_sim::scenario::{Planner, ScenarioArgs};

#[derive(Debug, Parser)]
struct Words {
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    camera: CameraArgs,
    #[command(flatten)]
    comparison: ComparisonArgs,
}

/// Width and height of a PNG by its first chunk.
fn png_size(bytes: &[u8]) -> [u32; 2] {
    assert!(bytes.starts_with(b"\x89PNG\r\n\x1a\n") && &bytes[12..16] == b"IHDR");
    [&bytes[16..20], &bytes[20..24]].map(|n| u32::from_be_bytes(n.try_into().expect("four bytes")))
}

/// Width and height of an SVG by its head.
fn svg_size(text: &str) -> [u32; 2] {
    ["width", "height"].map(|name| {
        let rest = text.split_once(&format!(" {name}=\"")).expect("a size").1;
        rest.split_once('"').expect("a quote").0.parse().expect("a number")
    })
}

/// Every file of a folder by name.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    entries
        .map(|entry| {
            let path = entry.expect("an entry").path();
            let name = path.file_name().expect("a name").to_string_lossy().into_owned();
            (name, std::fs::read(path).expect("a file"))
        })
        .collect()
}

#[test]
fn the_paper_is_drawn_with_its_numbers_and_its_table() {
    // One leg of the square wave.
    let words = ["test", "--steps=2", "--leg-spacing-m=20"];
    let scenario = Words::parse_from(words).scenario.scenario(1).expect("a world");
    let settings = Settings {
        maps_after: vec![1],
        solve_interval_s: 5.0,
        quality_cell_m: 4.0,
        n_jobs: NonZeroUsize::new(2).expect("not zero"),
    };
    let experiments = [
        Experiment::new(Planner::Greedy, Method::AsPrinted, None),
        Experiment::new(Planner::SquareWave, Method::MaternField, None),
    ];
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("new");
    let summary = make(&scenario, &experiments, &settings, &out).expect("pictures");
    let files = files(&out);
    let mut names = vec!["ground_truth".to_owned(), "quality_of_fix".to_owned()];
    for (method, planner) in [("kalman-grid-printed", "greedy"), ("matern-field", "square-wave")] {
        let maps = ["uncertainty", "reconstruction"];
        names.extend(maps.map(|what| format!("{method}_{planner}_01_{what}")));
        names.extend(["volume", "sigma"].map(|what| format!("{method}_{what}")));
    }
    for name in &names {
        let text = |ending: &str| {
            let bytes = files.get(&format!("{name}.{ending}")).expect(name);
            String::from_utf8(bytes.clone()).expect("a text")
        };
        let size = svg_size(&text("svg"));
        assert_eq!(png_size(&files[&format!("{name}.png")]), size.map(|side| 2 * side), "{name}");
        assert!(text("csv").lines().count() > 2, "{name} has no numbers");
    }
    // The curve of the volume ends where the table says.
    let chart = String::from_utf8(files["matern-field_volume.csv"].clone()).expect("a text");
    let curve: Vec<f64> = chart
        .lines()
        .filter_map(|line| line.strip_prefix("square-wave,")?.rsplit(',').next()?.parse().ok())
        .collect();
    let row = &summary.rows[1];
    assert!((curve.last().expect("a curve") - row.volume_m3).abs() < 1e-9);
    assert_eq!((summary.rows.len(), row.steps, row.surface), (2, 2, "matern-field"));
    assert!(summary.rows.iter().all(|row| row.path_m > 1.0 && row.sigma_m3 > 0.0), "{summary:?}");
    let table = String::from_utf8(files["summary.md"].clone()).expect("a text");
    assert_eq!(table.lines().filter(|line| line.starts_with("| ")).count(), 4, "{table}");
    let json: serde_json::Value = serde_json::from_slice(&files["summary.json"]).expect("JSON");
    assert_eq!(json["rows"][0]["planner"], "greedy");
}

#[test]
fn a_comparison_on_two_cores_equals_that_on_one_but_for_the_clock() {
    let words = Words::parse_from([
        "test",
        "--steps=2",
        "--planners=greedy,square-wave",
        "--worlds=piles",
        "--leg-spacing-m=20",
        "--target-percent=30",
        "--solve-interval-s=10",
    ]);
    let compare = |n_jobs: usize| {
        let n_jobs = NonZeroUsize::new(n_jobs).expect("not zero");
        let Words { scenario, camera, comparison } = &words;
        let mut compared =
            comparison::run(scenario, camera, comparison, 0..1, n_jobs).expect("flights");
        compared.planners.values_mut().for_each(|planner| planner.plan_ms_median = 0.0);
        compared
    };
    let compared = compare(2);
    let json = |c| serde_json::to_string(c).expect("JSON");
    assert_eq!(json(&compared), json(&compare(1)));
    assert_eq!(compared.runs.len(), 2);
    for run in &compared.runs {
        assert!(run.has_ended && !run.has_collided && run.path_m > 1.0, "{run:?}");
        assert!(run.n_plans > 0, "{run:?}");
        assert!(run.final_charge_ratio > 0.5 && run.final_charge_ratio < 1.0, "{run:?}");
        // A quadrotor of this size draws 150 to 400 W.
        if let (Some(wh), Some(s)) = (run.energy_to_target_wh, run.time_to_target_s) {
            assert!((150.0..400.0).contains(&(3600.0 * wh / s)), "{run:?}");
        }
    }
}
