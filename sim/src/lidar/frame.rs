//! The bytes of LDROBOT sensors.
//!
//! ```text
//! 54 2C  speed u16 °/s  start u16 0.01°  12 × (range u16 mm, intensity u8)
//!        end u16 0.01°  clock u16 ms  CRC-8                      little-endian, 47 bytes
//! ```

use super::Packet;

/// Bytes of one frame.
pub const FRAME_LEN: usize = 47;
/// Generator x⁸ + x⁶ + x³ + x² + 1; initial value 0, most significant bit first.
const CRC_POLYNOMIAL: u8 = 0x4d;

/// The bytes of a packet.
#[must_use]
pub fn encode(packet: &Packet) -> [u8; FRAME_LEN] {
    let mut bytes = Vec::with_capacity(FRAME_LEN);
    bytes.extend([0x54, 0x2c]);
    bytes.extend(packet.speed_dps.to_le_bytes());
    bytes.extend(packet.start_cdeg.to_le_bytes());
    for sample in &packet.samples {
        bytes.extend(sample.range_mm.to_le_bytes());
        bytes.push(sample.intensity);
    }
    bytes.extend(packet.end_cdeg.to_le_bytes());
    bytes.extend(packet.clock_ms.to_le_bytes());
    let mut frame = [0; FRAME_LEN];
    frame[..FRAME_LEN - 1].copy_from_slice(&bytes);
    frame[FRAME_LEN - 1] = crc8(&bytes);
    frame
}

/// The check byte, bit by bit: slow, and plainly the definition.
pub(super) fn crc8(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc, _| {
            if crc & 0x80 == 0 { crc << 1 } else { (crc << 1) ^ CRC_POLYNOMIAL }
        })
    })
}
