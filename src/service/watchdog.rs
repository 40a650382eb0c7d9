//! Tells systemd that the brain is alive, from the brain's own ticks.
//!
//! A brain that hangs while the program lives is what a watchdog is for: a task that only says "I am
//! here" would hide it. Without systemd nothing is told.

use crate::time::{Mono, Stamp};
use sd_notify::NotifyState;
use std::time::Duration;

/// Without a limit of systemd's the ticks are looked at this often.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Looks within the time that systemd allows.
const LOOKS_PER_LIMIT: u32 = 4;
/// No faster than this, whatever systemd allows.
const FASTEST: Duration = Duration::from_millis(50);

/// Says that the start is over, then feeds the watchdog while `last_tick`, the brain's, goes on. Never
/// returns.
pub async fn feed(last_tick: impl Fn() -> Stamp<Mono>) {
    tell(NotifyState::Ready);
    let limit = sd_notify::watchdog_enabled();
    let every = limit.map_or(LOOK_EVERY, |limit| (limit / LOOKS_PER_LIMIT).max(FASTEST));
    let mut due = tokio::time::interval(every);
    let mut seen = last_tick();
    loop {
        due.tick().await;
        let now = last_tick();
        if now != seen {
            tell(NotifyState::Watchdog);
        }
        seen = now;
    }
}

/// Says that the end has begun.
pub fn stopping() {
    tell(NotifyState::Stopping);
}

fn tell(state: NotifyState<'_>) {
    if let Err(error) = sd_notify::notify(&[state]) {
        tracing::warn!(%error, "systemd could not be told");
    }
}
