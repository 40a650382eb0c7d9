//! Frames with right heads and sums around any payload, so that whatever lies behind the checksums is
//! tried; also by the fuzz target `lidar_bytes`.

/// What a sensor sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// RPLIDAR: twelve nodes.
    Standard,
    /// RPLIDAR: 84 bytes.
    Legacy,
    /// RPLIDAR: 781 bytes.
    Hq,
    /// RPLIDAR: 132 bytes.
    Ultra,
    /// RPLIDAR: 84 bytes.
    Dense,
    /// RPLIDAR: 170 bytes.
    UltraDense,
    /// YDLIDAR: samples of two bytes.
    Distance,
    /// YDLIDAR: samples of three bytes.
    IntensityAndDistance,
    /// LDROBOT: 47 bytes.
    Ldrobot,
    /// Hokuyo: a reply to MD with [`SCIP_STEPS`] distances.
    Scip,
}

/// Distances of a Hokuyo reply.
pub(crate) const SCIP_STEPS: usize = 682;
/// A full turn, 1/64°.
const TURN_Q6: u16 = 23_040;

impl Kind {
    /// All of them.
    pub(crate) const ALL: [Self; 10] = [
        Self::Standard,
        Self::Legacy,
        Self::Hq,
        Self::Ultra,
        Self::Dense,
        Self::UltraDense,
        Self::Distance,
        Self::IntensityAndDistance,
        Self::Ldrobot,
        Self::Scip,
    ];

    /// The type byte of an RPLIDAR's answer.
    #[must_use]
    pub(crate) const fn answer(self) -> Option<u8> {
        Some(match self {
            Self::Standard => 0x81,
            Self::Legacy => 0x82,
            Self::Hq => 0x83,
            Self::Ultra => 0x84,
            Self::Dense => 0x85,
            Self::UltraDense => 0x86,
            _ => return None,
        })
    }

    /// A frame around this payload, whatever it is. What the payload lacks is zero; its first three bytes
    /// say where the head stands: anywhere, or a little further on than at `angle_q6`, which moves along.
    #[must_use]
    pub(crate) fn frame(self, payload: &[u8], angle_q6: &mut u16) -> Vec<u8> {
        let mut rest = payload.iter().copied().skip(3).chain(std::iter::repeat(0));
        let mut take = |n: usize| rest.by_ref().take(n).collect::<Vec<u8>>();
        let [how, low, high] = [0, 1, 2].map(|i| payload.get(i).copied().unwrap_or(0));
        *angle_q6 = match how % 4 {
            0 => u16::from_le_bytes([low, high]) % TURN_Q6,
            _ => (*angle_q6 + u16::from(low) * 4) % TURN_Q6,
        };
        let start = *angle_q6 | if how == 4 { 0x8000 } else { 0 };
        match self {
            Self::Standard => standard(&take(60), *angle_q6),
            Self::Legacy | Self::Dense => capsule(&[], start, &take(80)),
            Self::Ultra => capsule(&[], start, &take(128)),
            Self::UltraDense => capsule(&take(6), start, &take(160)),
            Self::Hq => hq(&take(776)),
            Self::Distance => ydlidar(&take(4), *angle_q6, &take(2 * samples_of(how)), 2),
            Self::IntensityAndDistance => {
                ydlidar(&take(4), *angle_q6, &take(3 * samples_of(how)), 3)
            }
            Self::Ldrobot => ldrobot(&take(44)),
            Self::Scip => scip(&take(4 + 3 * SCIP_STEPS)),
        }
    }

    /// Frame number `k` of a head that turns evenly and sees a wall.
    #[must_use]
    pub(crate) fn regular(self, k: u16) -> Vec<u8> {
        let mut angle_q6 = 0;
        // 600 of 1/64° from frame to frame.
        let [low, high] = (k.wrapping_mul(600) % TURN_Q6).to_le_bytes();
        let head = [0, low, high];
        let samples = match self {
            // Nodes 0.75° apart.
            Self::Standard => [0, 12, 0, 0xE8, 0x03].repeat(12),
            Self::Hq | Self::Ldrobot => vec![1; 800],
            _ => [0xE8, 0x03].repeat(1500),
        };
        self.frame(&[&head[..], &samples].concat(), &mut angle_q6)
    }
}

fn samples_of(byte: u8) -> usize {
    1 + usize::from(byte) % 80
}

/// Twelve nodes with their check bits; angles go on by up to 16°.
fn standard(payload: &[u8], start_q6: u16) -> Vec<u8> {
    let mut angle_q6 = start_q6;
    let node = |five: &[u8]| {
        angle_q6 = (angle_q6 + u16::from(five[1]) * 4) % TURN_Q6;
        let [low, high] = (angle_q6 << 1 | 1).to_le_bytes();
        let check = if five[0] & 1 == 1 { 1 } else { 2 };
        [five[0] & 0xFC | check, low, high, five[3], five[4]]
    };
    payload.chunks_exact(5).flat_map(node).collect()
}

/// Sync nibbles with the XOR of what follows them.
fn capsule(before: &[u8], start: u16, samples: &[u8]) -> Vec<u8> {
    let content = [before, &start.to_le_bytes(), samples].concat();
    let sum = content.iter().fold(0, |xor, byte| xor ^ byte);
    [&[0xA0 | (sum & 0xF), 0x50 | (sum >> 4)], &content[..]].concat()
}

fn hq(payload: &[u8]) -> Vec<u8> {
    let mut bytes = [&[0xA5], payload].concat();
    let padded = [&bytes[..], &[0; 3]].concat();
    let crc = padded.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            if crc & 1 == 0 { crc >> 1 } else { (crc >> 1) ^ 0xEDB8_8320 }
        })
    });
    bytes.extend((!crc).to_le_bytes());
    bytes
}

fn ydlidar(head: &[u8], first_q6: u16, samples: &[u8], sample_bytes: usize) -> Vec<u8> {
    let last_q6 = u16::from_le_bytes([head[2], head[3]]) % TURN_Q6;
    let n = u8::try_from(samples.len() / sample_bytes).unwrap_or(u8::MAX);
    let (first, last) = (first_q6 << 1 | 1, last_q6 << 1 | 1);
    let words = samples.chunks_exact(sample_bytes).fold(0, |xor, s| match *s {
        [intensity, low, high] => xor ^ u16::from(intensity) ^ u16::from_le_bytes([low, high]),
        [low, high] => xor ^ u16::from_le_bytes([low, high]),
        _ => xor,
    });
    let sum = 0x55AA ^ first ^ last ^ u16::from_le_bytes([head[1], n]) ^ words;
    let mut bytes = vec![0xAA, 0x55, head[1], n];
    [first, last, sum].iter().for_each(|word| bytes.extend(word.to_le_bytes()));
    bytes.extend(samples);
    bytes
}

/// Angles and clock are kept to their ranges.
fn ldrobot(payload: &[u8]) -> Vec<u8> {
    let word = |at: usize, most: u16| {
        (u16::from_le_bytes([payload[at], payload[at + 1]]) % (most + 1)).to_le_bytes()
    };
    let mut bytes = vec![0x54, 0x2C, payload[0], payload[1]];
    bytes.extend(word(2, 36_000));
    bytes.extend(&payload[4..40]);
    bytes.extend(word(40, 36_000));
    bytes.extend(word(42, 30_000));
    let crc = bytes.iter().fold(0_u8, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc, _| if crc & 0x80 == 0 { crc << 1 } else { crc << 1 ^ 0x4D })
    });
    bytes.push(crc);
    bytes
}

/// Every six bits become a character.
fn scip(payload: &[u8]) -> Vec<u8> {
    let characters: Vec<u8> = payload.iter().map(|byte| 0x30 + (byte & 0x3F)).collect();
    let (time, distances) = characters.split_at(4);
    let mut bytes = b"MD0044072501000\n99b\n".to_vec();
    for line in std::iter::once(time).chain(distances.chunks(64)) {
        let sum = line.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        bytes.extend(line);
        bytes.extend([0x30 + (sum & 0x3F), b'\n']);
    }
    bytes.push(b'\n');
    bytes
}
