//! Lines of every awkward length, as frames for readers that others wrote.

use crate::support::{at_ms, px4_heartbeat};
use mavlink::MavlinkReader;
use mavlink::dialects::ardupilotmega::MavMessage;
use std::path::Path;
use stockpilot::link::{Session, SessionOutput, Settings, wire};
use stockpilot::messages::{Severity, StatusText};
use stockpilot::pilot::Action;

/// Bytes of the lines: around one, two and three pieces of 50.
const LENGTHS: [usize; 10] = [1, 49, 50, 51, 99, 100, 101, 149, 150, 200];

/// A line of this length that tells it, and where each of its letters stands.
fn line(length: usize) -> String {
    let letters = ('a'..='z').cycle();
    let head = format!("{length}:");
    head.chars().chain(letters).take(length).collect()
}

#[test]
fn lines_of_every_awkward_length_are_written_for_other_readers() {
    let mut session = Session::new(Settings::new("udpin:127.0.0.1:0".parse().unwrap()));
    let mut out = SessionOutput::default();
    let heartbeat = px4_heartbeat();
    let mut reader = MavlinkReader::new(heartbeat.as_slice());
    let (header, message) = reader.read_any_message::<MavMessage>().unwrap();
    session.on_message(&header, &message, at_ms(0), &mut out);
    let mut log = Vec::new();
    let mut lines = String::new();
    let mut n_frames = 0;
    for length in LENGTHS {
        let text = line(length);
        lines.push_str(&text);
        lines.push('\n');
        let say = Action::Say(StatusText { severity: Severity::Notice, text });
        session.on_action(&say, at_ms(0), &mut out);
        for message in out.messages.drain(..) {
            // The log of ground stations: microseconds, most significant byte first, then the frame.
            log.extend_from_slice(&(1_000_000_u64 + n_frames).to_be_bytes());
            let header = mavlink::MavHeader {
                sequence: u8::try_from(n_frames).unwrap(),
                ..session.header()
            };
            log.extend_from_slice(&wire::encode(header, &message));
            n_frames += 1;
        }
    }
    // A piece for each begun 50 bytes, and one more where the last is full.
    assert_eq!(n_frames, LENGTHS.iter().map(|n| (*n as u64) / 50 + 1).sum::<u64>());
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    std::fs::write(folder.join("texts.tlog"), log).unwrap();
    std::fs::write(folder.join("texts.txt"), lines).unwrap();
}
