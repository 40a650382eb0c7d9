//! The parser against damage and arbitrary chunks.

use crate::support::{frame, stream};
use proptest::collection::vec;
use proptest::prelude::{any, prop_assert_eq, proptest};
use proptest::sample::Index;
use stockpilot::lidar::ldrobot::{FRAME_BYTES, Frame, Parser};

const N_FRAMES: u32 = 20;

fn parsed<'a>(chunks: impl Iterator<Item = &'a [u8]>) -> Vec<Frame> {
    let mut parser = Parser::new();
    let mut frames = Vec::new();
    chunks.for_each(|chunk| parser.feed(chunk, |frame, _| frames.push(frame)));
    frames
}

fn parsed_whole(bytes: &[u8]) -> Vec<Frame> {
    parsed(std::iter::once(bytes))
}

fn all_but(lost_idx: Option<usize>) -> Vec<Frame> {
    let kept = |i: &u32| lost_idx != Some(usize::try_from(*i).unwrap());
    (0..N_FRAMES).filter(kept).map(frame).collect()
}

proptest! {
    #[test]
    fn cuts_change_nothing(cuts in vec(any::<Index>(), 0..60)) {
        let bytes = stream(N_FRAMES);
        let mut places: Vec<usize> = cuts.iter().map(|cut| cut.index(bytes.len())).collect();
        places.extend([0, bytes.len()]);
        places.sort_unstable();
        let chunks = places.windows(2).map(|pair| &bytes[pair[0]..pair[1]]);
        prop_assert_eq!(parsed(chunks), all_but(None));
    }

    #[test]
    fn a_flipped_byte_costs_its_own_frame_only(place: Index, flip in 1..=255_u8) {
        let mut bytes = stream(N_FRAMES);
        let at = place.index(bytes.len());
        bytes[at] ^= flip;
        prop_assert_eq!(parsed_whole(&bytes), all_but(Some(at / FRAME_BYTES)));
    }

    #[test]
    fn a_lost_byte_costs_its_own_frame_only(place: Index) {
        let mut bytes = stream(N_FRAMES);
        let at = place.index(bytes.len());
        bytes.remove(at);
        prop_assert_eq!(parsed_whole(&bytes), all_but(Some(at / FRAME_BYTES)));
    }

    #[test]
    fn garbage_between_frames_costs_nothing(
        garbage in vec(any::<u8>(), 0..200),
        frame_idx in 0..N_FRAMES as usize,
    ) {
        let mut bytes = stream(N_FRAMES);
        let at = frame_idx * FRAME_BYTES;
        bytes.splice(at..at, garbage);
        prop_assert_eq!(parsed_whole(&bytes), all_but(None));
    }

    #[test]
    fn no_bytes_make_it_stop_and_all_are_accounted_for(bytes in vec(any::<u8>(), 0..2000)) {
        let mut parser = Parser::new();
        let mut n_frames = 0;
        parser.feed(&bytes, |_, _| n_frames += 1);
        parser.reset();
        let stats = parser.stats();
        prop_assert_eq!(stats.frames, n_frames);
        prop_assert_eq!(stats.skipped_bytes + n_frames * FRAME_BYTES as u64, bytes.len() as u64);
    }
}

#[test]
fn frame_heads_inside_garbage_do_not_hide_the_next_frame() {
    // Every two bytes look like a frame's beginning; the true one is found all the same.
    let mut bytes = [0x54, 0x2C].repeat(30);
    bytes.extend(stream(2));
    assert_eq!(parsed_whole(&bytes), [frame(0), frame(1)]);
}

#[test]
fn the_bytes_behind_each_frame_are_told() {
    let bytes = stream(3);
    let mut parser = Parser::new();
    let mut behind = Vec::new();
    parser.feed(&bytes[..100], |_, n_bytes_after| behind.push(n_bytes_after));
    assert_eq!(behind, [53, 6]);
    assert!(parser.stats().skipped_bytes == 0);
}
