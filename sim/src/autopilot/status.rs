//! When PX4's commander publishes its state, and which link has not told it yet.

use super::modes::Px4Mode;
use super::outbox::Link;
use std::time::Duration;
use stockpilot::time::{Boot, Stamp};

/// Without a change the state is published this often.
const PUBLISHED_EVERY: Duration = Duration::from_millis(500);

/// The topic `vehicle_status`: `CURRENT_MODE` leaves once for each time that it is published.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Status {
    last: Option<(Px4Mode, bool)>,
    published_at: Stamp<Boot>,
    is_news_for_companion: bool,
    is_news_for_ground: bool,
}

impl Status {
    /// Publishes mode and arming if they are others than before, or old.
    pub(super) fn publish(&mut self, now: Stamp<Boot>, state: (Px4Mode, bool)) {
        let is_old = now.since(self.published_at) >= PUBLISHED_EVERY;
        if self.last != Some(state) || is_old {
            self.last = Some(state);
            self.published_at = now;
            (self.is_news_for_companion, self.is_news_for_ground) = (true, true);
        }
    }

    /// True once for each publication.
    pub(super) const fn is_news_for(&mut self, link: Link) -> bool {
        let news = match link {
            Link::Companion => &mut self.is_news_for_companion,
            Link::Ground => &mut self.is_news_for_ground,
        };
        std::mem::replace(news, false)
    }
}
