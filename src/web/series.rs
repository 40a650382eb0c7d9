//! Curves that are kept for the page, in bounded room.

use serde::Serialize;
use utoipa::ToSchema;

/// More points than a screen has columns are halved.
const MOST_POINTS: usize = 2_048;
/// A new point of the path is this far from the last at first, m.
const PATH_STEP_M: f64 = 0.1;

/// One point of the volume over time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub(super) struct VolumePoint {
    /// The flight's clock, s.
    pub(super) at_s: f64,
    /// Volume of the whole region, m³.
    pub(super) volume_m3: f64,
    /// U of it, k = 2, m³.
    pub(super) expanded_m3: f64,
    /// Share of the region that was measured, 0 to 1.
    pub(super) coverage: f64,
}

/// The curves of one flight.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub(super) struct Series {
    /// The volume over time.
    pub(super) volume: Vec<VolumePoint>,
    /// Where the vehicle was: x, y, z, m.
    pub(super) path_m: Vec<[f64; 3]>,
    /// Distance of the points of the path, m; doubled each time that they are halved.
    #[serde(skip)]
    #[schema(ignore)]
    path_step_m: f64,
}

impl Default for Series {
    fn default() -> Self {
        Self { volume: Vec::new(), path_m: Vec::new(), path_step_m: PATH_STEP_M }
    }
}

impl Series {
    /// Appends a volume.
    pub(super) fn push(&mut self, point: VolumePoint) {
        halve_if_full(&mut self.volume);
        self.volume.push(point);
    }

    /// Appends a place, if the vehicle has moved.
    pub(super) fn fly_to(&mut self, place_m: [f64; 3]) {
        let is_near = |last: &[f64; 3]| {
            let step = |axis: usize| place_m[axis] - last[axis];
            (0..3).map(|axis| step(axis).powi(2)).sum::<f64>() < self.path_step_m.powi(2)
        };
        if !self.path_m.last().is_some_and(is_near) {
            if halve_if_full(&mut self.path_m) {
                self.path_step_m *= 2.0;
            }
            self.path_m.push(place_m);
        }
    }
}

/// Leaves every second point, the first among them; true if that was needed.
fn halve_if_full<T>(points: &mut Vec<T>) -> bool {
    let is_full = points.len() >= MOST_POINTS;
    if is_full {
        let mut is_kept = false;
        points.retain(|_| {
            is_kept = !is_kept;
            is_kept
        });
    }
    is_full
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_room_is_bounded_and_the_whole_flight_stays() {
        let mut series = Series::default();
        for step in 0..20_000_u32 {
            series.fly_to([0.2 * f64::from(step), 0.0, 7.0]);
            series.fly_to([0.2 * f64::from(step) + 0.01, 0.0, 7.0]);
        }
        assert!(series.path_m.len() <= MOST_POINTS && series.path_m.len() > MOST_POINTS / 4);
        assert!(series.path_m[0][0].abs() < 1e-12, "the beginning is kept");
        let end_m = series.path_m[series.path_m.len() - 1][0];
        assert!((end_m - 0.2 * 19_999.0).abs() <= series.path_step_m, "{end_m}");
        assert!(series.path_m.is_sorted_by(|a, b| a[0] < b[0]));
    }
}
