//! RPLIDAR capsules of a real sensor against the decoding that was published with them.

use crate::support::capture;
use stockpilot::lidar::rplidar::{Answer, Node, StreamParser};
use stockpilot::time::Stamp;

/// Start flag, quality, angle in 90°/2¹⁴, distance in ¼ mm.
type Told = [u32; 4];

fn decoded(answer: Answer, bytes: &[u8], chunk_bytes: usize) -> Vec<Vec<Node>> {
    let mut parser = StreamParser::new(answer);
    let mut capsules = Vec::new();
    for chunk in bytes.chunks(chunk_bytes) {
        parser.feed(chunk, Stamp::ZERO, |arrived| capsules.push(arrived.nodes.to_vec()));
    }
    assert_eq!(parser.refused(), 0);
    capsules
}

fn told(node: &Node) -> Told {
    // Bit 0 says that a turn begins, bit 1 that it does not.
    let flag = if node.starts_turn { 1 } else { 2 };
    [flag, u32::from(node.quality), node.angle_z_q14(), node.dist_q2]
}

fn check(answer: Answer, capsules: &str, expected: &str, n_nodes: usize) {
    let (Some(bytes), Some(expected)) = (capture(capsules), capture(expected)) else { return };
    let expected: Vec<Vec<Told>> = serde_json::from_slice(&expected).unwrap();
    assert_eq!(expected.iter().map(Vec::len).sum::<usize>(), n_nodes);
    for chunk_bytes in [bytes.len(), 1, 3, 7] {
        let nodes = decoded(answer, &bytes, chunk_bytes);
        let nodes: Vec<Vec<Told>> = nodes.iter().map(|c| c.iter().map(told).collect()).collect();
        assert_eq!(nodes, expected, "in chunks of {chunk_bytes}");
    }
}

#[test]
fn legacy_capsules_equal_the_published_nodes() {
    check(
        Answer::Legacy,
        "rplidar/pyrplidar_legacy_capsules_5x84.bin",
        "rplidar/pyrplidar_legacy_expected_nodes.json",
        4 * 32,
    );
}

#[test]
fn ultra_capsules_equal_the_published_nodes() {
    check(
        Answer::Ultra,
        "rplidar/pyrplidar_ultra_capsules_5x132.bin",
        "rplidar/pyrplidar_ultra_expected_nodes.json",
        4 * 96,
    );
}
