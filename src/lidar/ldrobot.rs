//! The one-way protocol of LDROBOT sensors (LD06, LD19, STL-27L): 47-byte frames, little-endian.
//!
//! | offset | size | field |
//! | --- | --- | --- |
//! | 0 | 2 | `54 2C` |
//! | 2 | 2 | head speed, °/s |
//! | 4 | 2 | angle of the first sample, 0.01°, clockwise seen from above |
//! | 6 | 36 | 12 × (distance u16 mm, intensity u8) |
//! | 42 | 2 | angle of the last sample, 0.01° |
//! | 44 | 2 | device time, ms, wraps at 30,000 |
//! | 46 | 1 | CRC-8 over the bytes before |
//!
//! Source: LDROBOT development manual of the LD19, section 3; `ldlidar_stl_sdk` 3.0.3, `lipkg.h`.

mod frame;
mod gap;
mod parser;
mod sensor;

pub use frame::{Frame, Sample};
pub use parser::{Parser, ParserStats};
pub use sensor::Ldrobot;

/// Bytes in a frame.
pub const FRAME_BYTES: usize = 47;
/// Samples in a frame.
pub const FRAME_SAMPLES: usize = 12;
/// The first two bytes of every frame; both are legal data bytes too.
pub const FRAME_HEAD: [u8; 2] = [0x54, 0x2C];
/// The device's clock wraps at this value, ms.
pub const CLOCK_WRAP_MS: u16 = 30_000;
/// A full turn in the frame's unit of angle, 0.01°.
pub const TURN_CDEG: u16 = 36_000;

const CRC_TABLE: [u8; 256] = crc_table();

/// Remainders of all single bytes for x⁸ + x⁶ + x³ + x² + 1 (0x4D), most significant bit first.
const fn crc_table() -> [u8; 256] {
    let mut table = [0; 256];
    let mut index = 0_u8;
    loop {
        let mut rest = index;
        let mut bit = 0;
        while bit < 8 {
            rest = if rest & 0x80 == 0 { rest << 1 } else { (rest << 1) ^ 0x4D };
            bit += 1;
        }
        table[index as usize] = rest;
        if index == u8::MAX {
            return table;
        }
        index += 1;
    }
}

/// CRC-8 with polynomial 0x4D, initial value 0, no reflection, no final XOR.
#[must_use]
pub fn crc8(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |rest, byte| CRC_TABLE[usize::from(rest ^ byte)])
}
