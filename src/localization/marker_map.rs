//! Where the tags hang.

use crate::geometry::{Hall, Point};
use crate::messages::TagFamily;
use std::collections::BTreeMap;

/// The surveyed tags of a hall; read-only in flight.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MarkerMap {
    tags: BTreeMap<(TagFamily, u32), [Point<Hall>; 4]>,
}

/// What is wrong with a marker map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MarkerMapError {
    /// The same id twice.
    #[error("tag {family} {id} stands in the map twice", family = family.name())]
    Duplicate {
        /// Family of the tag.
        family: TagFamily,
        /// Its number.
        id: u32,
    },
    /// A corner is NaN or infinite.
    #[error("tag {family} {id} has a corner that is not a number", family = family.name())]
    NotFinite {
        /// Family of the tag.
        family: TagFamily,
        /// Its number.
        id: u32,
    },
    /// The corners are not a square.
    #[error(
        "tag {family} {id} is not a square: edges from {shortest_m:.4} m to {longest_m:.4} m",
        family = family.name()
    )]
    NotSquare {
        /// Family of the tag.
        family: TagFamily,
        /// Its number.
        id: u32,
        /// Shortest edge or scaled diagonal, m.
        shortest_m: f64,
        /// Longest edge or scaled diagonal, m.
        longest_m: f64,
    },
}

impl MarkerMap {
    /// Adds a tag by its corners: lower left, lower right, upper right, upper left of the upright
    /// tag, seen from its front.
    ///
    /// # Errors
    /// A second tag of the same name, corners that are not finite, or not a square within 2 %.
    pub fn insert(
        &mut self,
        family: TagFamily,
        id: u32,
        corners: [Point<Hall>; 4],
    ) -> Result<(), MarkerMapError> {
        if corners.iter().any(|corner| !corner.is_finite()) {
            return Err(MarkerMapError::NotFinite { family, id });
        }
        let distance = |a: usize, b: usize| (corners[a] - corners[b]).coords.norm();
        let diagonal = std::f64::consts::SQRT_2;
        let lengths = [
            distance(0, 1),
            distance(1, 2),
            distance(2, 3),
            distance(3, 0),
            distance(0, 2) / diagonal,
            distance(1, 3) / diagonal,
        ];
        let shortest_m = lengths.iter().copied().fold(f64::INFINITY, f64::min);
        let longest_m = lengths.iter().copied().fold(0.0, f64::max);
        if shortest_m <= 0.0 || longest_m > 1.02 * shortest_m {
            return Err(MarkerMapError::NotSquare { family, id, shortest_m, longest_m });
        }
        if self.tags.insert((family, id), corners).is_some() {
            return Err(MarkerMapError::Duplicate { family, id });
        }
        Ok(())
    }

    /// Corners of a tag in the hall, if it is mapped.
    #[must_use]
    pub fn corners(&self, family: TagFamily, id: u32) -> Option<&[Point<Hall>; 4]> {
        self.tags.get(&(family, id))
    }

    /// All tags, in order of family and id.
    pub fn iter(&self) -> impl Iterator<Item = (TagFamily, u32, &[Point<Hall>; 4])> {
        self.tags.iter().map(|(&(family, id), corners)| (family, id, corners))
    }

    /// Number of tags.
    #[must_use]
    pub fn len(&self) -> usize {
        self.tags.len()
    }

    /// True without any tag.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.tags.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(edge_m: f64) -> [Point<Hall>; 4] {
        [
            Point::new(5.0, 0.0, 2.0),
            Point::new(5.0, -edge_m, 2.0),
            Point::new(5.0, -edge_m, 2.0 + edge_m),
            Point::new(5.0, 0.0, 2.0 + edge_m),
        ]
    }

    #[test]
    fn duplicates_and_bent_tags_are_refused() {
        let mut map = MarkerMap::default();
        map.insert(TagFamily::Tag36h11, 4, square(0.5)).expect("a good tag");
        assert!(matches!(
            map.insert(TagFamily::Tag36h11, 4, square(0.5)),
            Err(MarkerMapError::Duplicate { id: 4, .. })
        ));
        let mut bent = square(0.5);
        bent[2].coords.z += 0.1;
        assert!(matches!(
            map.insert(TagFamily::Tag36h11, 5, bent),
            Err(MarkerMapError::NotSquare { id: 5, .. })
        ));
    }
}
