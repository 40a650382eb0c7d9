//! Finds nodes and capsules in a running scan.

use super::capsule::{TURN_Q6, advance_q8, has_good_checksum, has_sync};
use super::node::Node;
use super::{dense, hq, legacy, standard, ultra};
use crate::lidar::scanner::{Look, Scanner};
use crate::time::{Mono, Stamp};

/// The longest capsule.
const LONGEST: usize = dense::ULTRA_BYTES;
/// A step from start to start that is longer than usual by more than this is a loss: healthy streams
/// stay within 1.02, and one lost capsule makes 2.
const LOSS_HALVES: i32 = 3;
/// The usual step follows the newest one up to this ratio of them, in fifths: what lies beyond is no
/// loss, but no speed that a head reaches from one capsule to the next either.
const LEARNING_FIFTHS: i32 = 6;
/// So many capsules with too long a step in a row are no losses but a new speed.
const LOSSES_IN_A_ROW: u32 = 4;

/// A format of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// Nodes of five bytes.
    Standard,
    /// Legacy express capsules.
    Legacy,
    /// HQ packets.
    Hq,
    /// Ultra capsules.
    Ultra,
    /// Dense capsules.
    Dense,
    /// Ultra-dense capsules.
    UltraDense,
}

impl Answer {
    /// The format of a type byte.
    #[must_use]
    pub const fn from_byte(byte: u8) -> Option<Self> {
        Some(match byte {
            0x81 => Self::Standard,
            0x82 => Self::Legacy,
            0x83 => Self::Hq,
            0x84 => Self::Ultra,
            0x85 => Self::Dense,
            0x86 => Self::UltraDense,
            _ => return None,
        })
    }

    /// Bytes of one node, capsule or packet.
    #[must_use]
    pub const fn frame_bytes(self) -> usize {
        match self {
            Self::Standard => standard::BYTES,
            Self::Legacy => legacy::BYTES,
            Self::Hq => hq::BYTES,
            Self::Ultra => ultra::BYTES,
            Self::Dense => dense::BYTES,
            Self::UltraDense => dense::ULTRA_BYTES,
        }
    }

    /// Samples of one node, capsule or packet.
    #[must_use]
    pub const fn frame_samples(self) -> usize {
        match self {
            Self::Standard => 1,
            Self::Legacy => legacy::SAMPLES,
            Self::Hq => hq::SAMPLES,
            Self::Ultra => ultra::SAMPLES,
            Self::Dense => dense::SAMPLES,
            Self::UltraDense => dense::ULTRA_SAMPLES,
        }
    }

    /// Where a capsule's start angle stands.
    const fn start_at(self) -> usize {
        if matches!(self, Self::UltraDense) { 8 } else { 2 }
    }
}

/// Nodes that came together, and when.
#[derive(Debug, Clone, Copy)]
pub struct Arrived<'a> {
    /// The samples.
    pub nodes: &'a [Node],
    /// When the chunk was read that ended their frame.
    pub at: Stamp<Mono>,
    /// Bytes of the frame, and of what followed it in that chunk.
    pub n_bytes: usize,
    /// Angle where the head began the frame, °.
    pub start_deg: f64,
    /// Bytes of the stream before the frame.
    pub at_byte: u64,
}

/// Bytes that are left to judge.
#[derive(Debug, Clone, Copy)]
struct Rest<'a> {
    bytes: &'a [u8],
    /// Bytes of the stream before them.
    at_byte: u64,
    /// When their chunk was read.
    now: Stamp<Mono>,
}

/// A capsule that waits for the next one, which tells how far the head went.
#[derive(Debug, Clone)]
struct Pending {
    bytes: [u8; LONGEST],
    start_q6: u16,
    at: Stamp<Mono>,
    n_bytes: usize,
    at_byte: u64,
}

/// Finds the frames of one format in bytes that arrive in chunks of any size.
///
/// Frames with a broken checksum are dropped, and the capsule before them too, because its angles
/// need the next start. So is a capsule whose successor begins much further on than usual: those
/// between are lost, and its angles would be stretched over the gap.
#[derive(Debug, Clone)]
pub struct StreamParser {
    answer: Answer,
    scanner: Scanner,
    state: State,
}

#[derive(Debug, Clone, Default)]
struct State {
    pending: Option<Box<Pending>>,
    step_q8: Option<i32>,
    losses_in_a_row: u32,
    last_node: Option<Node>,
    nodes: Vec<Node>,
    frames: u64,
    refused: u64,
    skipped_bytes: u64,
}

impl StreamParser {
    /// A parser that has seen nothing.
    #[must_use]
    pub fn new(answer: Answer) -> Self {
        Self { answer, scanner: Scanner::default(), state: State::default() }
    }

    /// The format.
    #[must_use]
    pub const fn answer(&self) -> Answer {
        self.answer
    }

    /// Frames that were decoded.
    #[must_use]
    pub const fn frames(&self) -> u64 {
        self.state.frames
    }

    /// Frames that were refused: broken checksums, impossible angles, gaps behind them.
    #[must_use]
    pub const fn refused(&self) -> u64 {
        self.state.refused
    }

    /// Bytes that belong to no frame.
    #[must_use]
    pub const fn skipped_bytes(&self) -> u64 {
        self.state.skipped_bytes
    }

    /// Takes in a chunk read at `now` and hands on the samples that it completes.
    pub fn feed(&mut self, bytes: &[u8], now: Stamp<Mono>, mut on_nodes: impl FnMut(Arrived<'_>)) {
        let Self { answer, scanner, state } = self;
        match answer {
            Answer::Standard => {
                state.nodes.clear();
                let (mut n_behind, mut first_at) = (0, None);
                scanner.feed(bytes, |rest, at_byte| {
                    let look = state.look_standard(rest, &mut n_behind);
                    if matches!(look, Look::Take(_)) {
                        first_at.get_or_insert(at_byte);
                    }
                    look
                });
                if let [first, ..] = state.nodes[..] {
                    let nodes = &state.nodes[..];
                    let n_bytes = n_behind + standard::BYTES;
                    let (start_deg, at_byte) = (degrees(&first), first_at.unwrap_or(0));
                    on_nodes(Arrived { nodes, at: now, n_bytes, start_deg, at_byte });
                }
            }
            Answer::Hq => scanner.feed(bytes, |rest, at_byte| {
                state.look_hq(Rest { bytes: rest, at_byte, now }, &mut on_nodes)
            }),
            _ => scanner.feed(bytes, |rest, at_byte| {
                state.look_capsule(*answer, Rest { bytes: rest, at_byte, now }, &mut on_nodes)
            }),
        }
    }
}

impl State {
    /// Standard nodes come one by one; `n_behind` is what followed the last of them.
    fn look_standard(&mut self, rest: &[u8], n_behind: &mut usize) -> Look {
        if self.last_node.is_none() {
            if rest.len() < standard::CHAIN * standard::BYTES {
                return Look::Wait;
            }
            if !standard::is_chain(rest) {
                self.skipped_bytes += 1;
                return Look::Skip(1);
            }
        }
        let Some(bytes) = rest.first_chunk::<{ standard::BYTES }>() else { return Look::Wait };
        let node = standard::decode(bytes).filter(|node| {
            self.last_node.is_none_or(|previous| standard::can_follow(&previous, node))
        });
        self.last_node = node;
        let Some(node) = node else {
            self.refused += 1;
            self.skipped_bytes += 1;
            return Look::Skip(1);
        };
        self.nodes.push(node);
        self.frames += 1;
        *n_behind = rest.len() - standard::BYTES;
        Look::Take(standard::BYTES)
    }

    fn look_hq(
        &mut self,
        Rest { bytes: rest, at_byte, now }: Rest<'_>,
        on_nodes: &mut impl FnMut(Arrived<'_>),
    ) -> Look {
        if rest[0] != hq::HEAD {
            self.skipped_bytes += 1;
            return Look::Skip(1);
        }
        let Some(packet) = rest.get(..hq::BYTES) else { return Look::Wait };
        if !hq::has_good_checksum(packet) {
            return self.refuse();
        }
        self.nodes.clear();
        hq::decode(packet, &mut self.nodes);
        if self.nodes.iter().any(|node| node.angle_q16 >= 360 << 16) {
            return self.refuse();
        }
        self.frames += 1;
        let start_deg = degrees(&self.nodes[0]);
        let n_bytes = rest.len();
        on_nodes(Arrived { nodes: &self.nodes, at: now, n_bytes, start_deg, at_byte });
        Look::Take(hq::BYTES)
    }

    fn look_capsule(
        &mut self,
        answer: Answer,
        Rest { bytes: rest, at_byte, now }: Rest<'_>,
        on_nodes: &mut impl FnMut(Arrived<'_>),
    ) -> Look {
        if !has_sync(rest) {
            // Something is missing or damaged here, so the next start is not the one that counts.
            self.pending = None;
            self.skipped_bytes += 1;
            return Look::Skip(1);
        }
        let n_bytes = answer.frame_bytes();
        let Some(capsule) = rest.get(..n_bytes) else { return Look::Wait };
        let at = answer.start_at();
        let start = u16::from_le_bytes([capsule[at], capsule[at + 1]]);
        let (start_q6, is_first) = (start & 0x7FFF, start & 0x8000 != 0);
        if !has_good_checksum(capsule) || start_q6 >= TURN_Q6 {
            self.pending = None;
            return self.refuse();
        }
        let mut slot = self.pending.take().filter(|_| !is_first);
        if let Some(pending) = &slot
            && self.is_step_usual(advance_q8(pending.start_q6, start_q6))
        {
            self.nodes.clear();
            decode(answer, pending, capsule, start_q6, &mut self.nodes);
            self.frames += 1;
            on_nodes(Arrived {
                nodes: &self.nodes,
                at: pending.at,
                n_bytes: pending.n_bytes,
                start_deg: f64::from(pending.start_q6) / 64.0,
                at_byte: pending.at_byte,
            });
        }
        let pending = slot.get_or_insert_with(|| {
            let bytes = [0; LONGEST];
            Box::new(Pending { bytes, start_q6, at: now, n_bytes: 0, at_byte })
        });
        pending.bytes[..n_bytes].copy_from_slice(capsule);
        (pending.start_q6, pending.at, pending.n_bytes) = (start_q6, now, rest.len());
        pending.at_byte = at_byte;
        self.pending = slot;
        Look::Take(n_bytes)
    }

    fn refuse(&mut self) -> Look {
        self.refused += 1;
        self.skipped_bytes += 1;
        Look::Skip(1)
    }

    /// False if capsules are missing between two starts.
    fn is_step_usual(&mut self, step_q8: i32) -> bool {
        let usual_q8 = self.step_q8.unwrap_or(step_q8);
        let is_usual = 2 * step_q8 <= LOSS_HALVES * usual_q8 || step_q8 < 1 << 8;
        let is_new_speed = !is_usual && self.losses_in_a_row >= LOSSES_IN_A_ROW;
        if is_usual || is_new_speed {
            let is_steady = 5 * step_q8 <= LEARNING_FIFTHS * usual_q8 || step_q8 < 1 << 8;
            if is_steady || is_new_speed {
                self.step_q8 = Some(step_q8);
            }
            self.losses_in_a_row = 0;
            return true;
        }
        self.losses_in_a_row += 1;
        self.refused += 1;
        false
    }
}

fn decode(answer: Answer, pending: &Pending, next: &[u8], next_q6: u16, nodes: &mut Vec<Node>) {
    let (bytes, start_q6) = (&pending.bytes[..], pending.start_q6);
    match answer {
        Answer::Legacy => legacy::decode(bytes, start_q6, next_q6, nodes),
        Answer::Ultra => ultra::decode(bytes, start_q6, next, next_q6, nodes),
        Answer::Dense => dense::decode(bytes, start_q6, next_q6, nodes),
        Answer::UltraDense => dense::decode_ultra(bytes, start_q6, next_q6, nodes),
        // These two are decoded where they are found.
        Answer::Standard | Answer::Hq => {}
    }
}

fn degrees(node: &Node) -> f64 {
    f64::from(node.angle_q16) / 65_536.0
}
