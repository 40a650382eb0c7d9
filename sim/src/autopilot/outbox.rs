//! Messages that leave the autopilot, one queue per link.

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{MavMessage, MavSeverity, STATUSTEXT_DATA};
use mavlink::types::CharArray;

/// Characters in one STATUSTEXT.
const CHUNK: usize = 50;

/// A link of the autopilot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Link {
    /// To the companion computer.
    Companion,
    /// To the ground station.
    Ground,
}

/// The queues.
#[derive(Debug, Clone, Default)]
pub(super) struct Outbox {
    companion: Vec<(MavHeader, MavMessage)>,
    ground: Vec<(MavHeader, MavMessage)>,
    companion_sequence: u8,
    ground_sequence: u8,
    text_id: u16,
}

impl Outbox {
    /// Sends a message of the autopilot's own.
    pub(super) fn send(&mut self, link: Link, message: MavMessage) {
        let sequence = match link {
            Link::Companion => &mut self.companion_sequence,
            Link::Ground => &mut self.ground_sequence,
        };
        let header = MavHeader { system_id: 1, component_id: 1, sequence: *sequence };
        *sequence = sequence.wrapping_add(1);
        self.pass_on(link, header, message);
    }

    /// Passes on a message of somebody else.
    pub(super) fn pass_on(&mut self, link: Link, header: MavHeader, message: MavMessage) {
        match link {
            Link::Companion => self.companion.push((header, message)),
            Link::Ground => self.ground.push((header, message)),
        }
    }

    /// A line for people: to the ground station only, with PX4's trailing tab, in chunks of 50.
    pub(super) fn text(&mut self, severity: MavSeverity, text: &str) {
        self.chunked(&[Link::Ground], severity, &format!("{text}\t"));
    }

    /// A line for people on every link, as `ArduPilot` sends it.
    pub(super) fn text_to_all(&mut self, severity: MavSeverity, text: &str) {
        self.chunked(&[Link::Companion, Link::Ground], severity, text);
    }

    fn chunked(&mut self, links: &[Link], severity: MavSeverity, line: &str) {
        let is_long = line.len() > CHUNK;
        if is_long {
            self.text_id = self.text_id.wrapping_add(1).max(1);
        }
        let id = if is_long { self.text_id } else { 0 };
        let chunks: Vec<&[u8]> = line.as_bytes().chunks(CHUNK).collect();
        for (chunk_seq, chunk) in (0..=u8::MAX).zip(chunks) {
            let mut bytes = [0; CHUNK];
            bytes[..chunk.len()].copy_from_slice(chunk);
            let text = CharArray::new(bytes);
            let data = STATUSTEXT_DATA { severity, text, id, chunk_seq };
            for link in links {
                self.send(*link, MavMessage::STATUSTEXT(data.clone()));
            }
        }
    }

    pub(super) fn take(&mut self, link: Link) -> Vec<(MavHeader, MavMessage)> {
        std::mem::take(match link {
            Link::Companion => &mut self.companion,
            Link::Ground => &mut self.ground,
        })
    }

    pub(super) fn clear(&mut self) {
        self.companion.clear();
        self.ground.clear();
    }
}
