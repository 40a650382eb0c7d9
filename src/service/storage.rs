//! Looks after the disk with the log: how much is free, what may go, and what the brain must know.

use super::clock::Clock;
use super::status::ServiceStatus;
use crate::messages::{Room, StorageState};
use crate::mission::Phase;
use crate::pilot::Event;
use crate::record::{RecorderHealth, Shelf, ShelfSettings, ShelvedLog};
use std::io;
use std::path::PathBuf;
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Looks until room is tried to be made again, after nothing could be deleted.
const LOOKS_BETWEEN_TRIES: u32 = 60;

/// What is looked at.
#[derive(Debug)]
pub(super) struct StorageWatch {
    settings: ShelfSettings,
    shelf: Option<Shelf>,
    /// The recorder's; `None` if there is no log at all.
    health: Option<RecorderHealth>,
    clock: Clock,
    /// Where [`Event::StorageLooked`] goes.
    events: mpsc::Sender<Event>,
    status: watch::Receiver<ServiceStatus>,
}

impl StorageWatch {
    pub(super) fn new(
        settings: ShelfSettings,
        log: PathBuf,
        health: Option<RecorderHealth>,
        clock: Clock,
        (events, status): (mpsc::Sender<Event>, watch::Receiver<ServiceStatus>),
    ) -> Self {
        let shelf = Some(Shelf::new(settings.folder.clone(), log));
        Self { settings, shelf, health, clock, events, status }
    }

    /// Looks once a second until `stop` is cancelled.
    pub(super) async fn run(mut self, stop: CancellationToken) {
        let mut due = tokio::time::interval(LOOK_EVERY);
        let mut told = None;
        let mut looks_to_wait = 0_u32;
        while stop.run_until_cancelled(due.tick()).await.is_some() {
            let Some(state) = self.look().await else { continue };
            if told.is_none_or(|told| is_news(&told, &state))
                && self.events.try_send(Event::StorageLooked(state)).is_ok()
            {
                told = Some(state);
            }
            looks_to_wait = looks_to_wait.saturating_sub(1);
            if state.room != Room::Enough && looks_to_wait == 0 && self.is_on_ground() {
                looks_to_wait = LOOKS_BETWEEN_TRIES;
                self.make_room().await;
            }
        }
    }

    /// A disk can make who asks it wait, so another thread does.
    async fn look(&self) -> Option<StorageState> {
        let settings = self.settings.clone();
        let free_bytes = tokio::task::spawn_blocking(move || settings.free_bytes()).await.ok()?;
        Some(StorageState {
            at: self.clock.now(),
            room: self.settings.room(free_bytes),
            free_bytes,
            survey_bytes: self.settings.survey_bytes,
            records_lost: self.status.borrow().stats.records_lost,
            has_log_failed: self.health.as_ref().is_none_or(|health| health.stats().has_failed),
        })
    }

    /// Deleting takes an SD card's time, which in flight belongs to the log.
    fn is_on_ground(&self) -> bool {
        matches!(self.status.borrow().phase, None | Some(Phase::Idle))
    }

    async fn make_room(&mut self) {
        let Some(mut shelf) = self.shelf.take() else { return };
        let settings = self.settings.clone();
        let is_enough =
            move || settings.free_bytes().is_none_or(|free| free >= settings.enough_bytes());
        let work = move || {
            let deleted = shelf.make_room(is_enough);
            (shelf, deleted)
        };
        match tokio::task::spawn_blocking(work).await {
            Ok((shelf, deleted)) => {
                self.shelf = Some(shelf);
                tell(deleted);
            }
            Err(error) => tracing::error!(%error, "no room can be made any more"),
        }
    }
}

fn tell(deleted: io::Result<Vec<ShelvedLog>>) {
    match deleted {
        Ok(logs) if logs.is_empty() => {
            tracing::warn!("the disk is short, and no log may be deleted: report surveys");
        }
        Ok(logs) => {
            for log in logs {
                let path = log.path.display();
                tracing::warn!(%path, log.bytes, standing = ?log.standing, "deleted for room");
            }
        }
        Err(error) => tracing::error!(%error, "cannot make room for the log"),
    }
}

/// The brain hears of what changes a decision or a line for people, not of every byte.
fn is_news(told: &StorageState, now: &StorageState) -> bool {
    told.room != now.room
        || told.has_log_failed != now.has_log_failed
        || (told.records_lost == 0) != (now.records_lost == 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{LogHeader, Recorder, mark_reported};
    use std::path::Path;

    /// Looks once at a folder of which every disk is too small, and makes room.
    async fn looked_at(folder: &Path, phase: Option<Phase>) -> Event {
        let settings = ShelfSettings {
            folder: folder.to_owned(),
            survey_bytes: u64::MAX - 1,
            low_bytes: u64::MAX,
        };
        let (events, mut seen) = mpsc::channel(4);
        let (_status, status) = watch::channel(ServiceStatus { phase, ..Default::default() });
        let log = folder.join("flight-9.mcap");
        let (clock, _driver) = Clock::driven();
        let watch = StorageWatch::new(settings, log, None, clock, (events, status));
        let stop = CancellationToken::new();
        let task = tokio::spawn(watch.run(stop.clone()));
        let event = seen.recv().await.unwrap();
        stop.cancel();
        task.await.unwrap();
        event
    }

    #[tokio::test]
    async fn the_brain_hears_of_a_full_disk_and_room_is_made_on_the_ground_only() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str| {
            let path = folder.path().join(name);
            drop(Recorder::create(&path, &LogHeader::default()).unwrap());
            path
        };
        let (reported, current) = (write("flight-1.mcap"), write("flight-9.mcap"));
        mark_reported(&reported, "report").unwrap();
        for phase in [Phase::Survey, Phase::Preflight] {
            looked_at(folder.path(), Some(phase)).await;
            assert!(reported.exists());
        }
        let event = looked_at(folder.path(), None).await;
        let Event::StorageLooked(state) = event else { panic!("{event:?}") };
        assert_eq!(state.room, Room::TooLittle);
        assert!(state.free_bytes.is_some() && state.has_log_failed);
        assert!(!reported.exists() && current.exists());
    }
}
