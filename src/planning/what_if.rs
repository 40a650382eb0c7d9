//! Where one more marker would open most of the free space.
//!
//! Candidates hang on the walls at equal distance, in rows. Each is added to the map by itself, and
//! the nodes of the grid that become good enough are counted:
//!
//! ```text
//! gain = |{ χ : χ clear, q(χ) ≤ τ, q with it > τ }|,   Σ = σ² (JᵀJ + J₊ᵀJ₊)⁻¹
//! ```
//! - `J`, `J₊`: derivatives of the corners in view of the mapped tags and of the candidate

use super::free_space::FreeSpace;
use crate::geometry::{Hall, Point};
use crate::localization::vision_fix::q_pos;
use crate::mapping::polygon::Polygon;
use nalgebra::{Matrix6, Vector3};

/// A marker that might hang on a wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Lower left, lower right, upper right, upper left, seen from the front.
    pub corners: [Point<Hall>; 4],
    /// Unit vector out of its front, in hall axes.
    pub facing: Vector3<f64>,
}

impl Candidate {
    /// Its middle.
    #[must_use]
    pub fn place(&self) -> Point<Hall> {
        middle(&self.corners)
    }
}

/// How candidates are laid out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// Distance of neighbours along a wall, and of rows, m.
    pub spacing_m: f64,
    /// Heights of the lowest row and of the highest that may be, m.
    pub rows_m: (f64, f64),
    /// Length of a marker's sides, m.
    pub edge_m: f64,
}

/// What a candidate would open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// Which.
    pub candidate: Candidate,
    /// Area that becomes free at the height and heading of the survey, m².
    pub area_m2: f64,
    /// Nodes of the grid that become free, at all heights and headings.
    pub n_nodes: usize,
    /// By how much it lifts the quality of the nodes that are not good enough, summed over them;
    /// decides between candidates that open nothing.
    pub quality_gain: f64,
}

/// Candidates on the inner faces of the walls, except where a tag hangs already.
#[must_use]
pub fn candidates(walls: &Polygon, layout: &Layout, tags: &[[Point<Hall>; 4]]) -> Vec<Candidate> {
    let taken: Vec<Vector3<f64>> = tags.iter().map(|tag| middle(tag).coords).collect();
    let is_taken =
        |place: &Vector3<f64>| taken.iter().any(|tag| (tag - place).norm() < layout.edge_m);
    let mut found = Vec::new();
    for (a, b) in walls.edges() {
        let (from, to) = (Vector3::new(a.0, a.1, 0.0), Vector3::new(b.0, b.1, 0.0));
        let length_m = (to - from).norm();
        let along = (to - from) / length_m;
        // Corners run counter-clockwise, so the hall lies on the left.
        let facing = Vector3::z().cross(&along);
        for along_m in evenly(0.5 * layout.edge_m, length_m - 0.5 * layout.edge_m, layout.spacing_m)
        {
            for up_m in evenly(layout.rows_m.0, layout.rows_m.1, layout.spacing_m) {
                let place = from + along * along_m + Vector3::z() * up_m;
                if !is_taken(&place) {
                    // Seen from the front, right is against the sense of the corners.
                    found.push(Candidate {
                        corners: square(&place, &-along, layout.edge_m),
                        facing,
                    });
                }
            }
        }
    }
    found
}

/// Values between two limits at about equal distance, in the middle of their parts.
fn evenly(low: f64, high: f64, spacing: f64) -> impl Iterator<Item = f64> {
    let n_parts = ((high - low) / spacing).ceil().max(1.0);
    let part = (high - low).max(0.0) / n_parts;
    std::iter::successors(Some(0.5), move |k| (k + 1.0 < n_parts).then_some(k + 1.0))
        .map(move |k| low + k * part)
}

fn square(place: &Vector3<f64>, right: &Vector3<f64>, edge_m: f64) -> [Point<Hall>; 4] {
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(rightwards, up)| {
        Point::from_coords(place + (right * rightwards + Vector3::z() * up) * (0.5 * edge_m))
    })
}

fn middle(corners: &[Point<Hall>; 4]) -> Point<Hall> {
    Point::from_coords(corners.iter().map(|c| c.coords).sum::<Vector3<f64>>() / 4.0)
}

/// A node that is clear but not good enough, with what its fix is made of.
#[derive(Debug, Clone, PartialEq)]
struct Poor {
    node: usize,
    normal_matrices: Vec<Matrix6<f64>>,
    quality: f64,
}

/// What candidates are judged against: the nodes that are clear but not good enough.
#[derive(Debug, Clone, PartialEq)]
pub struct WhatIf<'a> {
    space: &'a FreeSpace,
    poor: Vec<Poor>,
}

/// The best of ranked gains that are at least `apart_m` from each better one.
#[must_use]
pub fn distinct(ranked: &[Gain], apart_m: f64, n: usize) -> Vec<Gain> {
    let mut best: Vec<Gain> = Vec::new();
    for gain in ranked {
        let is_apart = |other: &Gain| {
            (other.candidate.place() - gain.candidate.place()).coords.norm() >= apart_m
        };
        if best.len() < n && best.iter().all(is_apart) {
            best.push(*gain);
        }
    }
    best
}

/// The best first: by area at the height and heading of the survey, then by nodes, then by quality.
pub fn rank(gains: &mut [Gain]) {
    gains.sort_by(|a, b| {
        let by_area = b.area_m2.total_cmp(&a.area_m2);
        let by_quality = b.quality_gain.total_cmp(&a.quality_gain);
        by_area.then(b.n_nodes.cmp(&a.n_nodes)).then(by_quality)
    });
}

impl<'a> WhatIf<'a> {
    /// Looks for the poor nodes; evaluates the whole grid, where [`QualityGrid::fill`] has not.
    ///
    /// [`QualityGrid::fill`]: super::quality_grid::QualityGrid::fill
    #[must_use]
    pub fn new(space: &'a FreeSpace) -> Self {
        let (axes, sensing) = (space.quality().axes(), space.quality().sensing());
        let poor = (0..axes.n_nodes())
            .filter(|node| space.quality().quality_at(*node) <= space.min_quality())
            .map(|node| (node, axes.waypoint(node)))
            .filter(|(_, waypoint)| space.clearance().is_clear(&waypoint.place.coords))
            .map(|(node, waypoint)| Poor {
                node,
                normal_matrices: sensing.normal_matrices(&sensing.tags, &waypoint.level_pose()),
                quality: space.quality().quality_at(node),
            })
            .collect();
        Self { space, poor }
    }

    /// How many nodes are clear but not good enough.
    #[must_use]
    pub const fn n_poor(&self) -> usize {
        self.poor.len()
    }

    /// What one candidate would open.
    #[must_use]
    pub fn gain(&self, candidate: &Candidate) -> Gain {
        gain(self.space, &self.poor, candidate)
    }
}

fn gain(space: &FreeSpace, poor: &[Poor], candidate: &Candidate) -> Gain {
    let (axes, sensing) = (space.quality().axes(), space.quality().sensing());
    let tags = [candidate.corners];
    let mut gain = Gain { candidate: *candidate, area_m2: 0.0, n_nodes: 0, quality_gain: 0.0 };
    for Poor { node, normal_matrices, quality } in poor {
        let mut sums = sensing.normal_matrices(&tags, &axes.waypoint(*node).level_pose());
        if sums.iter().all(|normal| normal.trace() <= 0.0) {
            continue;
        }
        sums.iter_mut().zip(normal_matrices).for_each(|(sum, known)| *sum += known);
        let with_it = sensing.cov_of(&sums).as_ref().map_or(0.0, q_pos);
        gain.quality_gain += (with_it - quality).max(0.0);
        if with_it > space.min_quality() {
            gain.n_nodes += 1;
            if axes.is_of_survey(*node) {
                gain.area_m2 += axes.x.step * axes.y.step;
            }
        }
    }
    gain
}

#[cfg(test)]
mod tests;
