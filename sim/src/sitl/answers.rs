//! What the service claimed in a flight, out of its log, beside the truth.

use super::track::TruthTrack;
use crate::judge::PoseJudge;
use anyhow::Context as _;
use nalgebra::Vector3;
use serde::Deserialize;
use std::path::Path;
use stockpilot::messages::state;
use stockpilot::record::{LogItem, LogReader, Topic};
use stockpilot::time::Stamp;

/// A pose that went to the autopilot, as recorded.
#[derive(Debug, Deserialize)]
struct Claimed {
    at_ns: i64,
    hall_from_body: Pose,
    /// 15×15, row by row.
    error_cov: Vec<f64>,
}

#[derive(Debug, Deserialize)]
struct Pose {
    origin_m: [f64; 3],
}

/// Judges every published pose of a log.
///
/// # Errors
/// A log that cannot be read.
pub(super) fn judge(log: &Path, track: &TruthTrack) -> anyhow::Result<PoseJudge> {
    let reader = LogReader::open(log).context("the log cannot be opened")?;
    let mut poses = PoseJudge::default();
    for item in reader {
        let LogItem::Result { topic: Topic::Odometry, json, .. } = item else { continue };
        let claimed: Claimed = serde_json::from_slice(&json).context("a pose in the log")?;
        let var = [0, 1, 2].map(|k| claimed.error_cov.get(k * (state::SIZE + 1)).copied());
        let truth = track.at(Stamp::from_nanos(claimed.at_ns));
        if let (Some(truth), [Some(x), Some(y), Some(z)]) = (truth, var) {
            let place = Vector3::from(claimed.hall_from_body.origin_m);
            poses.judge(&place, [x, y, z], &truth.origin.coords);
        }
    }
    Ok(poses)
}
