//! Finds packets in a stream of bytes.

use super::packet::{HEAD_BYTES, Head};
use super::{Geometry, SampleFormat};
use crate::lidar::Sample;
use crate::lidar::scanner::{Look, Scanner};

/// The samples of a packet.
#[derive(Debug, Clone, Copy)]
pub struct Arrived<'a> {
    /// The samples.
    pub samples: &'a [Sample],
    /// Angle of the head at the first of them, °.
    pub start_deg: f64,
    /// Bytes of the packet, and of what followed it in the chunk.
    pub n_bytes: usize,
    /// Bytes of the packet alone.
    pub own_bytes: usize,
    /// Bytes of the stream before the packet.
    pub at_byte: u64,
}

/// Finds packets in bytes that arrive in chunks of any size.
///
/// Whether samples carry an intensity is not told by the packet. The checksum tells: what fits is
/// kept until it fits no more.
#[derive(Debug, Clone)]
pub struct PacketParser {
    geometry: Geometry,
    format: SampleFormat,
    scanner: Scanner,
    samples: Vec<Sample>,
    frames: u64,
    refused: u64,
    skipped_bytes: u64,
}

impl PacketParser {
    /// A parser for this geometry that expects this format first.
    #[must_use]
    pub fn new(geometry: Geometry, format: SampleFormat) -> Self {
        Self {
            geometry,
            format,
            scanner: Scanner::default(),
            samples: Vec::new(),
            frames: 0,
            refused: 0,
            skipped_bytes: 0,
        }
    }

    /// The format that was met last.
    #[must_use]
    pub const fn format(&self) -> SampleFormat {
        self.format
    }

    /// Packets delivered.
    #[must_use]
    pub const fn frames(&self) -> u64 {
        self.frames
    }

    /// Packets refused for their checksum.
    #[must_use]
    pub const fn refused(&self) -> u64 {
        self.refused
    }

    /// Bytes that belong to no packet.
    #[must_use]
    pub const fn skipped_bytes(&self) -> u64 {
        self.skipped_bytes
    }

    /// Forgets the unfinished packet; the counts stay.
    pub fn reset(&mut self) {
        self.skipped_bytes += self.scanner.clear() as u64;
    }

    /// Takes in bytes and hands on each good packet.
    pub fn feed(&mut self, bytes: &[u8], mut on_packet: impl FnMut(Arrived<'_>)) {
        let mut scanner = std::mem::take(&mut self.scanner);
        scanner.feed(bytes, |rest, at_byte| self.look(rest, at_byte, &mut on_packet));
        self.scanner = scanner;
    }

    fn look(&mut self, rest: &[u8], at_byte: u64, on_packet: &mut impl FnMut(Arrived<'_>)) -> Look {
        if rest[0] != 0xAA || rest.get(1).is_some_and(|byte| *byte != 0x55) {
            self.skipped_bytes += 1;
            return Look::Skip(1);
        }
        let Some(bytes) = rest.first_chunk::<HEAD_BYTES>() else { return Look::Wait };
        let Some(head) = Head::from_bytes(bytes) else {
            self.skipped_bytes += 1;
            return Look::Skip(1);
        };
        for format in [self.format, self.format.other()] {
            let n_bytes = head.packet_bytes(format);
            let Some(packet) = rest.get(..n_bytes) else { return Look::Wait };
            if head.has_good_checksum(&packet[HEAD_BYTES..], format) {
                self.format = format;
                self.frames += 1;
                self.samples.clear();
                head.decode(&packet[HEAD_BYTES..], format, self.geometry, &mut self.samples);
                let (samples, start_deg) = (&self.samples[..], head.start_deg());
                let own_bytes = n_bytes;
                let n_bytes = rest.len();
                on_packet(Arrived { samples, start_deg, n_bytes, own_bytes, at_byte });
                return Look::Take(own_bytes);
            }
        }
        self.refused += 1;
        self.skipped_bytes += 1;
        Look::Skip(1)
    }
}
