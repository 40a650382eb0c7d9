//! The brain's end of the page.

use super::Wish;
use crate::link::LinkStats;
use crate::messages::CellCoverage;
use crate::pilot::{Action, Event, JobOutput, Outlook};
use crate::time::{Mono, Stamp};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::mpsc;

/// News that may wait for the page: some five seconds.
const NEWS_WAITING: usize = 1_024;

/// What the brain's task holds of the page.
#[derive(Debug)]
pub struct BrainEnd {
    /// Where news go.
    pub feed: Feed,
    /// Where wishes come from.
    pub wishes: mpsc::Receiver<Wish>,
}

/// Counters that the page shows; they only grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Pulse {
    /// The autopilot's clock is known.
    pub is_clock_known: bool,
    /// Ticks of the brain.
    pub ticks: u64,
    /// Ticks left out because the brain was late.
    pub ticks_skipped: u64,
    /// Events the brain took in.
    pub events: u64,
    /// Jobs that died without a result.
    pub jobs_failed: u64,
    /// Log entries dropped at a full or failed recorder.
    pub records_lost: u64,
    /// Messages to the autopilot dropped at a full transport.
    pub outgoing_lost: u64,
    /// Messages that never left because a newer one of their kind came.
    pub outgoing_superseded: u64,
    /// Messages of the autopilot that nobody took in time.
    pub received_lost: u64,
    /// Frames refused before they were decoded.
    pub refused_frames: u64,
    /// The MAVLink session's counters.
    pub link: LinkStats,
}

/// One thing that the page is told.
#[derive(Debug)]
pub(super) enum News {
    /// What the brain wants, moved.
    Action(Stamp<Mono>, Action),
    /// Where the flight stands.
    Outlook(Box<Outlook>, Box<Pulse>),
    /// How the cells of the surface that follows are known.
    Coverage(Vec<CellCoverage>),
}

/// Sends news without ever waiting.
#[derive(Debug, Clone)]
pub struct Feed {
    to_page: mpsc::Sender<News>,
    lost: Arc<AtomicU64>,
}

impl Feed {
    /// A feed, and where its news arrive.
    pub(super) fn new() -> (Self, mpsc::Receiver<News>) {
        let (to_page, news) = mpsc::channel(NEWS_WAITING);
        (Self { to_page, lost: Arc::new(AtomicU64::new(0)) }, news)
    }

    /// Hands over what is done with; setpoints are no news.
    pub fn action(&self, at: Stamp<Mono>, action: Action) {
        match action {
            Action::Steer(_) | Action::Start { .. } | Action::Command(_) => {}
            other => self.send(News::Action(at, other)),
        }
    }

    /// Looks at an event before the brain takes it: how the cells of a new surface are known.
    pub fn event(&self, event: &Event) {
        if let Event::Finished { output, .. } = event
            && let JobOutput::SurfaceSolved(Ok(solved)) = output.as_ref()
        {
            self.send(News::Coverage(solved.coverage.clone()));
        }
    }

    /// Hands over where the flight stands.
    pub fn outlook(&self, outlook: Outlook, pulse: Pulse) {
        self.send(News::Outlook(Box::new(outlook), Box::new(pulse)));
    }

    /// News that found no room.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }

    fn send(&self, news: News) {
        if self.to_page.try_send(news).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Severity, StatusText};

    #[test]
    fn a_page_that_does_not_listen_costs_news_and_nothing_else() {
        let (feed, mut news) = Feed::new();
        let say = || Action::Say(StatusText { severity: Severity::Info, text: "here".to_owned() });
        for _ in 0..NEWS_WAITING + 7 {
            feed.action(Stamp::ZERO, say());
        }
        assert_eq!(feed.lost(), 7);
        assert!(matches!(news.try_recv(), Ok(News::Action(_, Action::Say(_)))));
        // A page that has ended is the same.
        drop(news);
        feed.action(Stamp::ZERO, say());
        assert_eq!(feed.lost(), 8);
    }
}
