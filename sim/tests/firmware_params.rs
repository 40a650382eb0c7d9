//! The parameter files agree with their pages, and PX4's with the simulated autopilot.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test may stop at the first surprise")]

use std::collections::BTreeMap;
use stockpilot::link::params::ParamFile;
use stockpilot_sim::autopilot::{ParamTable, ParamValue};

const FILE: &str = include_str!("../../firmware-params/px4-indoor-vision.params");
const README: &str = include_str!("../../firmware-params/README.md");
const ARDUPILOT_FILE: &str = include_str!("../../firmware-params/ardupilot-indoor-vision.parm");
const ARDUPILOT_PAGE: &str = include_str!("../../firmware-params/ardupilot.md");

/// MAVLink's numbers for INT32 and REAL32.
const INT32: &str = "6";
const REAL32: &str = "9";

/// Names and values of the file, in the format of `QGroundControl`: vehicle, component, name, value
/// and type between tabs.
fn file_values() -> BTreeMap<&'static str, ParamValue> {
    let mut values = BTreeMap::new();
    for line in FILE.lines().filter(|line| !line.starts_with('#')) {
        let fields: Vec<_> = line.split('\t').collect();
        let ["1", "1", name, value, kind] = fields[..] else { panic!("not a parameter: {line:?}") };
        let value = match kind {
            INT32 => ParamValue::Int(value.parse().unwrap()),
            REAL32 => ParamValue::Real(value.parse().unwrap()),
            _ => panic!("{name} has type {kind}"),
        };
        assert!(values.insert(name, value).is_none(), "{name} stands twice");
    }
    assert!(values.len() > 10, "{} parameters", values.len());
    values
}

/// Rows of the README's tables that begin with a parameter's name: its other columns by name.
fn readme_rows(n_columns: usize) -> BTreeMap<&'static str, Vec<&'static str>> {
    rows_of(README, n_columns)
}

fn rows_of(page: &'static str, n_columns: usize) -> BTreeMap<&'static str, Vec<&'static str>> {
    let rows = page.lines().filter_map(|line| {
        let cells: Vec<_> = line.strip_prefix("| `")?.strip_suffix(" |")?.split(" | ").collect();
        let name = cells.first()?.strip_suffix('`')?;
        (cells.len() == n_columns).then(|| (name, cells[1..].to_vec()))
    });
    rows.collect()
}

fn number(value: ParamValue) -> f64 {
    match value {
        ParamValue::Int(value) => f64::from(value),
        ParamValue::Real(value) => f64::from(value),
    }
}

#[test]
fn every_parameter_is_justified_with_its_value() {
    let (file, readme) = (file_values(), readme_rows(4));
    assert!(file.keys().eq(readme.keys()), "{:?} and {:?}", file.keys(), readme.keys());
    for (name, cells) in readme {
        let told: f64 = cells[0].parse().unwrap();
        assert!((number(file[name]) - told).abs() < 1e-9, "{name}: {told} in the README");
        assert!(cells[1].len() > 20, "{name} has no reason");
        assert!(["flown", "documentation"].contains(&cells[2]), "{name} rests on {}", cells[2]);
    }
}

#[test]
fn the_simulated_autopilot_takes_every_parameter() {
    let mut table = ParamTable::indoor();
    for (name, value) in file_values() {
        assert!(table.set(name, value), "{name} is unknown or of another type");
        assert_eq!(table.get(name), Some(value));
    }
}

#[test]
fn what_was_flown_is_what_the_simulator_flies_unless_told() {
    let (file, readme) = (file_values(), readme_rows(4));
    let (defaults, indoor) = (ParamTable::defaults(), ParamTable::indoor());
    let told_to_differ = readme_rows(3);
    assert_eq!(told_to_differ.len(), 3);
    let mut n_compared = 0;
    for index in 0..indoor.len() {
        let (name, flown) = indoor.at(index).unwrap();
        let is_changed = defaults.get(name) != Some(flown);
        if is_changed && !told_to_differ.contains_key(name) {
            assert_eq!(file.get(name), Some(&flown), "{name}");
            n_compared += 1;
        }
    }
    assert!(n_compared >= 8, "{n_compared} parameters compared");
    for (name, cells) in readme.iter().filter(|(_, cells)| cells[2] == "flown") {
        assert_eq!(indoor.get(name), file.get(name).copied(), "{name}: {cells:?}");
    }
}

#[test]
fn the_pilot_keeps_the_switches() {
    // 4 ignores every stick source, and with it the pilot's mode switch.
    let file = file_values();
    assert_eq!(file["COM_RC_IN_MODE"], ParamValue::Int(0));
    assert_eq!(file["COM_RCL_EXCEPT"], ParamValue::Int(0));
    assert_eq!(readme_rows(3)["COM_RC_IN_MODE"][0], "4");
    // Bit 2 of FS_OPTIONS flies on in GUIDED without a transmitter; GUID_OPTIONS can ignore its yaw stick.
    let ardupilot = |name: &str| {
        let line = ARDUPILOT_FILE.lines().find_map(|line| line.strip_prefix(name));
        line.and_then(|value| value.trim().parse::<u32>().ok()).unwrap()
    };
    assert_eq!((ardupilot("FS_OPTIONS ") & 4, ardupilot("GUID_OPTIONS ")), (0, 0));
}

/// An action without a threshold does nothing.
#[test]
fn the_critical_battery_of_ardupilot_has_a_threshold_or_is_complained_of() {
    let file = ParamFile::parse(ARDUPILOT_FILE).unwrap();
    assert!(file.lines.iter().any(|line| line.name == "BATT_FS_CRT_ACT" && line.text == "1"));
    let is_demanded = |names: &[String]| names == ["BATT_CRT_VOLT", "BATT_CRT_MAH"];
    assert!(file.demands.iter().any(|demand| is_demanded(&demand.names)));
}

/// What was set when ArduCopter's simulator flew on ODOMETRY without GPS and without compass.
const ARDUPILOT_FLOWN: [(&str, f64); 8] = [
    ("COMPASS_ENABLE", 0.0),
    ("EK3_SRC1_POSXY", 6.0),
    ("EK3_SRC1_POSZ", 6.0),
    ("EK3_SRC1_VELXY", 6.0),
    ("EK3_SRC1_VELZ", 6.0),
    ("EK3_SRC1_YAW", 6.0),
    ("GPS1_TYPE", 0.0),
    ("VISO_TYPE", 1.0),
];

#[test]
fn every_ardupilot_parameter_is_justified_with_its_value() {
    let page = rows_of(ARDUPILOT_PAGE, 4);
    let rows = ARDUPILOT_FILE.lines().filter(|line| !line.starts_with('#'));
    let file: BTreeMap<&str, f64> = rows
        .map(|row| row.split_once(' ').map(|(name, value)| (name, value.parse().unwrap())).unwrap())
        .collect();
    assert!(file.len() > 10 && file.keys().eq(page.keys()), "{:?} {:?}", file.keys(), page.keys());
    for (name, cells) in &page {
        let told: f64 = cells[0].parse().unwrap();
        assert!((file[name] - told).abs() < 1e-9, "{name}: {told} on the page");
        assert!(cells[1].len() > 20, "{name} has no reason");
        let is_flown = ARDUPILOT_FLOWN
            .iter()
            .any(|(flown, value)| flown == name && (value - told).abs() < 1e-9);
        assert_eq!(cells[2], if is_flown { "flown" } else { "documentation" }, "{name}");
    }
}

/// Setpoints leave with every second tick. A dozen may be lost before the autopilot lets go, and
/// what it does then must come sooner than it could fly far.
#[test]
fn the_timeouts_of_setpoints_fit_the_rate_of_the_service() {
    let interval_s = 2.0 / f64::from(stockpilot::pilot::TICK_RATE_HZ);
    let wanted = |line: &str| line.split(' ').nth(1).unwrap().parse::<f64>().unwrap();
    let line = ARDUPILOT_FILE.lines().find(|line| line.starts_with("GUID_TIMEOUT ")).unwrap();
    let ardupilot_s = wanted(line);
    let px4_s = number(ParamTable::indoor().get("COM_OF_LOSS_T").unwrap());
    for timeout_s in [ardupilot_s, px4_s] {
        assert!(timeout_s > 12.0 * interval_s, "{timeout_s} s");
        assert!(timeout_s <= 1.0, "{timeout_s} s at 2 m/s");
    }
    // The firmware takes 0.1 to 5 s.
    assert!((0.1..=5.0).contains(&ardupilot_s));
}
