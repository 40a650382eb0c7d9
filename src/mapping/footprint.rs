//! What a turn of the scanner leaves behind for the field: its beams, gathered square by square.
//!
//! Beams of one turn that hit the same square of nodes become one [`Patch`]: they share the pose's
//! error and most of the roughness below the cell size, so they are one datum, not many. A beam
//! whose height does not fit the patch of its square (dust, an edge) opens another one there, so
//! that a stray return does not spoil its neighbours.
//!
//! Patches keep where their beams started from and what they hit, not what that is worth: slope,
//! weight and derivatives follow anew from the newest surface whenever the field is solved.

use super::silence::SilentRay;
use crate::geometry::{Body, Hall, Point, Transform};
use crate::messages::PoseError;
use nalgebra::Vector3;

/// Beams of one turn that hit the same square of nodes.
///
/// Single precision holds 8 µm at 100 m, a thousandth of the sensors' noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch {
    /// Mean of the hits in the hall, m.
    pub place_m: [f32; 3],
    /// Mean of the hits in body axes, m.
    pub arm_m: [f32; 3],
    /// Number of beams.
    pub n_beams: u16,
    /// Which level of its cell it is of: see [`disturbance`](super::disturbance).
    pub level: u8,
}

/// One turn of the scanner over the material.
#[derive(Debug, Clone, PartialEq)]
pub struct Footprint {
    /// Error of the pose at the middle of the turn, chained to the footprint before.
    pub error: PoseError,
    /// Pose at the middle of the turn.
    pub hall_from_body: Transform<Hall, Body>,
    /// Which LiDAR of the map took it: vehicles whose maps are merged have their own.
    pub lidar_idx: usize,
    /// Its patches, in the order of the first beam of each.
    pub patches: Vec<Patch>,
    /// Where beams ended that hit no material, in the hall, m: they passed over some ([`passing`]).
    pub passed_to_m: Vec<[f32; 3]>,
    /// Beams that did not end.
    pub silent: Vec<SilentRay>,
}

/// A beam this much above or below the patch of its square does not belong to it, in cells: the
/// ground of one square rises by that much at a slope of 2.
const SPLIT_CELLS: f64 = 2.0;
/// Neighbouring beams hit neighbouring squares: older patches are not looked through.
const N_OPEN: usize = 6;

/// A hit of one turn, in the order of the beams.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineHit {
    /// Where it is.
    pub place: Point<Hall>,
    /// The same in body axes, m.
    pub arm_m: Vector3<f64>,
    /// Its column and row among the nodes; whole numbers are at nodes.
    pub at_node: (f64, f64),
}

/// Of beams that ended at these places, in their order, those that tell where they passed: one for each
/// half cell of way along the wall that they hit.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "rounded to single precision on purpose")]
pub fn passing(ends: &[Point<Hall>], cell_m: f64) -> Vec<[f32; 3]> {
    let mut kept: Vec<[f32; 3]> = Vec::new();
    let mut newest: Option<Vector3<f64>> = None;
    for end in ends.iter().map(|end| end.coords) {
        if newest.is_none_or(|newest| (end - newest).norm() >= 0.5 * cell_m) {
            newest = Some(end);
            kept.push(end.map(|c| c as f32).into());
        }
    }
    kept
}

/// Gathers the hits of one turn into patches.
#[must_use]
pub fn gather(hits: &[LineHit], cell_m: f64) -> Vec<Patch> {
    let mut gatherer = PatchGatherer { cell_m, open: Vec::new(), patches: Vec::new() };
    for hit in hits {
        gatherer.push(hit);
    }
    gatherer.finish()
}

struct PatchGatherer {
    cell_m: f64,
    open: Vec<Gathering>,
    patches: Vec<Patch>,
}

#[derive(Debug, Clone, Copy)]
struct Gathering {
    square: (i32, i32),
    place_sum: Vector3<f64>,
    arm_sum: Vector3<f64>,
    n_beams: u16,
}

impl PatchGatherer {
    /// Takes in a hit.
    #[expect(clippy::cast_possible_truncation, reason = "hits lie inside the region")]
    fn push(&mut self, hit: &LineHit) {
        let LineHit { place, at_node, .. } = hit;
        let square = (at_node.0.floor() as i32, at_node.1.floor() as i32);
        let split_m = SPLIT_CELLS * self.cell_m;
        let fits = |g: &&mut Gathering| {
            let mean_m = g.place_sum.z / f64::from(g.n_beams);
            g.square == square && (place.coords.z - mean_m).abs() < split_m && g.n_beams < u16::MAX
        };
        if let Some(gathering) = self.open.iter_mut().rev().find(fits) {
            gathering.add(hit);
            return;
        }
        if self.open.len() == N_OPEN {
            let oldest = self.open.remove(0);
            self.patches.push(oldest.close());
        }
        let mut fresh = Gathering {
            square,
            place_sum: Vector3::zeros(),
            arm_sum: Vector3::zeros(),
            n_beams: 0,
        };
        fresh.add(hit);
        self.open.push(fresh);
    }

    fn finish(mut self) -> Vec<Patch> {
        self.patches.extend(self.open.into_iter().map(Gathering::close));
        self.patches
    }
}

impl Gathering {
    fn add(&mut self, hit: &LineHit) {
        self.place_sum += hit.place.coords;
        self.arm_sum += hit.arm_m;
        self.n_beams += 1;
    }

    #[expect(clippy::cast_possible_truncation, reason = "rounded to single precision on purpose")]
    fn close(self) -> Patch {
        let n = f64::from(self.n_beams);
        Patch {
            place_m: (self.place_sum / n).map(|c| c as f32).into(),
            arm_m: (self.arm_sum / n).map(|c| c as f32).into(),
            n_beams: self.n_beams,
            level: Patch::NO_LEVEL,
        }
    }
}

impl Patch {
    /// The level of a patch that was not sorted yet, or is of no cell.
    pub const NO_LEVEL: u8 = u8::MAX;

    /// Mean of the hits in the hall, m.
    #[must_use]
    pub fn place(&self) -> Vector3<f64> {
        Vector3::from(self.place_m).map(f64::from)
    }

    /// Mean of the hits in body axes, m.
    #[must_use]
    pub fn arm(&self) -> Vector3<f64> {
        Vector3::from(self.arm_m).map(f64::from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hit(x: f64, y: f64, z: f64) -> LineHit {
        LineHit {
            place: Point::new(x, y, z),
            arm_m: Vector3::new(0.0, x, z - 7.0),
            at_node: (x / 0.25, y / 0.25),
        }
    }

    #[test]
    fn beams_of_a_square_become_their_mean() {
        let hits = [(1.05, 2.0), (1.10, 2.1), (1.2, 2.2), (1.3, 2.0)].map(|(x, z)| hit(x, 3.1, z));
        let patches = gather(&hits, 0.25);
        assert_eq!(patches.len(), 2);
        assert_eq!(patches[0].n_beams, 3);
        let expected = Vector3::new((1.05 + 1.1 + 1.2) / 3.0, 3.1, 2.1);
        assert!((patches[0].place() - expected).norm() < 1e-6);
        assert!((patches[0].arm() - Vector3::new(0.0, expected.x, -4.9)).norm() < 1e-6);
    }

    #[test]
    fn a_stray_return_stays_by_itself() {
        let hits: Vec<_> =
            [1.0, 1.01, 3.4, 1.02, 1.0].map(|z| hit(1.1, 3.1, z)).into_iter().collect();
        let patches = gather(&hits, 0.25);
        assert_eq!(patches.iter().map(|p| p.n_beams).collect::<Vec<_>>(), [4, 1]);
    }

    #[test]
    fn passing_beams_are_thinned_by_their_ends() {
        // 2 m down a wall in steps of 3 cm, then a jump: every fifth (15 cm) of 67, and the jump.
        let mut ends: Vec<_> =
            (0..67).map(|k| Point::new(5.0, 1.0, 2.0 - 0.03 * f64::from(k))).collect();
        ends.push(Point::new(2.0, 1.0, 0.02));
        let kept = passing(&ends, 0.25);
        assert_eq!(kept.len(), 14 + 1);
        assert!((kept[1][2] - 1.85).abs() < 1e-6);
    }

    #[test]
    fn no_beam_is_lost() {
        let hits: Vec<_> = (0..500_u32)
            .map(|k| hit(f64::from(k % 97) * 0.11, 2.0, f64::from(k % 13) * 0.4))
            .collect();
        let patches = gather(&hits, 0.25);
        assert_eq!(patches.iter().map(|p| u32::from(p.n_beams)).sum::<u32>(), 500);
    }
}
