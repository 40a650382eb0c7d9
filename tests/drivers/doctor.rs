//! The doctor as a program: what it prints, and where.

use crate::support::stream;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::OwnedFd;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};

/// What the doctor prints of a port on which an LD19 talks until the doctor has ended.
fn examined(arguments: &[&str], log_level: Option<&str>) -> Output {
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
    let sensor = openpt(flags).unwrap();
    grantpt(&sensor).unwrap();
    unlockpt(&sensor).unwrap();
    let port = ptsname(&sensor, Vec::new()).unwrap().into_string().unwrap();
    rustix::io::ioctl_fionbio(&sensor, true).unwrap();
    let mut doctor = Command::new(env!("CARGO_BIN_EXE_stockpilot"));
    doctor.args(["doctor", "--seconds", "1", "--port", &port]).args(arguments);
    match log_level {
        Some(level) => doctor.env("RUST_LOG", level),
        None => doctor.env_remove("RUST_LOG"),
    };
    let has_ended = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| talk(&sensor, &has_ended));
        let output = doctor.output();
        has_ended.store(true, Ordering::Relaxed);
        output.unwrap()
    })
}

/// Writes frames whenever the line takes some; one that nobody has opened takes none.
fn talk(sensor: &OwnedFd, is_over: &AtomicBool) {
    let bytes = stream(300);
    let patience = Timespec { tv_sec: 0, tv_nsec: 20_000_000 };
    while !is_over.load(Ordering::Relaxed) {
        let n_taken = rustix::io::write(sensor, &bytes).unwrap_or(0);
        if n_taken < bytes.len() {
            poll(&mut [PollFd::new(sensor, PollFlags::OUT)], Some(&patience)).unwrap();
        }
    }
}

#[test]
fn the_table_stands_alone_and_the_log_comes_on_demand_beside_it() {
    let output = examined(&[], None);
    let (table, log) = (String::from_utf8(output.stdout).unwrap(), output.stderr);
    assert!(table.lines().any(|line| line.starts_with("good  lidar ")), "{table}");
    assert!(log.is_empty(), "{}", String::from_utf8_lossy(&log));

    let output = examined(&[], Some("info"));
    let log = String::from_utf8(output.stderr).unwrap();
    assert!(log.contains("lidar streams"), "{log}");
    assert!(!String::from_utf8(output.stdout).unwrap().contains("lidar streams"));
}

#[test]
fn json_is_all_there_is_on_the_standard_output() {
    for log_level in [None, Some("debug")] {
        let output = examined(&["--json"], log_level);
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let checks = report["checks"].as_array().unwrap();
        let lidar = checks.iter().find(|check| check["subject"] == "lidar").unwrap();
        assert_eq!(lidar["verdict"], "good", "{report}");
    }
}
