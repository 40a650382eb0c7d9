//! What a turn of the scanner leaves behind for the field: its beams, gathered square by square.
//!
//! Beams of one turn that hit the same square of nodes become one [`Patch`]: they share the pose's
//! error and most of the roughness below the cell size, so they are one datum, not many. A beam
//! whose height does not fit the patch of its square (dust, an edge) opens another one there, so
//! that a stray return does not spoil its neighbours.
//!
//! Patches keep where their beams started from and what they hit, not what that is worth: slope,
//! weight and derivatives follow anew from the newest surface whenever the field is solved.

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
}

/// One turn of the scanner over the material.
#[derive(Debug, Clone, PartialEq)]
pub struct Footprint {
    /// Error of the pose at the middle of the turn, chained to the footprint before.
    pub error: PoseError,
    /// Pose at the middle of the turn.
    pub hall_from_body: Transform<Hall, Body>,
    /// Its patches, in the order of the first beam of each.
    pub patches: Vec<Patch>,
}

/// A beam this much above or below the patch of its square does not belong to it, in cells: the
/// ground of one square rises by that much at a slope of 2.
const SPLIT_CELLS: f64 = 2.0;
/// Neighbouring beams hit neighbouring squares: older patches are not looked through.
const N_OPEN: usize = 6;

/// Gathers the beams of one turn.
#[derive(Debug, Clone)]
pub struct PatchGatherer {
    cell_m: f64,
    open: Vec<Gathering>,
    patches: Vec<Patch>,
}

#[derive(Debug, Clone, Copy)]
struct Gathering {
    square: (i32, i32),
    place_sum_m: Vector3<f64>,
    arm_sum_m: Vector3<f64>,
    n_beams: u16,
}

impl PatchGatherer {
    /// Nothing gathered yet, on nodes `cell_m` apart.
    #[must_use]
    pub const fn new(cell_m: f64) -> Self {
        Self { cell_m, open: Vec::new(), patches: Vec::new() }
    }

    /// Takes in a hit: in the hall, in body axes, and its column and row among the nodes (whole
    /// numbers at nodes).
    #[expect(clippy::cast_possible_truncation, reason = "hits lie inside the region")]
    pub fn push(&mut self, place: &Point<Hall>, arm_m: &Vector3<f64>, at_node: (f64, f64)) {
        let square = (at_node.0.floor() as i32, at_node.1.floor() as i32);
        let split_m = SPLIT_CELLS * self.cell_m;
        let fits = |g: &&mut Gathering| {
            let mean_m = g.place_sum_m.z / f64::from(g.n_beams);
            g.square == square && (place.coords.z - mean_m).abs() < split_m && g.n_beams < u16::MAX
        };
        if let Some(gathering) = self.open.iter_mut().rev().find(fits) {
            gathering.place_sum_m += place.coords;
            gathering.arm_sum_m += arm_m;
            gathering.n_beams += 1;
            return;
        }
        if self.open.len() == N_OPEN {
            let oldest = self.open.remove(0);
            self.patches.push(oldest.close());
        }
        self.open.push(Gathering {
            square,
            place_sum_m: place.coords,
            arm_sum_m: *arm_m,
            n_beams: 1,
        });
    }

    /// The patches of the turn.
    #[must_use]
    pub fn finish(mut self) -> Vec<Patch> {
        self.patches.extend(self.open.into_iter().map(Gathering::close));
        self.patches
    }
}

impl Gathering {
    #[expect(clippy::cast_possible_truncation, reason = "rounded to single precision on purpose")]
    fn close(self) -> Patch {
        let n = f64::from(self.n_beams);
        Patch {
            place_m: (self.place_sum_m / n).map(|c| c as f32).into(),
            arm_m: (self.arm_sum_m / n).map(|c| c as f32).into(),
            n_beams: self.n_beams,
        }
    }
}

impl Patch {
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

    fn push(gatherer: &mut PatchGatherer, x: f64, y: f64, z: f64) {
        let place = Point::new(x, y, z);
        gatherer.push(&place, &Vector3::new(0.0, x, z - 7.0), (x / 0.25, y / 0.25));
    }

    #[test]
    fn beams_of_a_square_become_their_mean() {
        let mut gatherer = PatchGatherer::new(0.25);
        for (x, z) in [(1.05, 2.0), (1.15, 2.1), (1.2, 2.2), (1.3, 2.0)] {
            push(&mut gatherer, x, 3.1, z);
        }
        let patches = gatherer.finish();
        assert_eq!(patches.len(), 2);
        assert_eq!(patches[0].n_beams, 3);
        let expected = Vector3::new((1.05 + 1.15 + 1.2) / 3.0, 3.1, 2.1);
        assert!((patches[0].place() - expected).norm() < 1e-6);
        assert!((patches[0].arm() - Vector3::new(0.0, expected.x, -4.9)).norm() < 1e-6);
    }

    #[test]
    fn a_stray_return_stays_by_itself() {
        let mut gatherer = PatchGatherer::new(0.25);
        for z in [1.0, 1.01, 3.4, 1.02, 1.0] {
            push(&mut gatherer, 1.1, 3.1, z);
        }
        let patches = gatherer.finish();
        assert_eq!(patches.iter().map(|p| p.n_beams).collect::<Vec<_>>(), [4, 1]);
    }

    #[test]
    fn no_beam_is_lost() {
        let mut gatherer = PatchGatherer::new(0.25);
        let mut sum_m = 0.0;
        for k in 0..500_u32 {
            let x = f64::from(k % 97) * 0.11;
            let z = f64::from(k % 13) * 0.4;
            sum_m += z;
            push(&mut gatherer, x, 2.0, z);
        }
        let patches = gatherer.finish();
        assert_eq!(patches.iter().map(|p| u32::from(p.n_beams)).sum::<u32>(), 500);
        let mean: f64 = patches.iter().map(|p| f64::from(p.n_beams) * p.place().z).sum();
        assert!((mean - sum_m).abs() < 1e-3);
    }
}
