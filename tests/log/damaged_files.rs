//! Logs that a kill, a full disk or a bad card left behind.

use crate::support::{events_of, imu_event, write_log};
use std::time::Duration;
use stockpilot::pilot::Event;
use stockpilot::record::{LogHeader, Recorder};
use stockpilot::time::Stamp;

/// Of a cut file every byte of this stride is tried; prime, so that all alignments come up.
const STRIDE: usize = 499;

fn log_of(n_events: u32) -> (Vec<Event>, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let events: Vec<Event> = (0..n_events).map(imu_event).collect();
    let steps: Vec<_> = events.iter().map(|event| (event.clone(), vec![])).collect();
    write_log(&path, &steps);
    (events, std::fs::read(&path).unwrap())
}

#[test]
fn a_log_cut_anywhere_gives_a_prefix_and_says_so() {
    let (events, bytes) = log_of(3000);
    assert_eq!(events_of(&bytes), (events.clone(), true));
    let mut longest = 0;
    for n_bytes in (0..bytes.len()).step_by(STRIDE) {
        let (read, is_complete) = events_of(&bytes[..n_bytes]);
        assert!(!is_complete, "cut at {n_bytes}");
        assert_eq!(read, events[..read.len()], "cut at {n_bytes}");
        assert!(read.len() >= longest);
        longest = read.len();
    }
    assert_eq!(longest, events.len());
}

#[test]
fn a_flipped_byte_gives_a_prefix_and_never_a_wrong_event() {
    let (events, bytes) = log_of(2000);
    let mut n_noticed = 0;
    for at in (0..bytes.len()).step_by(STRIDE * 3) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x41;
        let (read, is_complete) = events_of(&damaged);
        assert_eq!(read, events[..read.len()], "flipped at {at}");
        n_noticed += u32::from(!is_complete);
    }
    assert!(n_noticed > 0);
}

#[test]
fn a_killed_program_leaves_what_it_flushed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let mut recorder = Recorder::create(&path, &LogHeader::default()).unwrap();
    for n in 0..100 {
        recorder.event(Stamp::ZERO, &imu_event(n));
    }
    // The file as another process sees it, while the recorder still holds it open: wait for the
    // flush that comes by itself.
    let (_keep, never) = std::sync::mpsc::channel::<()>();
    let n_readable = |_| {
        let waited = never.recv_timeout(Duration::from_millis(100));
        assert!(waited.is_err());
        events_of(&std::fs::read(&path).unwrap()).0.len()
    };
    let n_waits = (0..100).map(n_readable).position(|n_events| n_events == 100);
    assert!(n_waits.is_some());
    drop(recorder);
}

#[test]
fn nonsense_is_no_log() {
    for nonsense in [&b""[..], b"hello", &[0; 4096], b"\x89MCAP0\r\n\xFF\xFF\xFF\xFF\xFF"] {
        assert_eq!(events_of(nonsense), (vec![], false));
    }
}
