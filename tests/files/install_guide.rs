//! The commands of the guides for the companion computer are commands of the program.

use std::path::Path;
use std::process::Command;

const GUIDES: [(&str, &str, usize); 2] = [
    ("deploy/install.md", include_str!("../../deploy/install.md"), 17),
    ("deploy/README.md", include_str!("../../deploy/README.md"), 1),
];

/// What makes somebody else of the login user.
const SUDO: [&str; 2] = ["sudo -u stockpilot env -C /var/lib/stockpilot ", "sudo "];

/// What stands in the blocks of code: whether behind `sudo`, and the command of the program.
fn commands(guide: &str) -> impl Iterator<Item = (bool, &str)> {
    let blocks = guide.lines().filter(|line| line.starts_with("    ")).map(str::trim_start);
    let split = blocks.map(|line| {
        let behind = SUDO.iter().find_map(|sudo| line.strip_prefix(sudo));
        (behind.is_some(), behind.unwrap_or(line))
    });
    split.filter(|(_, command)| command.starts_with("stockpilot "))
}

/// Only the service's user reads in its folder (the unit's `StateDirectoryMode`), and only root writes
/// beside the configuration.
fn needs_sudo(command: &str) -> bool {
    let words: Vec<&str> = command.split_whitespace().collect();
    let writes = words.windows(2).any(|pair| {
        ["--write", "--out"].contains(&pair[0]) && pair[1].starts_with("/etc/stockpilot/")
    });
    writes || words.iter().any(|word| word.starts_with("/var/lib/stockpilot"))
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
        let found: Vec<(bool, &str)> = commands(guide).collect();
        assert!(found.len() >= at_least, "{name}: {found:?}");
        for (_, command) in found {
            is_understood(command).unwrap();
        }
    }
    assert!(is_understood("stockpilot calibrate lidar LOG --emty").is_err());
}

#[test]
fn what_the_login_user_may_not_do_stands_behind_sudo() {
    let unit = include_str!("../../deploy/stockpilot.service");
    assert!(unit.contains("StateDirectoryMode=0750\n") && unit.contains("UMask=0027\n"));
    let of = |needs: bool| {
        let all = GUIDES.iter().flat_map(|(_, guide, _)| commands(guide));
        all.filter(move |(_, command)| needs_sudo(command) == needs)
    };
    assert!(of(true).count() >= 7 && of(false).count() >= 5);
    for (has_sudo, command) in of(true) {
        assert!(has_sudo, "{command}");
    }
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
