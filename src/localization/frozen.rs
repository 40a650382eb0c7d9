//! A camera that repeats its last picture while the vehicle moves.
//!
//! Two exposures never give the same corners to the last bit, unless nothing moves and nothing
//! is noisy. So equal corners are suspicious; they are refused once the pose says that they should
//! have moved. Refused frames leave the pose to the inertial samples, so the proof gets better.

use super::tight_update::{Frame, Projector, Viewpoint};
use crate::messages::TagDetection;
use nalgebra::{Vector2, Vector3};

/// Corners that should have moved this far and did not are frozen, px.
const FROZEN_PX: f64 = 0.5;

/// The last new picture of one camera.
#[derive(Debug, Clone, Default)]
pub(super) struct FrozenWatch {
    last: Option<(Vec<TagDetection>, Viewpoint)>,
    is_frozen: bool,
}

/// What a picture is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Picture {
    /// New, or a repetition that the motion allows.
    Live,
    /// A repetition although the vehicle moved; `is_news` in the first of them.
    Frozen {
        /// Nobody was told yet.
        is_news: bool,
    },
}

impl FrozenWatch {
    /// Judges the next picture of the camera, seen from `view` as far as the filter knows.
    pub(super) fn judge(
        &mut self,
        tags: &[TagDetection],
        frame: &Frame,
        view: &Viewpoint,
    ) -> Picture {
        let then = match &self.last {
            Some((last, then)) if !tags.is_empty() && last.as_slice() == tags => then,
            _ => {
                self.last = Some((tags.to_vec(), *view));
                self.is_frozen = false;
                return Picture::Live;
            }
        };
        if !self.is_frozen && expected_motion_px(frame, then, view) < FROZEN_PX {
            return Picture::Live;
        }
        let is_news = !std::mem::replace(&mut self.is_frozen, true);
        Picture::Frozen { is_news }
    }
}

/// How far the points should have moved between two viewpoints, the mean of their lengths, px.
fn expected_motion_px(frame: &Frame, then: &Viewpoint, now: &Viewpoint) -> f64 {
    let still = |view: &Viewpoint| Viewpoint {
        velocity_mps: Vector3::zeros(),
        rate_radps: Vector3::zeros(),
        ..*view
    };
    let (then, now) = (still(then), still(now));
    let (then, now) = (Projector::new(frame, &then), Projector::new(frame, &now));
    let mut lengths_px = Vec::new();
    for point in &frame.points {
        if let (Some(a), Some(b)) = (then.residual(point), now.residual(point)) {
            let moved: Vector2<f64> = b.r - a.r;
            lengths_px.push(moved.norm() * frame.corner_sigma_px);
        }
    }
    #[expect(clippy::cast_precision_loss, reason = "a frame has few points")]
    let n = lengths_px.len().max(1) as f64;
    lengths_px.iter().sum::<f64>() / n
}
