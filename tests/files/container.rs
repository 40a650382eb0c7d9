//! The container file copies what is there and carries labels that `BlueOS` can read.

use serde_json::Value;
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Command;

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
    let inside = value.strip_prefix(quote).unwrap().strip_suffix(quote).unwrap();
    // Between double quotes a builder sees variables and escapes.
    if quote == '"' {
        inside.replace("\\\"", "\"").replace("$SOURCE_URL", &source_url())
    } else {
        inside.to_owned()
    }
}

/// The default of the argument that says where the source is.
fn source_url() -> String {
    let instructions = instructions();
    instructions.iter().find_map(|line| line.strip_prefix("ARG SOURCE_URL=")).unwrap().to_owned()
}

/// The folders of the image that are hidden by those of the host.
fn bound() -> Vec<String> {
    let permissions: Value = serde_json::from_str(&label("permissions")).unwrap();
    let binds = permissions["HostConfig"]["Binds"].as_array().unwrap();
    binds.iter().map(|bind| bind.as_str().unwrap().split(':').nth(1).unwrap().to_owned()).collect()
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
    assert!(json("links")["source"].as_str().unwrap().starts_with("https://"));
    assert!(label("readme").starts_with("https://") && label("readme").contains("{tag}"));
}

#[test]
fn nothing_that_it_brings_is_hidden_by_the_folders_of_the_host() {
    let bound = bound();
    assert!(bound.contains(&"/etc/stockpilot".to_owned()), "{bound:?}");
    let instructions = instructions();
    let copies = instructions.iter().filter_map(|line| line.strip_prefix("COPY "));
    let targets: Vec<&str> = copies.map(|copy| copy.split_whitespace().last().unwrap()).collect();
    assert!(targets.contains(&"/usr/share/stockpilot/hall.toml"), "{targets:?}");
    for target in targets {
        assert!(!bound.iter().any(|folder| target.starts_with(folder.as_str())), "{target}");
    }
    // Who runs in it can be given the folders on the host, by the numbers that the file tells.
    assert!(FILE.contains("groupadd --system --gid 990") && FILE.contains("--uid 990 --gid 990"));
    let on_blueos: Vec<&str> = FILE.lines().filter(|line| line.contains("sudo chown")).collect();
    assert_eq!(on_blueos, ["#   sudo chown -R 990:990 /usr/blueos/extensions/stockpilot"]);
}

/// What the container runs, on folders below `root` and with a program that tells its words.
fn start(root: &Path, words: &[&str]) -> (String, String) {
    let script = include_str!("../../deploy/container-start");
    let here = |folder: &str| root.join(folder.trim_start_matches('/')).display().to_string();
    let mut moved = script.to_owned();
    for folder in ["/usr/bin", "/usr/share/stockpilot", "/etc/stockpilot"] {
        assert!(script.contains(folder));
        moved = moved.replace(folder, &here(folder));
    }
    fs::create_dir_all(here("/usr/bin")).unwrap();
    let program = here("/usr/bin/stockpilot");
    fs::write(&program, "#!/bin/sh\necho \"$@\"\n").unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let output = Command::new("sh").arg("-c").arg(moved).arg("start").args(words).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
    (text(&output.stdout), text(&output.stderr))
}

#[test]
fn an_empty_folder_gets_the_example_and_a_foreign_one_is_told() {
    let root = tempfile::tempdir().unwrap();
    let at = |path: &str| root.path().join(path);
    // The words of a person go to the program as they are.
    assert_eq!(start(root.path(), &["doctor", "--json"]).0, "doctor --json");
    fs::create_dir_all(at("usr/share/stockpilot")).unwrap();
    fs::write(at("usr/share/stockpilot/hall.toml"), "# the example").unwrap();
    // Where nothing can be written it says so, and still starts.
    let example = format!("run --config {}", at("usr/share/stockpilot/hall.toml").display());
    let (ran, told) = start(root.path(), &[]);
    assert_eq!(ran, example);
    assert!(told.contains("chown -R 990:990"), "{told}");
    fs::create_dir_all(at("etc/stockpilot")).unwrap();
    let own = format!("run --config {}", at("etc/stockpilot/hall.toml").display());
    assert_eq!(start(root.path(), &[]), (own.clone(), String::new()));
    assert_eq!(fs::read_to_string(at("etc/stockpilot/hall.toml")).unwrap(), "# the example");
    // What is there stays.
    fs::write(at("etc/stockpilot/hall.toml"), "# ours").unwrap();
    assert_eq!(start(root.path(), &[]).0, own);
    assert_eq!(fs::read_to_string(at("etc/stockpilot/hall.toml")).unwrap(), "# ours");
}
