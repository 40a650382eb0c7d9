//! The last true poses, and the ones between them.

use std::collections::VecDeque;
use std::time::Duration;
use stockpilot::geometry::{Body, Hall, Point, Rotation, Transform};
use stockpilot::time::{Mono, Stamp};

/// True poses of the body at the last simulation steps.
#[derive(Debug, Clone, Default)]
pub struct PoseTrack {
    poses: VecDeque<(Stamp<Mono>, Transform<Hall, Body>)>,
}

impl PoseTrack {
    const LONGEST: usize = 512;

    /// Adds the pose at a later instant than all before; an earlier one is ignored.
    pub fn push(&mut self, at: Stamp<Mono>, hall_from_body: Transform<Hall, Body>) {
        if self.poses.back().is_some_and(|(last, _)| *last >= at) {
            return;
        }
        if self.poses.len() == Self::LONGEST {
            self.poses.pop_front();
        }
        self.poses.push_back((at, hall_from_body));
    }

    /// Poses are carried on this far beyond the last step: a few σ of a clock's offset. A speed
    /// that changes by 5 m/s² makes that wrong by 0.3 mm at most.
    const AHEAD: Duration = Duration::from_millis(10);

    /// The pose at an instant: between two steps in a straight line and at constant turn rate, and
    /// so on for 10 ms after the last; the first pose before them; `None` before anything was
    /// pushed.
    #[must_use]
    pub fn at(&self, at: Stamp<Mono>) -> Option<Transform<Hall, Body>> {
        let after = self.poses.partition_point(|(stamp, _)| *stamp <= at);
        let Some((late, to)) = self.poses.get(after) else {
            return self.ahead(at);
        };
        let Some((early, from)) = after.checked_sub(1).and_then(|i| self.poses.get(i)) else {
            return Some(*to);
        };
        let share = at.seconds_since(*early) / late.seconds_since(*early);
        Some(between(from, to, share))
    }

    /// The pose after the last step, as if the vehicle went on as between the last two.
    fn ahead(&self, at: Stamp<Mono>) -> Option<Transform<Hall, Body>> {
        let (late, to) = self.poses.back()?;
        let Some((early, from)) = self.poses.len().checked_sub(2).and_then(|i| self.poses.get(i))
        else {
            return Some(*to);
        };
        let beyond = at.since(*late).min(Self::AHEAD);
        if beyond.is_zero() {
            return Some(*to);
        }
        let share = 1.0 + beyond.as_secs_f64() / late.seconds_since(*early);
        Some(between(from, to, share))
    }
}

fn between(
    from: &Transform<Hall, Body>,
    to: &Transform<Hall, Body>,
    share: f64,
) -> Transform<Hall, Body> {
    let origin = from.origin.coords.lerp(&to.origin.coords, share);
    // Chord and arc agree to 1e-6 of the turn for the small turns of one step.
    let quaternion = from.rotation.quaternion().nlerp(to.rotation.quaternion(), share);
    Transform::new(Rotation::from_quaternion(quaternion), Point::from_coords(origin))
}
