//! What can be wrong with a marker map.

use crate::messages::TagFamily;

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
    /// The tag is much too small or too large.
    #[error(
        "tag {family} {id} has edges of {edge_m} m, which is outside {low_m} to {high_m} m: \
         are these metres?",
        family = family.name()
    )]
    AbsurdSize {
        /// Family of the tag.
        family: TagFamily,
        /// Its number.
        id: u32,
        /// Its longest edge, m.
        edge_m: f64,
        /// Smallest believed, m.
        low_m: f64,
        /// Largest believed, m.
        high_m: f64,
    },
    /// The flight lies wholly behind one tag.
    #[error(
        "tag {family} {id} turns its back to the whole region: its corners are mirrored (seen \
         from the front they run lower left, lower right, upper right, upper left), or say \
         faces_away = true",
        family = family.name()
    )]
    FacesAway {
        /// Family of the tag.
        family: TagFamily,
        /// Its number.
        id: u32,
    },
    /// The flight lies wholly behind every tag.
    #[error(
        "all {n_tags} tags turn their backs to the region: their corners are mirrored (seen from \
         the front they run lower left, lower right, upper right, upper left), or the hall's axes \
         are left-handed"
    )]
    AllFaceAway {
        /// Tags in the map.
        n_tags: usize,
    },
    /// The same number of a point twice.
    #[error("point {id} stands in the map twice")]
    DuplicatePoint {
        /// Its number.
        id: u32,
    },
    /// A point is NaN or infinite.
    #[error("point {id} has a coordinate that is not a number")]
    PointNotFinite {
        /// Its number.
        id: u32,
    },
}
