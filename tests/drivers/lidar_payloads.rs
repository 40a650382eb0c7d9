//! Any payload behind right checksums, between damage and garbage.

use crate::lidar_endurance::{Piece, converse, parse};
use crate::lidar_frames::Kind;
use proptest::collection::vec;
use proptest::prelude::{Just, ProptestConfig, Strategy, any, prop_oneof, proptest};
use proptest::sample::select;

fn payload() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        vec(any::<u8>(), 0..260),
        // The extremes of every field.
        (any::<u8>(), select(vec![0_u8, 0xFF, 0x80, 0x7F]))
            .prop_map(|(how, fill)| { [vec![how, fill, fill], vec![fill; 2100]].concat() }),
    ]
}

fn pieces() -> impl Strategy<Value = Vec<Piece>> {
    let piece = prop_oneof![
        4 => payload().prop_map(Piece::Frame),
        1 => (payload(), any::<usize>()).prop_map(|(payload, at)| Piece::Damaged(payload, at)),
        1 => vec(any::<u8>(), 0..100).prop_map(Piece::Garbage),
        // Heads without frames.
        1 => Just(Piece::Garbage([0xA5, 0x5A, 0xAA, 0x55, 80, 80, 0x54, 0x2C].repeat(4))),
    ];
    vec(piece, 0..25)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn no_payload_makes_a_parser_stop(
        kind in select(&Kind::ALL[..]),
        pieces in pieces(),
        chunk_bytes in 1..400_usize,
    ) {
        parse(kind, &pieces, chunk_bytes);
    }

    #[test]
    fn no_payload_makes_a_conversation_stop(
        kind in select(&Kind::ALL[..]),
        pieces in pieces(),
        chunk_bytes in 1..400_usize,
    ) {
        converse(kind, &pieces, chunk_bytes);
    }
}

#[test]
fn regular_frames_of_every_kind_are_read() {
    for kind in Kind::ALL {
        parse(kind, &[], 1);
        converse(kind, &[], 1);
    }
}
