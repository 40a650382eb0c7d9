//! The example configuration shows every key with its default.

use std::path::Path;
use stockpilot::config::Config;
use toml::{Table, Value};

const EXAMPLE: &str = include_str!("../../deploy/config.example.toml");

/// What has no default, by table; of arrays, by element.
const REQUIRED: [(&str, &[&str]); 4] = [
    ("hall", &["region", "max_pile_height_m"]),
    ("lidar", &["model", "port", "mount", "max_range_m"]),
    ("cameras", &["size_px", "focal_px", "principal_px", "mount"]),
    ("tags", &["family", "id", "corners_m"]),
];

fn parsed(table: &Table) -> Config {
    Config::from_toml(&toml::to_string(table).unwrap(), Path::new("example")).unwrap()
}

fn keep_only(value: &mut Value, keys: &[&str]) {
    match value {
        Value::Table(table) => table.retain(|key, _| keys.contains(&key)),
        Value::Array(elements) => elements.iter_mut().for_each(|element| keep_only(element, keys)),
        _ => panic!("{value} is neither a table nor an array"),
    }
}

/// Every key of every table, with the names of the tables around it.
fn keys_of(value: &Value, path: &str, keys: &mut Vec<String>) {
    match value {
        Value::Table(table) => {
            for (key, value) in table {
                keys.push(format!("{path}.{key}"));
                keys_of(value, &format!("{path}.{key}"), keys);
            }
        }
        Value::Array(elements) => elements.iter().for_each(|e| keys_of(e, path, keys)),
        _ => {}
    }
}

#[test]
fn the_example_is_the_default() {
    let example: Table = EXAMPLE.parse().unwrap();
    let mut least = example.clone();
    least.retain(|section: &str, value| {
        let required = REQUIRED.iter().find(|(name, _)| *name == section);
        required.inspect(|(_, keys)| keep_only(value, keys)).is_some()
    });
    assert_eq!(least.len(), REQUIRED.len());
    let mut defaults = parsed(&least);
    // The one setting that an example cannot leave at its default: the own body hides something.
    assert!(defaults.lidar.blind_sectors_deg.is_empty());
    let example = parsed(&example);
    defaults.lidar.blind_sectors_deg.clone_from(&example.lidar.blind_sectors_deg);
    assert_eq!(example, defaults);
}

#[test]
fn the_example_shows_every_key() {
    let example: Table = EXAMPLE.parse().unwrap();
    let effective: Table = parsed(&example).to_toml().unwrap().parse().unwrap();
    let (mut shown, mut known) = (Vec::new(), Vec::new());
    keys_of(&Value::Table(example), "", &mut shown);
    keys_of(&Value::Table(effective), "", &mut known);
    assert!(known.len() > 60, "{} keys", known.len());
    for key in &known {
        assert!(shown.contains(key), "{key} is missing in deploy/config.example.toml");
    }
}
