//! Every safety rule names tests that exist.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

const ARCHITECTURE: &str = include_str!("../../ARCHITECTURE.md");
/// Where tests stand.
const FOLDERS: [&str; 4] = ["src", "tests", "sim/src", "sim/tests"];

/// Adds the names of the tests in all Rust files below `folder`.
fn collect_tests(folder: &Path, names: &mut BTreeSet<String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect_tests(&path, names);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            names.extend(tests_of(&fs::read_to_string(&path).unwrap()));
        }
    }
}

/// Names of the functions that follow a `#[test]` or `#[tokio::test]`.
fn tests_of(code: &str) -> Vec<String> {
    let is_mark = |line: &str| line.starts_with("#[test]") || line.starts_with("#[tokio::test");
    let mut lines = code.lines().map(str::trim);
    let mut names = Vec::new();
    while let Some(line) = lines.next() {
        if is_mark(line) {
            let function = lines.by_ref().find_map(|line| line.split_once("fn "));
            let name = function.and_then(|(_, rest)| rest.split_once('('));
            names.extend(name.map(|(name, _)| name.to_owned()));
        }
    }
    names
}

#[test]
fn every_safety_rule_is_held_by_a_test_that_exists() {
    let mut tests = BTreeSet::new();
    for folder in FOLDERS {
        collect_tests(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder), &mut tests);
    }
    assert!(tests.len() > 150, "{} tests found", tests.len());
    let rules: Vec<_> = ARCHITECTURE.lines().filter(|line| line.starts_with("| SAF-")).collect();
    assert!(rules.len() >= 8, "{} rules found", rules.len());
    for (index, rule) in rules.iter().enumerate() {
        let cells: Vec<_> = rule.trim_matches('|').split(" | ").map(str::trim).collect();
        let [id, _, held_by] = cells[..] else { panic!("not a rule: {rule}") };
        assert_eq!(id, format!("SAF-{:02}", index + 1));
        let named: Vec<_> = held_by.split('`').skip(1).step_by(2).collect();
        assert!(!named.is_empty(), "{id} names no test");
        for name in named {
            assert!(tests.contains(name), "{id}: there is no test {name}");
        }
    }
}
