//! Cameras whose tags are found here.

use super::{Check, Verdict, judge};
use crate::camera::images::{self, ImageDriver, ImageStats};
use crate::config::Config;
use crate::pilot::Event;
use crate::service::clock::Clock;
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

/// Drivers at work, and what could not be started.
#[derive(Debug)]
pub(super) struct OwnCameras {
    drivers: Vec<(u8, ImageDriver, watch::Receiver<ImageStats>)>,
    failed: Vec<Check>,
}

impl OwnCameras {
    /// Starts all that the configuration names.
    pub(super) fn start(
        config: &Config,
        clock: &Clock,
        frames: &mpsc::Sender<Event>,
        stop: &CancellationToken,
    ) -> Self {
        let mut cameras = Self { drivers: Vec::new(), failed: Vec::new() };
        let cure = "see that it is plugged in, that nothing else uses it (`fuser -v DEVICE`) and that this user is in group video";
        let settings = match config.image_settings() {
            Ok(settings) => settings,
            Err(error) => {
                let check =
                    Check::with_cure("camera", Verdict::Bad, error.to_string(), "mend this key");
                cameras.failed.push(check);
                return cameras;
            }
        };
        for one in settings {
            let images::Settings { camera, .. } = one;
            let clock = clock.clone();
            match ImageDriver::start(one, move || clock.now(), frames.clone(), stop) {
                Ok(driver) => {
                    let stats = driver.stats();
                    cameras.drivers.push((camera.0, driver, stats));
                }
                Err(error) => {
                    let found = format!("{}: {error}", camera.0);
                    cameras.failed.push(Check::with_cure("camera", Verdict::Bad, found, cure));
                }
            }
        }
        cameras
    }

    /// True if the configuration names none.
    pub(super) const fn is_empty(&self) -> bool {
        self.drivers.is_empty() && self.failed.is_empty()
    }

    /// True if every one that was started has delivered.
    pub(super) fn have_delivered(&self) -> bool {
        self.drivers.iter().all(|(.., stats)| stats.borrow().frames > 0)
    }

    /// Judges and stops them.
    pub(super) fn end(self, listened: Duration) -> Vec<Check> {
        let judged = self.drivers.into_iter().map(|(number, driver, stats)| {
            let check = judge::own_camera(number, &stats.borrow(), listened);
            driver.stop();
            check
        });
        let mut checks: Vec<Check> = judged.collect();
        checks.extend(self.failed);
        checks
    }
}
