//! The commands of the guides for the companion computer are commands of the program.

use std::path::Path;
use std::process::Command;

const GUIDES: [(&str, &str, usize); 2] = [
    ("deploy/install.md", include_str!("../../deploy/install.md"), 16),
    ("deploy/README.md", include_str!("../../deploy/README.md"), 1),
];

/// What stands in the blocks of code, without `sudo`.
fn commands(guide: &str) -> impl Iterator<Item = &str> {
    let blocks = guide.lines().filter(|line| line.starts_with("    "));
    let words = blocks.map(|line| line.trim_start().trim_start_matches("sudo "));
    words.filter(|line| line.starts_with("stockpilot "))
}

/// The program reads every word of the command and then tells how it is used instead of doing it.
fn is_understood(command: &str) -> Result<(), String> {
    let output = Command::new(env!("CARGO_BIN_EXE_stockpilot"))
        .args(command.split_whitespace().skip(1))
        .arg("--help")
        .output()
        .unwrap();
    let is_help =
        output.status.success() && String::from_utf8_lossy(&output.stdout).contains("Usage:");
    let said = String::from_utf8_lossy(&output.stderr);
    is_help.then_some(()).ok_or_else(|| format!("{command}: {said}"))
}

#[test]
fn every_command_of_the_guides_is_one_of_the_program() {
    for (name, guide, at_least) in GUIDES {
        let found: Vec<&str> = commands(guide).collect();
        assert!(found.len() >= at_least, "{name}: {found:?}");
        for command in found {
            is_understood(command).unwrap();
        }
    }
    assert!(is_understood("stockpilot calibrate lidar LOG --emty").is_err());
}

#[test]
fn what_the_guides_name_in_the_package_is_packed() {
    let manifest = include_str!("../../Cargo.toml");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for (_, guide, _) in GUIDES {
        let words = guide.split(|c: char| c.is_whitespace() || "`|,;".contains(c));
        let packed = words.filter_map(|word| word.strip_prefix("/usr/share/stockpilot/"));
        for path in packed.map(|path| path.trim_end_matches('.')) {
            let folder = path.split('/').next().unwrap();
            assert!(manifest.contains(&format!("\"usr/share/stockpilot/{folder}/\"")), "{path}");
            let source =
                if folder == "ground-station" { root.join("deploy") } else { root.to_owned() };
            assert!(source.join(path).exists(), "{path}");
        }
    }
}
