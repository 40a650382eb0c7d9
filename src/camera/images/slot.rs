//! A place for one picture between two threads.

use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// Holds the newest thing put in until it is taken.
#[derive(Debug)]
pub(super) struct Slot<T> {
    held: Mutex<Option<T>>,
    changed: Condvar,
}

impl<T> Default for Slot<T> {
    fn default() -> Self {
        Self { held: Mutex::new(None), changed: Condvar::new() }
    }
}

impl<T> Slot<T> {
    /// Puts something in and gives back what it replaces.
    pub(super) fn replace(&self, thing: T) -> Option<T> {
        let before = self.held.lock().unwrap_or_else(PoisonError::into_inner).replace(thing);
        self.changed.notify_all();
        before
    }

    /// Waits until it is empty, no longer than this; true if it is.
    pub(super) fn is_free_within(&self, patience: Duration) -> bool {
        let held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.changed.wait_timeout_while(held, patience, |held| held.is_some());
        waited.unwrap_or_else(PoisonError::into_inner).0.is_none()
    }

    /// Takes what is in it, and waits no longer than this for it.
    pub(super) fn take_within(&self, patience: Duration) -> Option<T> {
        let held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.changed.wait_timeout_while(held, patience, |held| held.is_none());
        let thing = waited.unwrap_or_else(PoisonError::into_inner).0.take();
        self.changed.notify_all();
        thing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_wins() {
        let slot = Slot::default();
        assert_eq!(slot.replace(1), None);
        assert_eq!(slot.replace(2), Some(1));
        assert!(!slot.is_free_within(Duration::ZERO));
        assert_eq!(slot.take_within(Duration::ZERO), Some(2));
        assert!(slot.is_free_within(Duration::ZERO));
        assert_eq!(slot.take_within(Duration::ZERO), None);
    }
}
