//! Bytes of the wire, damaged and whole, through reader, guard, decoder, session and brain.
//!
//! The input is a list of pieces: a kind, a length, bytes. Half of the kinds are raw bytes; the
//! others become frames with a right checksum, for no fuzzer guesses one.

#![no_main]

use libfuzzer_sys::fuzz_target;
use std::time::Duration;
use stockpilot::pilot::Event;
use stockpilot_fuzz::{Map, Scene, frame_at};

/// Messages that the session looks at, and some that it must not.
const IDS: [u32; 22] = [
    0, 1, 11, 20, 21, 22, 23, 30, 31, 32, 75, 76, 77, 84, 105, 109, 111, 147, 245, 253, 256, 331,
];
const SENDERS: [(u8, u8); 6] = [(1, 1), (255, 190), (1, 191), (2, 1), (0, 0), (1, 51)];

fuzz_target!(|input: &[u8]| {
    let mut scene = Scene::new(Map::Grid);
    let mut rest = input;
    while let [kind, length, tail @ ..] = rest {
        let (piece, tail) = tail.split_at(usize::from(*length).min(tail.len()));
        rest = tail;
        match kind % 8 {
            0..=2 => scene.hear(piece),
            3..=5 => {
                if let [id, from, payload @ ..] = piece {
                    let id = IDS[usize::from(*id) % IDS.len()];
                    let from = SENDERS[usize::from(*from) % SENDERS.len()];
                    scene.hear_frame(from, id, payload);
                }
            }
            6 => {
                let by = Duration::from_millis(u64::from(*length) * 4);
                scene.tick(by);
            }
            _ => {
                let now = scene.now();
                scene.tell(Event::TagsSeen(frame_at(0.2 + f64::from(*length) * 0.01, now)));
            }
        }
    }
    scene.tick(Duration::from_millis(17));
});
