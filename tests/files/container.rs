//! The container file copies what is there and carries labels that `BlueOS` can read.

use serde_json::Value;
use std::path::Path;

const FILE: &str = include_str!("../../deploy/Containerfile");

/// The instructions, with continued lines joined as a builder joins them.
fn instructions() -> Vec<String> {
    let joined = FILE.replace("\\\n", "");
    let lines = joined.lines().map(str::trim);
    lines.filter(|line| !line.is_empty() && !line.starts_with('#')).map(str::to_owned).collect()
}

/// A label's value without its quotes.
fn label(name: &str) -> String {
    let head = format!("LABEL {name}=");
    let instructions = instructions();
    let value = instructions.iter().find_map(|line| line.strip_prefix(&head)).unwrap();
    let quote = value.chars().next().unwrap();
    value.strip_prefix(quote).unwrap().strip_suffix(quote).unwrap().to_owned()
}

#[test]
fn labels_are_what_blueos_reads() {
    assert_eq!(label("version"), env!("CARGO_PKG_VERSION"));
    assert!(label("requirements").starts_with("core "));
    let json = |name: &str| serde_json::from_str::<Value>(&label(name)).unwrap();
    let permissions = json("permissions");
    let host = &permissions["HostConfig"];
    assert!(host["Binds"].as_array().unwrap().len() >= 2);
    assert_eq!(host["Privileged"], Value::Null);
    assert!(json("authors")[0]["name"].is_string());
    assert!(json("company")["name"].is_string());
    assert!(json("tags").is_array());
}

#[test]
fn it_copies_what_is_there_and_runs_as_nobody_special() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let instructions = instructions();
    let copies = instructions.iter().filter_map(|line| line.strip_prefix("COPY "));
    let mut n_sources = 0;
    for copy in copies.filter(|copy| !copy.contains("--from=")) {
        let words: Vec<&str> =
            copy.split_whitespace().filter(|word| !word.starts_with("--")).collect();
        let (_, sources) = words.split_last().unwrap();
        for source in sources {
            assert!(root.join(source).exists(), "{source}");
            n_sources += 1;
        }
    }
    assert!(n_sources >= 6);
    let toolchain = include_str!("../../rust-toolchain.toml");
    let image = instructions.iter().find(|line| line.contains("AS build")).unwrap();
    let version = image.split("rust:").nth(1).unwrap().split('-').next().unwrap();
    assert!(toolchain.contains(&format!("\"{version}.")), "{image} is not the pinned Rust");
    let last_user = instructions.iter().rfind(|line| line.starts_with("USER ")).unwrap();
    assert_eq!(last_user, "USER stockpilot");
}
