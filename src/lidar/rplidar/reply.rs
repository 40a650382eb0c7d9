//! Replies of the sensor: descriptors and single payloads, found in whatever comes.

/// A descriptor: `A5 5A`, length and kind, type.
const DESCRIPTOR_BYTES: usize = 7;
/// No single reply is longer.
const LONGEST_SINGLE: usize = 68;
/// Bits of the length in the descriptor; those above tell the kind of reply.
const LENGTH_BITS: u32 = 30;

/// Type bytes of single replies.
const INFO: u8 = 0x04;
const HEALTH: u8 = 0x06;
const SAMPLE_RATE: u8 = 0x15;
const CONF: u8 = 0x20;
const BOARD_FLAG: u8 = 0xFF;

/// What the sensor says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceInfo {
    /// Series in the high nibble: 1 A1, 2 A2, 3 A3, 4 C1, 6 S1, 7 S2, 8 S3.
    pub model: u8,
    /// Firmware, major and minor.
    pub firmware: (u8, u8),
    /// Hardware revision.
    pub hardware: u8,
    /// Serial number.
    pub serial: [u8; 16],
}

/// How the sensor feels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HealthStatus {
    /// Nothing to complain of.
    Good,
    /// It works, but not well.
    Warning,
    /// It does not scan before a reset.
    Error,
}

/// Status and the sensor's own error number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Health {
    /// How bad it is.
    pub status: HealthStatus,
    /// The maker's number.
    pub error_code: u16,
}

/// One reply.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Reply {
    /// Who it is.
    Info(DeviceInfo),
    /// How it feels.
    Health(Health),
    /// Sample periods of standard and express scans, µs.
    SampleRate {
        /// Standard.
        standard_us: u16,
        /// Express.
        express_us: u16,
    },
    /// An item of the configuration.
    Conf {
        /// Which.
        item: u32,
        /// Its value.
        value: Vec<u8>,
    },
    /// Whether the adapter controls the motor by a duty.
    BoardFlag {
        /// It does.
        controls_motor: bool,
    },
    /// A setting of one byte, as YDLIDAR sensors tell theirs.
    Setting(u8),
    /// A scan begins: payloads of this type follow, without further descriptors.
    Scan {
        /// The type byte.
        answer: u8,
    },
}

/// Finds replies in bytes that arrive in chunks of any size; old samples between them are skipped.
#[derive(Debug, Clone, Default)]
pub struct ReplyReader {
    pending: Vec<u8>,
}

impl ReplyReader {
    /// Takes in bytes.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.pending.extend_from_slice(bytes);
    }

    /// The next reply, if one is complete.
    pub fn next_reply(&mut self) -> Option<Reply> {
        let mut at = 0;
        let reply = loop {
            match judge(&self.pending[at..]) {
                Judged::Wait => break None,
                Judged::Skip => at += 1,
                Judged::Reply(reply, n_bytes) => {
                    at += n_bytes;
                    break Some(reply);
                }
            }
        };
        self.pending.drain(..at);
        reply
    }

    /// Forgets what came so far and gives it back.
    pub fn take_rest(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.pending)
    }
}

enum Judged {
    Wait,
    Skip,
    Reply(Reply, usize),
}

fn judge(bytes: &[u8]) -> Judged {
    let n_head = bytes.len().min(2);
    if bytes[..n_head] != [0xA5, 0x5A][..n_head] {
        return Judged::Skip;
    }
    let Some(descriptor) = bytes.first_chunk::<DESCRIPTOR_BYTES>() else { return Judged::Wait };
    let [_, _, b0, b1, b2, b3, answer] = *descriptor;
    let word = u32::from_le_bytes([b0, b1, b2, b3]);
    let n_payload = (word & ((1 << LENGTH_BITS) - 1)) as usize;
    let is_loop = word >> LENGTH_BITS == 1;
    if is_loop {
        let is_known = (0x81..=0x86).contains(&answer);
        let scan = Reply::Scan { answer };
        return if is_known { Judged::Reply(scan, DESCRIPTOR_BYTES) } else { Judged::Skip };
    }
    if n_payload > LONGEST_SINGLE {
        return Judged::Skip;
    }
    let Some(payload) = bytes.get(DESCRIPTOR_BYTES..DESCRIPTOR_BYTES + n_payload) else {
        return Judged::Wait;
    };
    single(answer, payload)
        .map_or(Judged::Skip, |reply| Judged::Reply(reply, DESCRIPTOR_BYTES + n_payload))
}

/// A single reply with a payload of the right length.
fn single(answer: u8, payload: &[u8]) -> Option<Reply> {
    Some(match (answer, payload) {
        (INFO, [model, minor, major, hardware, serial @ ..]) => Reply::Info(DeviceInfo {
            model: *model,
            firmware: (*major, *minor),
            hardware: *hardware,
            serial: serial.try_into().ok()?,
        }),
        (INFO, [value]) => Reply::Setting(*value),
        (HEALTH, [status, low, high]) => Reply::Health(Health {
            status: match status {
                0 => HealthStatus::Good,
                1 => HealthStatus::Warning,
                2 => HealthStatus::Error,
                _ => return None,
            },
            error_code: u16::from_le_bytes([*low, *high]),
        }),
        (SAMPLE_RATE, [s0, s1, e0, e1]) => Reply::SampleRate {
            standard_us: u16::from_le_bytes([*s0, *s1]),
            express_us: u16::from_le_bytes([*e0, *e1]),
        },
        (CONF, [i0, i1, i2, i3, value @ ..]) => {
            Reply::Conf { item: u32::from_le_bytes([*i0, *i1, *i2, *i3]), value: value.to_vec() }
        }
        (BOARD_FLAG, [flags, _, _, _]) => Reply::BoardFlag { controls_motor: flags & 1 == 1 },
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn replies(bytes: &[u8], chunk: usize) -> Vec<Reply> {
        let mut reader = ReplyReader::default();
        let mut replies = Vec::new();
        for chunk in bytes.chunks(chunk) {
            reader.feed(chunk);
            replies.extend(std::iter::from_fn(|| reader.next_reply()));
        }
        replies
    }

    #[test]
    fn replies_are_found_among_old_samples_however_they_are_cut() {
        // An A1M8 (18, firmware 1.29, hardware 7), then a good health, after stale bytes with a
        // lone A5 and half a descriptor.
        let mut bytes = vec![0x3E, 0xA5, 0x01, 0xA5, 0x5A, 0xFF];
        bytes.extend([0xA5, 0x5A, 0x14, 0, 0, 0, 0x04, 0x18, 0x1D, 0x01, 0x07]);
        bytes.extend([0xAB; 16]);
        bytes.extend([0xA5, 0x5A, 0x03, 0, 0, 0, 0x06, 0, 0, 0]);
        let info = DeviceInfo { model: 0x18, firmware: (1, 29), hardware: 7, serial: [0xAB; 16] };
        let health = Health { status: HealthStatus::Good, error_code: 0 };
        for chunk in [1, 3, 100] {
            assert_eq!(replies(&bytes, chunk), [Reply::Info(info), Reply::Health(health)]);
        }
    }

    #[test]
    fn a_scan_descriptor_tells_its_type_and_hands_back_what_follows() {
        let mut reader = ReplyReader::default();
        reader.feed(&[0xA5, 0x5A, 0x54, 0, 0, 0x40, 0x85, 0xA1, 0x52]);
        assert_eq!(reader.next_reply(), Some(Reply::Scan { answer: 0x85 }));
        assert_eq!(reader.take_rest(), [0xA1, 0x52]);
    }
}
