//! A disk that fills or breaks in flight costs the rest of the log, and nothing else.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "tests may panic")]
#![expect(clippy::print_stdout, reason = "a test says what this machine does not let it do")]

use serde_json::Value;
use std::io::{BufRead, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use stockpilot::config::Config;
use stockpilot::pilot::Pilot;
use stockpilot::record::replay::replay;

const PROGRAM: &str = env!("CARGO_BIN_EXE_stockpilot-sim");
/// A flight's log has some 50 MB; the file may have so much, in units of 512 bytes.
const LARGEST_FILE_BLOCKS: u32 = 6_000;
/// What another flight has left.
const EARLIER: &[u8] = b"an earlier survey";

fn fly(folder: &Path) -> String {
    let folder = folder.to_str().unwrap();
    format!("exec {PROGRAM} fly --world piles --seed 5 --speed 8 --json --log {folder}")
}

fn begin(script: &str) -> Child {
    let child =
        Command::new("sh").args(["-c", script]).stderr(Stdio::piped()).stdout(Stdio::piped());
    child.spawn().unwrap()
}

/// Reads what the program says until the flight is over; calls `in_flight` once in the survey.
fn watch(mut child: Child, mut in_flight: impl FnMut()) -> (String, Value) {
    let mut told = String::new();
    let mut is_done = false;
    for line in BufReader::new(child.stderr.take().unwrap()).lines() {
        let line = line.unwrap();
        let seconds = line.split_once(" s ").and_then(|(t, _)| t.trim().parse::<f64>().ok());
        if !is_done && line.contains("survey") && seconds.is_some_and(|s| s > 20.0) {
            in_flight();
            is_done = true;
        }
        told += &(line + "\n");
    }
    let mut output = String::new();
    child.stdout.take().unwrap().read_to_string(&mut output).unwrap();
    assert!(child.wait().unwrap().success(), "{told}");
    (told, serde_json::from_str(output.lines().last().unwrap()).unwrap())
}

fn log_in(folder: &Path) -> PathBuf {
    let logs = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut logs = logs.filter(|path| path.extension().is_some_and(|e| e == "mcap"));
    logs.find(|path| !path.ends_with("flight-1.mcap")).expect("a log")
}

fn assert_flown(told: &str, report: &Value) {
    assert_eq!(report["complete"], Value::Bool(true));
    assert_eq!(report["collided"], Value::Bool(false));
    assert!(report["relative_error"].as_f64().unwrap().abs() < 0.01, "{report}");
    assert!(told.contains("the log has failed"), "{told}");
}

/// What was written before the disk failed replays to the last bit.
fn assert_replays(log: &Path, least_events: u64) {
    let report = replay(log, |toml| {
        Config::from_toml(toml, log).and_then(|config| config.pilot_settings()).map(Pilot::new)
    })
    .unwrap();
    assert!(report.identical, "{:?}", report.first_difference);
    assert!(!report.is_complete);
    assert!(report.events > least_events, "{} events", report.events);
}

#[test]
fn a_file_that_may_not_grow_ends_the_log_and_not_the_flight() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("flight-1.mcap"), EARLIER).unwrap();
    // A process that ignores the signal gets an error instead, as of a full disk.
    let limit = format!("trap '' XFSZ; ulimit -f {LARGEST_FILE_BLOCKS}; {}", fly(folder.path()));
    let (told, report) = watch(begin(&limit), || ());
    assert_flown(&told, &report);
    assert_replays(&log_in(folder.path()), 1_000);
    assert_eq!(std::fs::read(folder.path().join("flight-1.mcap")).unwrap(), EARLIER);
}

/// A small file system of its own; unmounted in the end.
struct Loop {
    folder: tempfile::TempDir,
}

impl Loop {
    /// `None` where this user or this machine cannot mount one.
    fn mount() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let script = "truncate -s 256M image && mkfs.ext4 -q image && mkdir disk \
                      && mount -o loop,errors=remount-ro image disk";
        let done = Command::new("sh").args(["-c", script]).current_dir(folder.path()).output();
        done.unwrap().status.success().then_some(Self { folder })
    }

    fn disk(&self) -> PathBuf {
        self.folder.path().join("disk")
    }

    /// What the kernel does when it finds the file system broken.
    fn breaks(&self) {
        let script = "device=$(findmnt -no SOURCE disk) \
                      && echo 1 > /sys/fs/ext4/${device#/dev/}/trigger_fs_error";
        let done = Command::new("sh").args(["-c", script]).current_dir(self.folder.path()).status();
        assert!(done.unwrap().success());
    }

    fn shell(&self, script: &str) -> bool {
        let done = Command::new("sh").args(["-c", script]).current_dir(self.folder.path()).status();
        done.unwrap().success()
    }
}

impl Drop for Loop {
    fn drop(&mut self) {
        self.shell("umount disk");
    }
}

#[test]
fn a_disk_that_turns_read_only_ends_the_log_and_not_the_flight() {
    let Some(mounted) = Loop::mount() else {
        println!("no file system of its own can be mounted here: not tried");
        return;
    };
    let disk = mounted.disk();
    std::fs::write(disk.join("flight-1.mcap"), EARLIER).unwrap();
    let (told, report) = watch(begin(&fly(&disk)), || mounted.breaks());
    assert_flown(&told, &report);
    // After the repair that a start of the computer makes.
    assert!(mounted.shell("umount disk && e2fsck -fy image >/dev/null; mount -o loop image disk"));
    assert_replays(&log_in(&disk), 1_000);
    assert_eq!(std::fs::read(disk.join("flight-1.mcap")).unwrap(), EARLIER);
}
