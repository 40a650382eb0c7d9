//! Finds packets in a stream of bytes.

use super::packet::{HEAD_BYTES, Head};
use super::{Geometry, SampleFormat};
use crate::lidar::Sample;
use crate::lidar::scanner::{Look, Scanner};

/// Some models send a time, ms, between the packets: its third byte is the XOR of the others.
const STAMP_HEAD: [u8; 2] = [0xAA, 0x66];
const STAMP_BYTES: usize = 8;

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
    /// Bytes of the stream before the packet, without those of packets with a time.
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
    /// Bytes of packets with a time.
    stamp_bytes: u64,
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
            stamp_bytes: 0,
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
        if rest.starts_with(&STAMP_HEAD) {
            let Some(packet) = rest.first_chunk::<STAMP_BYTES>() else { return Look::Wait };
            if packet.iter().fold(0, |sum, byte| sum ^ byte) == 0 {
                self.stamp_bytes += STAMP_BYTES as u64;
                return Look::Take(STAMP_BYTES);
            }
        }
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
                // Packets with a time between those with samples are no damage.
                let at_byte = at_byte - self.stamp_bytes;
                on_packet(Arrived { samples, start_deg, n_bytes, own_bytes, at_byte });
                return Look::Take(own_bytes);
            }
        }
        self.refused += 1;
        self.skipped_bytes += 1;
        Look::Skip(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A packet of two samples at 10° and 20°: words XOR by hand, `AA55 ^ 0000^0200^0501^0A01^…`.
    fn packet() -> Vec<u8> {
        let words: [u16; 5] = [0x55AA, 0x0200, (640 << 1) | 1, (1280 << 1) | 1, 0x1000 ^ 0x2000];
        let sum = words.iter().fold(0, |sum, word| sum ^ word);
        let body = [0x55AA, 0x0200, words[2], words[3], sum, 0x1000, 0x2000];
        body.iter().flat_map(|word: &u16| word.to_le_bytes()).collect()
    }

    #[test]
    fn packets_with_a_time_are_no_damage() {
        let mut time = [0xAA, 0x66, 0, 0x11, 0x22, 0x33, 0x44, 0x00];
        time[2] = time.iter().fold(0, |sum, byte| sum ^ byte);
        let stream = [packet(), time.to_vec(), packet(), time.to_vec(), packet()].concat();
        for chunk_bytes in [1, 7, stream.len()] {
            let mut parser = PacketParser::new(Geometry::TimeOfFlight, SampleFormat::Distance);
            let mut places = Vec::new();
            for chunk in stream.chunks(chunk_bytes) {
                parser.feed(chunk, |arrived| places.push(arrived.at_byte));
            }
            let n_bytes = packet().len() as u64;
            assert_eq!(places, [0, n_bytes, 2 * n_bytes]);
            assert_eq!(parser.skipped_bytes(), 0);
        }
        // One with a wrong sum is damage like any other.
        time[2] ^= 1;
        let mut parser = PacketParser::new(Geometry::TimeOfFlight, SampleFormat::Distance);
        parser.feed(&time, |_| {});
        parser.feed(&packet(), |_| {});
        assert_eq!((parser.frames(), parser.skipped_bytes()), (1, 8));
    }
}
