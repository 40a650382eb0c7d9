//! Lines of text in pieces of 50 bytes.
//!
//! Ground stations join pieces until one is shorter than 50 bytes. So every piece but the last is
//! filled to exactly 50, and a text that ends on the border gets one more, empty piece.
//! Source: MAVLink `STATUSTEXT`, fields `id` and `chunk_seq`.

use crate::messages::Severity;
use mavlink::dialects::ardupilotmega::{MavMessage, MavSeverity, STATUSTEXT_DATA};

/// Bytes in one piece.
const CHUNK_BYTES: usize = 50;
/// Longer texts are cut; ten pieces are more than any display shows.
const MAX_TEXT_BYTES: usize = 500;

/// Appends the messages that carry `text` to `messages`.
///
/// `id` names the text among those of this component; it is sent only with texts of more than
/// one piece, and must not be 0.
pub(crate) fn push_text(severity: Severity, text: &str, id: u16, messages: &mut Vec<MavMessage>) {
    let chunks = chunks(text);
    let id = if chunks.len() > 1 { id } else { 0 };
    for (chunk_seq, chunk) in (0u8..).zip(&chunks) {
        messages.push(MavMessage::STATUSTEXT(STATUSTEXT_DATA {
            severity: wire_severity(severity),
            text: chunk.as_str().into(),
            id,
            chunk_seq,
        }));
    }
}

/// The pieces of `text`. A character that would straddle a border moves to the next piece, and
/// spaces fill its place: receivers take a short piece for the last one.
fn chunks(text: &str) -> Vec<String> {
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let mut rest = &text[..floor_boundary(&text, MAX_TEXT_BYTES)];
    let mut chunks = Vec::new();
    while rest.len() >= CHUNK_BYTES {
        let (head, tail) = rest.split_at(floor_boundary(rest, CHUNK_BYTES));
        chunks.push(format!("{head:<width$}", width = padded_width(head)));
        rest = tail;
    }
    chunks.push(rest.to_owned());
    chunks
}

/// Characters to which `head` must be padded so that it has [`CHUNK_BYTES`] bytes.
fn padded_width(head: &str) -> usize {
    head.chars().count() + (CHUNK_BYTES - head.len())
}

/// The last character border at or before byte `limit`.
fn floor_boundary(text: &str, limit: usize) -> usize {
    let end = limit.min(text.len());
    (0..=end).rev().find(|&index| text.is_char_boundary(index)).unwrap_or(0)
}

const fn wire_severity(severity: Severity) -> MavSeverity {
    match severity {
        Severity::Critical => MavSeverity::MAV_SEVERITY_CRITICAL,
        Severity::Error => MavSeverity::MAV_SEVERITY_ERROR,
        Severity::Warning => MavSeverity::MAV_SEVERITY_WARNING,
        Severity::Notice => MavSeverity::MAV_SEVERITY_NOTICE,
        Severity::Info => MavSeverity::MAV_SEVERITY_INFO,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A receiver in the manner of QGroundControl: each piece is decoded alone, and the text is
    /// complete at the first piece shorter than 50 bytes. Gives the text and the pieces used.
    fn received(text: &str) -> (String, usize) {
        let mut messages = Vec::new();
        push_text(Severity::Info, text, 7, &mut messages);
        let mut joined = String::new();
        for (count, message) in messages.iter().enumerate() {
            let MavMessage::STATUSTEXT(data) = message else { panic!("{message:?}") };
            assert_eq!(usize::from(data.chunk_seq), count);
            assert_eq!(data.id, if messages.len() > 1 { 7 } else { 0 });
            let piece = data.text.to_str().unwrap();
            joined.push_str(piece);
            if piece.len() < 50 {
                assert_eq!(count + 1, messages.len(), "ended too early: {joined:?}");
                return (joined, count + 1);
            }
        }
        panic!("never complete: {joined:?}");
    }

    #[test]
    fn every_length_arrives_complete() {
        for (length, pieces) in [(0, 1), (1, 1), (49, 1), (50, 2), (51, 2), (99, 2), (100, 3)] {
            let text = "x".repeat(length);
            assert_eq!(received(&text), (text, pieces), "{length} bytes");
        }
    }

    #[test]
    fn characters_on_the_border_stay_whole() {
        // 49 bytes, then a character of two: it moves on and a space fills the border.
        let text = format!("{}µ and more", "x".repeat(49));
        assert_eq!(received(&text).0, format!("{} µ and more", "x".repeat(49)));
        // A border that falls between characters needs no filling: 25 × 2 = 50 bytes.
        let text = "ä".repeat(30);
        assert_eq!(received(&text), (text, 2));
        // 17 × 3 = 51: two bytes are filled, the display shows two spaces.
        assert_eq!(received(&"€".repeat(17)).0, format!("{}  €", "€".repeat(16)));
    }

    #[test]
    fn line_breaks_and_zeros_do_not_end_a_text() {
        assert_eq!(received("a\nb\0c").0, "a b c");
        assert_eq!(received(&"y".repeat(9_000)), ("y".repeat(500), 11));
    }
}
