//! MAVLink 2 message signing: who sent a frame, and that it is new.
//!
//! A signed frame ends with the number of its link, a timestamp of 48 bits that counts 10 µs since
//! 2015, and the first 6 bytes of SHA-256(key, frame, link, timestamp). Whoever has the key can
//! sign; nothing is hidden from those who listen.
//!
//! A frame is refused if its signature is wrong, if its timestamp is not later than the last one
//! of its stream (link, system, component), if it begins a stream more than a minute in the past or
//! with a stamp that an earlier run may have heard, or if it is further in the future than the settings
//! allow. A few messages may come unsigned, such as the heartbeat, but only from a component that has
//! not signed yet; until then a heartbeat may also be signed with an old stamp.
//!
//! Source: MAVLink guide, "Message Signing". The hash is the `mavlink` crate's; its own state is
//! not used, for it keeps no timestamp over a restart, takes all unsigned messages or none, and is
//! drawn along by any stamp from the future.

mod key;
mod stamps;

pub use key::{Key, KeyError};
pub use stamps::{LedgerError, WallClock};

use mavlink::dialects::ardupilotmega::HEARTBEAT_DATA;
use mavlink::{MAVLinkMessageRaw, MAVLinkV2MessageRaw, MessageData as _};
use stamps::{Stamps, UNITS_PER_SECOND};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::time::Duration;

/// Bit of the incompatibility flags that says that a signature follows.
const IS_SIGNED: u8 = 1;
/// A stream that is new here may begin so long before the local time.
const NEW_STREAM_WITHIN_S: u64 = 60;
/// Streams that are remembered; each needs the key, so there is no way to fill them from outside.
const MAX_STREAMS: usize = 64;

/// How to sign.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SigningSettings {
    /// The file with the key: 64 hexadecimal digits, readable by its owner only.
    pub key_file: PathBuf,
    /// Where the timestamps that are used up are remembered over a restart.
    pub stamp_file: PathBuf,
    /// Number of this link among those of the same sender.
    pub link_id: u8,
    /// Stamps further ahead of this computer's clock are refused.
    pub max_ahead: Duration,
    /// Ids of the messages that may come unsigned.
    pub accept_unsigned: BTreeSet<u32>,
}

/// Why signing cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum SigningError {
    /// The key.
    #[error(transparent)]
    Key(#[from] KeyError),
    /// The timestamps of earlier runs.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
}

/// Why a frame was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Refusal {
    /// It is not signed, and should be.
    Unsigned,
    /// It was signed with another key, or changed on the way.
    WrongSignature,
    /// Its stamp is not later than the last one of its stream: sent again by somebody.
    Replayed,
    /// It begins a stream in the past, or in the time of an earlier run.
    Old,
    /// Its stamp lies too far in the future.
    FromFuture,
}

/// What a frame that may be listened to has shown of its sender.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Proof {
    /// Nothing: the message may come from anybody.
    NotNeeded,
    /// That somebody with the key once sent this heartbeat. It makes the acquaintance and no more: who
    /// has no clock of its own gets ours with the first frame that it hears.
    SignedBefore,
    /// That it has the key.
    Signed,
}

/// Signs what leaves and judges what comes in.
#[derive(Debug)]
pub struct Signing {
    key: Key,
    link_id: u8,
    stamps: Stamps,
    max_ahead: u64,
    accept_unsigned: BTreeSet<u32>,
    /// The last stamp of each link, system and component.
    streams: BTreeMap<(u8, u32, u8), u64>,
}

impl Signing {
    /// Reads the key and the timestamps of earlier runs.
    ///
    /// # Errors
    /// A key that is missing, malformed or readable by others; a stamp file that cannot be read
    /// or written.
    pub fn open(settings: &SigningSettings, wall: WallClock) -> Result<Self, SigningError> {
        Ok(Self {
            key: Key::read(&settings.key_file)?,
            link_id: settings.link_id,
            stamps: Stamps::open(&settings.stamp_file, wall)?,
            max_ahead: settings.max_ahead.as_secs().saturating_mul(UNITS_PER_SECOND),
            accept_unsigned: settings.accept_unsigned.clone(),
            streams: BTreeMap::new(),
        })
    }

    /// Signs a frame that was serialised for signing.
    pub fn sign(&mut self, frame: &mut MAVLinkV2MessageRaw) {
        let stamp = self.stamps.next();
        *frame.signature_link_id_mut() = self.link_id;
        frame.signature_timestamp_bytes_mut().copy_from_slice(&stamp.to_le_bytes()[..6]);
        let signature = self.signature(frame);
        frame.signature_value_mut().copy_from_slice(&signature);
    }

    /// Judges a frame with a right checksum.
    ///
    /// # Errors
    /// Why it must not be listened to.
    pub fn judge(&mut self, frame: &MAVLinkMessageRaw) -> Result<Proof, Refusal> {
        let verdict = match frame {
            MAVLinkMessageRaw::V2(v2) if v2.incompatibility_flags() & IS_SIGNED != 0 => {
                self.judge_signed(v2)
            }
            _ => Err(Refusal::Unsigned),
        };
        let is_unproven = !self.has_signed(frame.system_id(), frame.component_id());
        let may_be_unsigned = is_unproven && self.accept_unsigned.contains(&frame.message_id());
        let is_heartbeat = frame.message_id() == HEARTBEAT_DATA::ID;
        match verdict {
            Ok(()) => Ok(Proof::Signed),
            Err(Refusal::Old) if is_unproven && is_heartbeat => Ok(Proof::SignedBefore),
            Err(_) if may_be_unsigned => Ok(Proof::NotNeeded),
            Err(refusal) => Err(refusal),
        }
    }

    fn judge_signed(&mut self, frame: &MAVLinkV2MessageRaw) -> Result<(), Refusal> {
        if !are_equal(&self.signature(frame), frame.signature_value()) {
            return Err(Refusal::WrongSignature);
        }
        let stamp = frame.signature_timestamp();
        if stamp > self.stamps.own().saturating_add(self.max_ahead) {
            return Err(Refusal::FromFuture);
        }
        let stream = (frame.signature_link_id(), frame.system_id(), frame.component_id());
        match self.streams.get(&stream) {
            Some(last) if stamp <= *last => return Err(Refusal::Replayed),
            Some(_) => {}
            None => {
                let oldest =
                    self.stamps.latest().saturating_sub(NEW_STREAM_WITHIN_S * UNITS_PER_SECOND);
                // The streams of earlier runs are forgotten, so none of their stamps may count again. Who
                // hears this side catches up at once: the protocol sets its clock by ours.
                let is_of_earlier_run = stamp <= self.stamps.first();
                if stamp < oldest || is_of_earlier_run || self.streams.len() >= MAX_STREAMS {
                    return Err(Refusal::Old);
                }
            }
        }
        self.streams.insert(stream, stamp);
        self.stamps.heard(stamp);
        Ok(())
    }

    /// True once a component has proved that it has the key: from then on it must.
    fn has_signed(&self, system: u32, component: u8) -> bool {
        self.streams.keys().any(|(_, s, c)| (*s, *c) == (system, component))
    }

    fn signature(&self, frame: &MAVLinkV2MessageRaw) -> [u8; 6] {
        let mut signature = [0; 6];
        frame.calculate_signature(self.key.bytes(), &mut signature);
        signature
    }
}

/// Takes the same time wherever the difference lies.
fn are_equal(a: &[u8; 6], b: &[u8]) -> bool {
    b.len() == a.len() && a.iter().zip(b).fold(0, |rest, (a, b)| rest | (a ^ b)) == 0
}

#[cfg(test)]
mod tests;
