//! A disk that fills or breaks in flight costs the rest of the log, and nothing else: the vehicle flies its
//! survey and lands, what was written before replays to the last bit, and what lay there stays.
//!
//! File systems that are filled and broken are mounted from a file, as only root may. Elsewhere the limit of a
//! file's size stands for the full one.

#![expect(clippy::unwrap_used, reason = "tests may panic")]
#![expect(clippy::print_stdout, reason = "a test says what this machine does not let it do")]

use serde_json::Value;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, PoisonError};
use stockpilot::config::Config;
use stockpilot::mission::Phase;
use stockpilot::pilot::{Action, PhaseChange, Pilot};
use stockpilot::record::replay::replay;
use stockpilot::record::{LogHeader, Recorder};
use stockpilot::time::Stamp;

const PROGRAM: &str = env!("CARGO_BIN_EXE_stockpilot-sim");
/// A flight's log has some 40 MB; the file may have so much, in units of 512 bytes.
const LARGEST_FILE_BLOCKS: u32 = 22_000;
/// The disk breaks or fills when the flight's clock shows this, s: in the survey.
const BREAKS_AT_S: f64 = 20.0;
/// So much of a flight lies before that: hundreds of samples a second.
const LEAST_EVENTS: u64 = 4_000;
/// A survey of few legs with the paper's surface errs by one or two percent.
const LARGEST_ERROR: f64 = 0.05;

/// The words for a flight whose log goes to a folder.
fn flight_into(folder: &Path) -> String {
    let survey = "--world piles --seed 5 --leg-spacing-m 10 --surface kalman-grid";
    format!("exec {PROGRAM} fly {survey} --speed 2 --json --log {}", folder.display())
}

/// Two flights at once are too many for a small machine: the service hears its autopilot too late, and holds.
static ONE_FLIGHT_AT_A_TIME: Mutex<()> = Mutex::new(());

fn begin(script: &str) -> Child {
    let mut shell = Command::new("sh");
    shell.args(["-c", script]).stderr(Stdio::piped()).stdout(Stdio::piped());
    shell.spawn().unwrap()
}

/// What a flight said on the way, and its report.
struct Flown {
    told: String,
    report: Value,
}

impl Flown {
    /// Waits for the end of the flight; calls `in_flight` once in the middle of the survey.
    fn watch(script: &str, in_flight: impl FnOnce()) -> Self {
        let _alone = ONE_FLIGHT_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let mut program = begin(script);
        let (mut told, mut in_flight) = (String::new(), Some(in_flight));
        for line in BufReader::new(program.stderr.take().unwrap()).lines() {
            let line = line.unwrap();
            let shown_s = line.split_once(" s ").and_then(|(t, _)| t.trim().parse::<f64>().ok());
            if line.contains("survey")
                && shown_s.is_some_and(|s| s > BREAKS_AT_S)
                && let Some(happens) = in_flight.take()
            {
                happens();
            }
            told += &(line + "\n");
        }
        let mut output = String::new();
        program.stdout.take().unwrap().read_to_string(&mut output).unwrap();
        assert!(program.wait().unwrap().success(), "{told}");
        assert!(in_flight.is_none(), "no survey was seen:\n{told}");
        let report = serde_json::from_str(output.lines().last().unwrap()).unwrap();
        Self { told, report }
    }

    fn assert_undisturbed(&self) {
        let report = &self.report;
        assert_eq!(report["complete"], Value::Bool(true));
        assert_eq!(report["collided"], Value::Bool(false));
        assert!(report["relative_error"].as_f64().unwrap().abs() < LARGEST_ERROR, "{report}");
        assert!(self.told.contains("the log has failed: the flight goes on"), "{}", self.told);
    }
}

/// Leaves the log of an earlier survey in the folder that nobody has reported; gives its bytes.
fn leave_earlier(folder: &Path) -> Vec<u8> {
    let path = folder.join("flight-1.mcap");
    let mut recorder = Recorder::create(&path, &LogHeader::default()).unwrap();
    let (from, to) = (Phase::Preflight, Phase::TakeOff);
    let change = PhaseChange { at: Stamp::ZERO, from, to, reason: "armed".to_owned() };
    recorder.result(Stamp::ZERO, &Action::PhaseChanged(change));
    assert_eq!(recorder.close().lost_on_disk, 0);
    std::fs::read(path).unwrap()
}

/// The earlier survey is as it was, and the new log replays to the last bit up to where it ends.
fn assert_logs(folder: &Path, of_earlier: &[u8]) {
    let logs = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let (earlier, new): (Vec<PathBuf>, Vec<PathBuf>) = logs
        .filter(|path| path.extension().is_some_and(|e| e == "mcap"))
        .partition(|path| path.ends_with("flight-1.mcap"));
    assert_eq!(std::fs::read(&earlier[0]).unwrap(), of_earlier);
    let report = replay(&new[0], |toml| {
        let config = Config::from_toml(toml, &new[0]);
        config.and_then(|config| config.pilot_settings()).map(Pilot::new)
    })
    .unwrap();
    assert!(report.identical, "{:?}", report.first_difference);
    assert!(!report.is_complete);
    assert!(report.events > LEAST_EVENTS, "{} events", report.events);
}

/// A small file system of its own, mounted at `disk` beside its `image`; unmounted in the end.
struct Mounted {
    folder: tempfile::TempDir,
}

impl Mounted {
    /// `None` where this user or this machine cannot mount one.
    fn new() -> Option<Self> {
        let mounted = Self { folder: tempfile::tempdir().unwrap() };
        // Room for one survey and little more: less, and none is begun.
        let made = "truncate -s 320M image && mkfs.ext4 -q -m 0 image && mkdir disk \
                    && mount -o loop,errors=remount-ro image disk";
        if mounted.shell(made) {
            return Some(mounted);
        }
        println!("no file system of its own can be mounted here");
        None
    }

    fn disk(&self) -> PathBuf {
        self.folder.path().join("disk")
    }

    fn shell(&self, script: &str) -> bool {
        let mut shell = Command::new("sh");
        shell.args(["-c", script]).current_dir(self.folder.path()).stderr(Stdio::null());
        shell.status().unwrap().success()
    }
}

impl Drop for Mounted {
    fn drop(&mut self) {
        self.shell("! mountpoint -q disk || umount disk");
    }
}

#[test]
fn a_disk_that_fills_ends_the_log_and_not_the_flight() {
    let Some(mounted) = Mounted::new() else { return fly_with_a_limited_file() };
    let disk = mounted.disk();
    let earlier = leave_earlier(&disk);
    let fills = || assert!(!mounted.shell("cat /dev/zero > disk/somebody-elses-file"));
    Flown::watch(&flight_into(&disk), fills).assert_undisturbed();
    assert_logs(&disk, &earlier);
}

fn fly_with_a_limited_file() {
    let folder = tempfile::tempdir().unwrap();
    let earlier = leave_earlier(folder.path());
    // A process that ignores the signal gets an error instead, as from a full disk.
    let flight = flight_into(folder.path());
    let limited = format!("trap '' XFSZ; ulimit -f {LARGEST_FILE_BLOCKS}; {flight}");
    Flown::watch(&limited, || ()).assert_undisturbed();
    assert_logs(folder.path(), &earlier);
}

#[test]
fn a_disk_that_turns_read_only_ends_the_log_and_not_the_flight() {
    let Some(mounted) = Mounted::new() else { return };
    let disk = mounted.disk();
    let earlier = leave_earlier(&disk);
    // What the kernel does when it finds the file system broken.
    let breaks = "device=$(findmnt -no SOURCE disk) \
                  && echo 1 > /sys/fs/ext4/${device#/dev/}/trigger_fs_error";
    let flight = flight_into(&disk);
    Flown::watch(&flight, || assert!(mounted.shell(breaks))).assert_undisturbed();
    // After the repair that the next start of the computer makes; it tells by its status that it repaired.
    assert!(
        mounted.shell(
            "umount disk && { e2fsck -fp image; [ $? -le 1 ]; } && mount -o loop image disk"
        )
    );
    assert_logs(&disk, &earlier);
}
