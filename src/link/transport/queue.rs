//! The way from the brain to the transport: an outbox with a bell.

use super::{Counters, count};
use crate::link::outbox::{Outbox, Outgoing, Placed};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;

#[derive(Debug, Default)]
struct Shared {
    outbox: Mutex<Outbox>,
    bell: Notify,
    is_closed: AtomicBool,
}

impl Shared {
    fn outbox(&self) -> MutexGuard<'_, Outbox> {
        // Nothing panics while it is held, and an outbox is right after each call.
        self.outbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_closed(&self) -> bool {
        self.is_closed.load(Ordering::Acquire)
    }
}

/// Where messages are handed in.
#[derive(Debug)]
pub struct OutgoingSender {
    shared: Arc<Shared>,
    counters: Arc<Counters>,
}

/// There was no room for a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the link's outbox is full")]
pub struct OutboxFull;

impl OutgoingSender {
    /// Hands a message in; never waits. A setpoint, an ODOMETRY and a heartbeat replace an older one
    /// that has not left.
    ///
    /// # Errors
    /// If there is no room.
    pub fn send(&self, outgoing: Outgoing) -> Result<(), OutboxFull> {
        let placed = self.shared.outbox().put(outgoing);
        self.shared.bell.notify_one();
        match placed {
            Placed::Waits => Ok(()),
            Placed::Replaces => {
                count(&self.counters.superseded);
                Ok(())
            }
            Placed::Lost => Err(OutboxFull),
        }
    }
}

impl Drop for OutgoingSender {
    fn drop(&mut self) {
        self.shared.is_closed.store(true, Ordering::Release);
        self.shared.bell.notify_one();
    }
}

/// Where the transport takes messages out.
#[derive(Debug)]
pub(super) struct OutgoingReceiver(Arc<Shared>);

impl OutgoingReceiver {
    /// The most urgent message, as soon as there is one; `None` once nobody sends any more. Loses
    /// nothing if it is cancelled.
    pub(super) async fn recv(&mut self) -> Option<Outgoing> {
        loop {
            if let Some(outgoing) = self.0.outbox().take() {
                return Some(outgoing);
            }
            if self.0.is_closed() {
                return None;
            }
            // One bell for any number of messages: each round looks into the box first.
            self.0.bell.notified().await;
        }
    }

    /// Throws away what waits, and says how much that was.
    pub(super) fn clear(&mut self) -> usize {
        self.0.outbox().clear()
    }
}

/// Both ends of a queue.
pub(super) fn queue(counters: &Arc<Counters>) -> (OutgoingSender, OutgoingReceiver) {
    let shared = Arc::new(Shared::default());
    let sender = OutgoingSender { shared: Arc::clone(&shared), counters: Arc::clone(counters) };
    (sender, OutgoingReceiver(shared))
}
