//! A flight's log for as long as the flight is judged.

use anyhow::{Context, ensure};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use stockpilot::config::Config;
use stockpilot::pilot::{Action, Event};
use stockpilot::record::{LogHeader, LogItem, LogReader, Recorder};
use stockpilot::time::{Mono, Stamp};

/// Distinguishes the logs of one process.
static N_LOGS: AtomicU64 = AtomicU64::new(0);

/// A recorder and its file, which is removed in the end.
#[derive(Debug)]
pub(crate) struct TemporaryLog {
    recorder: Option<Recorder>,
    path: PathBuf,
}

impl TemporaryLog {
    pub(crate) fn create(config: &Config) -> anyhow::Result<Self> {
        let number = N_LOGS.fetch_add(1, Ordering::Relaxed);
        let name = format!("stockpilot-faults-{}-{number}.mcap", std::process::id());
        let path = std::env::temp_dir().join(name);
        let header = LogHeader { config_toml: config.to_toml()?, ..LogHeader::default() };
        let recorder = Recorder::create(&path, &header).context("no log")?.waiting();
        Ok(Self { recorder: Some(recorder), path })
    }

    pub(crate) fn event(&mut self, at: Stamp<Mono>, event: &Event) {
        if let Some(recorder) = &mut self.recorder {
            recorder.event(at, event);
        }
    }

    pub(crate) fn action(&mut self, at: Stamp<Mono>, action: &Action) {
        if let Some(recorder) = &mut self.recorder {
            recorder.result(at, action);
        }
    }

    /// See [`crate::campaign::DirectFlight::log_cut_at`].
    pub(crate) fn is_prefix_when_cut_at(&self, share: f64) -> anyhow::Result<bool> {
        let whole = std::fs::read(&self.path).context("the log cannot be read")?;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::cast_precision_loss,
            reason = "a share of a length"
        )]
        let n_bytes = (whole.len() as f64 * share.clamp(0.0, 1.0)) as usize;
        let mut cut = LogReader::new(&whole[..n_bytes]);
        let mut complete = LogReader::new(whole.as_slice());
        let is_same = cut.by_ref().all(|item| complete.next().as_ref() == Some(&item));
        Ok(is_same && !cut.is_complete())
    }

    /// Ends the log, reads it again, and counts its events.
    pub(crate) fn close(mut self) -> anyhow::Result<u64> {
        let stats = self.recorder.take().context("the log is closed already")?.close();
        ensure!(stats.lost_in_queue + stats.lost_on_disk == 0, "entries were lost: {stats:?}");
        let mut reader = LogReader::open(&self.path).context("the log cannot be opened")?;
        let is_event = |item: &LogItem| matches!(item, LogItem::Event { .. });
        let n_events = reader.by_ref().filter(is_event).count() as u64;
        ensure!(reader.is_complete(), "the log is not complete: {:?}", reader.damage());
        Ok(n_events)
    }
}

impl Drop for TemporaryLog {
    fn drop(&mut self) {
        // The recorder's thread must be done with the file first.
        drop(self.recorder.take());
        if let Err(error) = std::fs::remove_file(&self.path) {
            tracing::warn!(%error, path = %self.path.display(), "a log was left behind");
        }
    }
}
