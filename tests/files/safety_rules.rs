//! Every safety rule, and every equation that says by what it is checked, names tests that exist.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

const ARCHITECTURE: &str = include_str!("../../ARCHITECTURE.md");
/// Where tests stand.
const FOLDERS: [&str; 4] = ["src", "tests", "sim/src", "sim/tests"];

/// Every Rust file of the project.
fn sources() -> Vec<String> {
    let mut sources = Vec::new();
    for folder in FOLDERS {
        collect_sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder), &mut sources);
    }
    sources
}

fn collect_sources(folder: &Path, sources: &mut Vec<String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect_sources(&path, sources);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            sources.push(fs::read_to_string(&path).unwrap());
        }
    }
}

fn tests(sources: &[String]) -> BTreeSet<String> {
    let tests: BTreeSet<String> = sources.iter().flat_map(|code| tests_of(code)).collect();
    assert!(tests.len() > 150, "{} tests found", tests.len());
    tests
}

/// What a module's head says after `Checked:`, up to the next paragraph, in `code`.
fn checked_by(code: &str) -> Vec<String> {
    let head = code.lines().map_while(|line| line.strip_prefix("//!"));
    let mut is_list = false;
    let mut named = Vec::new();
    for line in head {
        is_list = line.contains("Checked:") || is_list && !line.trim().is_empty();
        if is_list {
            named.extend(line.split('`').skip(1).step_by(2).map(ToOwned::to_owned));
        }
    }
    // Modules and items are named beside the tests.
    named
        .retain(|name| name.contains('_') && name.chars().all(|c| c == '_' || c.is_alphanumeric()));
    named
}

#[test]
fn what_equations_are_checked_by_exists() {
    let sources = sources();
    let tests = tests(&sources);
    let named: Vec<String> = sources.iter().flat_map(|code| checked_by(code)).collect();
    assert!(named.len() > 30, "{} names found", named.len());
    let is_item = |name: &str| sources.iter().any(|code| code.contains(&format!("mod {name};")));
    let missing: Vec<_> =
        named.iter().filter(|name| !tests.contains(*name) && !is_item(name)).collect();
    assert!(missing.is_empty(), "{missing:?}");
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
    let tests = tests(&sources());
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
