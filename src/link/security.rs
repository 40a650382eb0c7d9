//! Who may speak on the link, and how much.
//!
//! Every frame passes here before it is decoded, and every frame that leaves is made here:
//!
//! ```text
//! datagram ─▶ address allowed? ─▶ key set-up? ─▶ signature, stamp ─▶ too many? ─▶ decode
//! ```
//!
//! `SETUP_SIGNING` carries a key in the clear. It is dropped unread: never decoded, never logged,
//! never passed on.

mod flood;
mod network;

pub use network::{Network, NetworkError};

use super::signing::{Proof, Refusal, Signing, SigningError, SigningSettings, WallClock};
use crate::time::{Mono, Stamp};
use flood::FloodLimit;
use mavlink::dialects::ardupilotmega::{MavMessage, SETUP_SIGNING_DATA};
use mavlink::{MAVLinkMessageRaw, MAVLinkV2MessageRaw, MavHeader, MessageData as _};
use std::net::IpAddr;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What is asked of those who speak.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct SecuritySettings {
    /// Addresses whose datagrams are taken; all of them if empty.
    pub peers: Vec<Network>,
    /// Signing; `None` for unsigned frames both ways.
    pub signing: Option<SigningSettings>,
}

/// Frames that were refused, by the reason; they only grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GuardStats {
    /// Datagrams from addresses that are not on the list.
    pub refused_addresses: u64,
    /// Messages that would set up a signing key.
    pub key_setups: u64,
    /// Unsigned frames.
    pub unsigned: u64,
    /// Frames with another key's signature, or changed on the way.
    pub wrong_signatures: u64,
    /// Frames that came a second time, or begin a stream in the past.
    pub replayed: u64,
    /// Frames with a stamp too far in the future.
    pub from_future: u64,
    /// Frames beyond what one sender may send in a second.
    pub flooded: u64,
}

impl GuardStats {
    /// All of them.
    #[must_use]
    pub const fn refused(&self) -> u64 {
        self.refused_addresses
            + self.key_setups
            + self.unsigned
            + self.wrong_signatures
            + self.replayed
            + self.from_future
            + self.flooded
    }
}

/// The gate of one link.
#[derive(Debug)]
pub struct Guard {
    peers: Vec<Network>,
    signs: bool,
    inner: Mutex<Inner>,
}

#[derive(Debug)]
struct Inner {
    signing: Option<Signing>,
    flood: FloodLimit,
    stats: GuardStats,
}

impl Guard {
    /// The gate that `settings` ask for.
    ///
    /// # Errors
    /// If signing is asked for and its key or its timestamps cannot be had.
    pub fn open(settings: &SecuritySettings, wall: WallClock) -> Result<Self, SigningError> {
        let signing = settings.signing.as_ref().map(|s| Signing::open(s, wall)).transpose()?;
        Ok(Self::new(settings.peers.clone(), signing))
    }

    /// A gate for unsigned frames from anywhere; floods and key set-ups still end here.
    #[must_use]
    pub fn unsigned() -> Self {
        Self::new(Vec::new(), None)
    }

    fn new(peers: Vec<Network>, signing: Option<Signing>) -> Self {
        let signs = signing.is_some();
        let inner = Inner { signing, flood: FloodLimit::default(), stats: GuardStats::default() };
        Self { peers, signs, inner: Mutex::new(inner) }
    }

    /// The counters.
    #[must_use]
    pub fn stats(&self) -> GuardStats {
        self.lock().stats
    }

    /// True if datagrams from `address` may be looked at.
    #[must_use]
    pub fn admits_address(&self, address: IpAddr) -> bool {
        let is_known =
            self.peers.is_empty() || self.peers.iter().any(|network| network.contains(address));
        if !is_known {
            self.lock().stats.refused_addresses += 1;
        }
        is_known
    }

    /// True if frames of this link are signed.
    #[must_use]
    pub const fn signs(&self) -> bool {
        self.signs
    }

    /// True if a frame with a right checksum may be decoded.
    #[must_use]
    pub fn admits(&self, frame: &MAVLinkMessageRaw, arrived: Stamp<Mono>) -> bool {
        self.proof(frame, arrived).is_some()
    }

    /// What a frame with a right checksum shows of its sender; `None` if it may not be decoded.
    #[must_use]
    pub fn proof(&self, frame: &MAVLinkMessageRaw, arrived: Stamp<Mono>) -> Option<Proof> {
        let mut inner = self.lock();
        let Inner { signing, flood, stats } = &mut *inner;
        if frame.message_id() == SETUP_SIGNING_DATA::ID {
            stats.key_setups += 1;
            return None;
        }
        // Before the flood limit: forged frames must not use up what the true sender may send.
        let verdict = signing.as_mut().map_or(Ok(Proof::NotNeeded), |signing| signing.judge(frame));
        let proof = verdict.inspect_err(|refusal| *refused(stats, *refusal) += 1).ok()?;
        let is_taken = flood.takes(frame.system_id(), frame.component_id(), arrived);
        stats.flooded += u64::from(!is_taken);
        is_taken.then_some(proof)
    }

    /// The MAVLink 2 frame of a message, signed if this link signs.
    #[must_use]
    pub fn frame(&self, header: MavHeader, message: &MavMessage) -> Vec<u8> {
        match &mut self.lock().signing {
            Some(signing) => {
                let mut frame = MAVLinkV2MessageRaw::new();
                frame.serialize_message_for_signing(header, message);
                signing.sign(&mut frame);
                frame.raw_bytes().to_vec()
            }
            None => super::wire::encode(header, message),
        }
    }

    /// Nothing below leaves a half-done state behind, so a poisoned lock is as good as new.
    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

const fn refused(stats: &mut GuardStats, refusal: Refusal) -> &mut u64 {
    match refusal {
        Refusal::Unsigned => &mut stats.unsigned,
        Refusal::WrongSignature => &mut stats.wrong_signatures,
        Refusal::Replayed | Refusal::Old => &mut stats.replayed,
        Refusal::FromFuture => &mut stats.from_future,
    }
}

#[cfg(test)]
mod tests;
