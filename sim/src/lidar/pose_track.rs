//! The last true poses, and the ones between them.

use std::collections::VecDeque;
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

    /// The pose at an instant: between two steps in a straight line and at constant turn rate, the
    /// first or last pose outside of them; `None` before anything was pushed.
    #[must_use]
    pub fn at(&self, at: Stamp<Mono>) -> Option<Transform<Hall, Body>> {
        let after = self.poses.partition_point(|(stamp, _)| *stamp <= at);
        let Some((late, to)) = self.poses.get(after) else {
            return self.poses.back().map(|(_, pose)| *pose);
        };
        let Some((early, from)) = after.checked_sub(1).and_then(|i| self.poses.get(i)) else {
            return Some(*to);
        };
        let share = at.seconds_since(*early) / late.seconds_since(*early);
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
