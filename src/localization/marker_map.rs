//! Where the tags hang, and where other points lie that a detector knows.

mod error;

pub use error::MarkerMapError;

use crate::geometry::{Hall, Point};
use crate::messages::TagFamily;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// The surveyed tags and points of a hall; read-only in flight.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkerMap {
    tags: BTreeMap<(TagFamily, u32), [Point<Hall>; 4]>,
    points: BTreeMap<u32, Point<Hall>>,
    place_sigma_m: f64,
}

/// Edges of tags that are believed, m: smaller ones nobody reads from the air, larger ones nobody
/// prints, so the unit is wrong.
const EDGE_M: (f64, f64) = (0.02, 5.0);
/// Edges and diagonals of a square may differ by this much: what a survey does to a tag.
const SQUARENESS: f64 = 1.02;
/// A tape measure and a level, corner by corner, m.
const USUAL_PLACE_SIGMA_M: f64 = 0.005;

impl Default for MarkerMap {
    fn default() -> Self {
        Self { tags: BTreeMap::new(), points: BTreeMap::new(), place_sigma_m: USUAL_PLACE_SIGMA_M }
    }
}

impl MarkerMap {
    /// Adds a tag by its corners: lower left, lower right, upper right, upper left of the upright
    /// tag, seen from its front.
    ///
    /// # Errors
    /// A second tag of the same name, corners that are not finite, not a square within 2 %, or one
    /// with edges outside of 0.02 m to 5 m.
    pub fn insert(
        &mut self,
        family: TagFamily,
        id: u32,
        corners: [Point<Hall>; 4],
    ) -> Result<(), MarkerMapError> {
        if corners.iter().any(|corner| !corner.is_finite()) {
            return Err(MarkerMapError::NotFinite { family, id });
        }
        let (shortest_m, longest_m) = edges_m(&corners);
        if !is_square(&corners) {
            return Err(MarkerMapError::NotSquare { family, id, shortest_m, longest_m });
        }
        let (low_m, high_m) = EDGE_M;
        if shortest_m < low_m || longest_m > high_m {
            let edge_m = longest_m;
            return Err(MarkerMapError::AbsurdSize { family, id, edge_m, low_m, high_m });
        }
        if self.tags.contains_key(&(family, id)) {
            return Err(MarkerMapError::Duplicate { family, id });
        }
        self.tags.insert((family, id), corners);
        Ok(())
    }

    /// Adds a point that belongs to no tag.
    ///
    /// # Errors
    /// A second point of the same number, or a place that is not finite.
    pub fn insert_point(&mut self, id: u32, place: Point<Hall>) -> Result<(), MarkerMapError> {
        if !place.is_finite() {
            return Err(MarkerMapError::PointNotFinite { id });
        }
        if self.points.contains_key(&id) {
            return Err(MarkerMapError::DuplicatePoint { id });
        }
        self.points.insert(id, place);
        Ok(())
    }

    /// The map with this standard deviation of a tag's place, each axis, m.
    #[must_use]
    pub fn with_place_sigma_m(self, place_sigma_m: f64) -> Self {
        Self { place_sigma_m, ..self }
    }

    /// Standard deviation of the surveyed place of a tag (all its corners together) or of a point,
    /// each axis, m.
    #[must_use]
    pub const fn place_sigma_m(&self) -> f64 {
        self.place_sigma_m
    }

    /// Corners of a tag in the hall, if it is mapped.
    #[must_use]
    pub fn corners(&self, family: TagFamily, id: u32) -> Option<&[Point<Hall>; 4]> {
        self.tags.get(&(family, id))
    }

    /// The place of a tag in the order of [`Self::iter`], if it is mapped.
    #[must_use]
    pub fn index(&self, family: TagFamily, id: u32) -> Option<usize> {
        let key = (family, id);
        self.tags.contains_key(&key).then(|| self.tags.range(..key).count())
    }

    /// The place of a point in the order of [`Self::points`], after all tags, if it is mapped.
    #[must_use]
    pub fn point_index(&self, id: u32) -> Option<usize> {
        self.points.contains_key(&id).then(|| self.tags.len() + self.points.range(..id).count())
    }

    /// Place of a point that belongs to no tag, if it is mapped.
    #[must_use]
    pub fn point(&self, id: u32) -> Option<Point<Hall>> {
        self.points.get(&id).copied()
    }

    /// All tags, in order of family and id.
    pub fn iter(&self) -> impl Iterator<Item = (TagFamily, u32, &[Point<Hall>; 4])> {
        self.tags.iter().map(|(&(family, id), corners)| (family, id, corners))
    }

    /// All points that belong to no tag, in order of their number.
    pub fn points(&self) -> impl Iterator<Item = (u32, Point<Hall>)> {
        self.points.iter().map(|(&id, &place)| (id, place))
    }

    /// Number of tags.
    #[must_use]
    pub fn len(&self) -> usize {
        self.tags.len()
    }

    /// True without any tag and any point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.tags.is_empty() && self.points.is_empty()
    }

    /// Checks that each tag's front looks at some part of a box (axes of the hall, lowest and
    /// highest corner) that holds the flight; those for which `is_exempt` may look away.
    ///
    /// Corners in the wrong sense of rotation turn the front to the back, so a mirrored tag faces
    /// its own wall.
    ///
    /// # Errors
    /// [`MarkerMapError::AllFaceAway`] if the box lies behind every tag (of two or more): then the
    /// whole map is mirrored. [`MarkerMapError::FacesAway`] names the first single one.
    pub fn check_facing(
        &self,
        (low, high): (Point<Hall>, Point<Hall>),
        is_exempt: impl Fn(TagFamily, u32) -> bool,
    ) -> Result<(), MarkerMapError> {
        let mut judged = self.iter().filter(|(family, id, _)| !is_exempt(*family, *id)).peekable();
        if judged.peek().is_none() {
            return Ok(());
        }
        let judged: Vec<_> = judged.collect();
        let away: Vec<_> = judged.iter().filter(|(.., c)| !sees_box(c, &low, &high)).collect();
        match away.first() {
            None => Ok(()),
            Some(_) if away.len() == judged.len() && judged.len() > 1 => {
                Err(MarkerMapError::AllFaceAway { n_tags: judged.len() })
            }
            Some(&&(family, id, _)) => Err(MarkerMapError::FacesAway { family, id }),
        }
    }
}

/// True if the corners, in order, are those of a square within 2 %.
pub(super) fn is_square(corners: &[Point<Hall>; 4]) -> bool {
    let (shortest_m, longest_m) = edges_m(corners);
    shortest_m > 0.0 && longest_m <= SQUARENESS * shortest_m
}

/// The shortest and the longest of edges and scaled diagonals.
fn edges_m(corners: &[Point<Hall>; 4]) -> (f64, f64) {
    let distance = |a: usize, b: usize| (corners[a] - corners[b]).coords.norm();
    let diagonal = std::f64::consts::SQRT_2;
    let lengths_m = [
        distance(0, 1),
        distance(1, 2),
        distance(2, 3),
        distance(3, 0),
        distance(0, 2) / diagonal,
        distance(1, 3) / diagonal,
    ];
    let shortest_m = lengths_m.iter().copied().fold(f64::INFINITY, f64::min);
    (shortest_m, lengths_m.iter().copied().fold(0.0, f64::max))
}

/// True if some corner of the box lies before the tag's front.
fn sees_box(corners: &[Point<Hall>; 4], low: &Point<Hall>, high: &Point<Hall>) -> bool {
    let front =
        (corners[1] - corners[0]).coords.cross(&(corners[3] - corners[0]).coords).normalize();
    // The farthest corner of the box along the front's direction.
    let farthest =
        Vector3::from_fn(|k, _| if front[k] > 0.0 { high.coords[k] } else { low.coords[k] });
    front.dot(&(farthest - corners[0].coords)) > 0.0
}

#[cfg(test)]
mod tests;
