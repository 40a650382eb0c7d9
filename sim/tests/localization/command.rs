//! The command `consistency`: what it prints and writes, and that it prints the same again.

use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Two short flights, at one latency or several.
fn printed(latencies: &str, out: &Path) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_stockpilot-sim"))
        .args(["consistency", "--world", "piles", "--planner", "square-wave", "--json"])
        .args(["--seeds", "3..5", "--flight-s", "28", "--latency-ms", latencies])
        .arg("--out")
        .arg(out)
        .output()
        .expect("the program runs");
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{errors}");
    String::from_utf8(output.stdout).expect("text")
}

fn number(value: &Value, path: &str) -> f64 {
    let found = value.pointer(path).and_then(Value::as_f64);
    assert!(found.is_some(), "no number at {path} in {value}");
    found.expect("looked at above")
}

fn assert_is_a_setting(value: &Value) {
    let keys: Vec<&String> = value["groups"].as_object().expect("an object").keys().collect();
    assert_eq!(keys, ["attitude", "position", "velocity"]);
    for group in keys {
        let at = |field| number(value, &format!("/groups/{group}/{field}"));
        let (low, high) = (at("band_low"), at("band_high"));
        assert!(0.0 < low && low < 3.0 && 3.0 < high, "{group}: {low} to {high}");
        assert!(at("nees_mean") > 0.0);
    }
    // The hall has tags enough that a pose is good to centimetres.
    let rms_m = number(value, "/position_rms_m");
    assert!(0.0 < rms_m && rms_m < 0.03, "{rms_m} m");
    let yaw_deg = number(value, "/yaw_rms_deg");
    assert!(0.0 < yaw_deg && yaw_deg < 0.3, "{yaw_deg}°");
    assert_eq!(value["n_broken"], 0);
    assert!(number(value, "/nis/n") > 100.0);
}

#[test]
fn the_json_has_the_agreed_form_and_the_same_seeds_give_the_same_numbers() {
    let (first, second) = (tempfile::tempdir().expect("a"), tempfile::tempdir().expect("b"));
    let text = printed("30", first.path());
    let value: Value = serde_json::from_str(&text).expect("one object");
    assert_is_a_setting(&value);
    assert_eq!(value["latency_ms"], 30);
    assert_eq!(value["update"], "tight");
    assert_eq!(value["n_runs"], 2);
    assert_eq!(text, printed("30", second.path()));
    for file in ["nees-tight-30ms.csv", "nees-tight-30ms.svg", "summary.csv"] {
        let read = |directory: &Path| std::fs::read_to_string(directory.join(file));
        let written = read(first.path()).expect("a file");
        assert!(written.len() > 200, "{file}: {written}");
        assert_eq!(written, read(second.path()).expect("a file"), "{file}");
    }
}

#[test]
fn several_settings_come_as_a_list_with_a_line_per_group_in_the_summary() {
    let out = tempfile::tempdir().expect("a directory");
    let value: Value = serde_json::from_str(&printed("10,150", out.path())).expect("one object");
    let settings = value["settings"].as_array().expect("a list");
    let latencies: Vec<&Value> = settings.iter().map(|setting| &setting["latency_ms"]).collect();
    assert_eq!(latencies, [10, 150]);
    settings.iter().for_each(assert_is_a_setting);
    let summary = std::fs::read_to_string(out.path().join("summary.csv")).expect("a file");
    // A head, and for each setting four groups of states and the innovations.
    assert_eq!(summary.lines().count(), 1 + 2 * 5, "{summary}");
    // The position of the first setting, from the summary and from the JSON.
    let position = summary.lines().find(|line| line.contains(",10,2,position,")).expect("a line");
    let mean: f64 = position.split(',').nth(4).expect("a field").parse().expect("a number");
    assert!((mean - number(&settings[0], "/groups/position/nees_mean")).abs() < 1e-4);
}
