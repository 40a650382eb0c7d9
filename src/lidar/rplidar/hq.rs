//! HQ packets: 781 bytes, 96 whole samples, the only format with a CRC.
//!
//! ```text
//! A5, time u64, 96 × (angle u16 90°/2¹⁴, distance u32 ¼ mm, quality u8, flag u8), CRC-32
//! ```
//! The CRC is that of zlib over the first 777 bytes and three zeros.

use super::node::Node;

/// Bytes of a packet.
pub(super) const BYTES: usize = 781;
/// Samples of a packet.
pub(super) const SAMPLES: usize = 96;
/// The first byte.
pub(super) const HEAD: u8 = 0xA5;
const DATA: usize = 9;
const GUARDED: usize = 777;

/// True if the CRC is right.
pub(super) fn has_good_checksum(packet: &[u8]) -> bool {
    let told = [packet[777], packet[778], packet[779], packet[780]];
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&packet[..GUARDED]);
    hasher.update(&[0; 3]);
    hasher.finalize() == u32::from_le_bytes(told)
}

/// The samples of a packet, appended to `nodes`.
pub(super) fn decode(packet: &[u8], nodes: &mut Vec<Node>) {
    let (samples, _) = packet[DATA..GUARDED].as_chunks::<8>();
    nodes.extend(samples.iter().map(|s| {
        let angle_z_q14 = i32::from(u16::from_le_bytes([s[0], s[1]]));
        Node {
            // 90°/2¹⁴ are 360 · 2⁻¹⁶ °.
            angle_q16: angle_z_q14 * 360,
            dist_q2: u32::from_le_bytes([s[2], s[3], s[4], s[5]]),
            quality: s[6],
            starts_turn: s[7] & 1 == 1,
        }
    }));
}
