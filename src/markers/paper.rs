//! Sizes of paper, and what fits on them.

use crate::messages::TagFamily;

/// Printers leave this much at the border white, mm.
pub(super) const BORDER_MM: f64 = 5.0;
/// The vertical ruler's strip, mm.
pub(super) const SIDE_STRIP_MM: f64 = 12.0;
/// The strip above the tag with its text and arrow, mm.
pub(super) const TOP_STRIP_MM: f64 = 22.0;
/// The strip below it with the horizontal ruler, mm.
pub(super) const BOTTOM_STRIP_MM: f64 = 24.0;

/// A sheet of paper, upright.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paper {
    /// Its name.
    pub name: &'static str,
    /// Width, mm.
    pub width_mm: f64,
    /// Height, mm.
    pub height_mm: f64,
}

/// A sheet that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SheetError {
    /// No paper of this name.
    #[error("paper {0:?} is unknown: A0 to A4, letter or ledger")]
    UnknownPaper(String),
    /// The tag is too large, or absurdly small.
    #[error("an edge of {edge_mm:.1} mm does not go on {paper}: 20 to {largest_mm:.0} mm do")]
    DoesNotFit {
        /// The edge, mm.
        edge_mm: f64,
        /// The paper's name.
        paper: &'static str,
        /// The largest edge that fits, mm.
        largest_mm: f64,
    },
    /// The family has no such tag.
    #[error("family {family} has no tag {id}, its last is {last}", family = family.name())]
    UnknownTag {
        /// The family.
        family: TagFamily,
        /// The number.
        id: u32,
        /// The last one there is.
        last: u32,
    },
    /// Nothing to print.
    #[error("no tag is asked for")]
    NoTags,
    /// A length that cannot be that of a ruler.
    #[error("{measured_mm} mm cannot be the ruler of 200 mm: 150 to 250 mm are believed")]
    Measured {
        /// What was measured, mm.
        measured_mm: f64,
    },
}

impl Paper {
    /// All sizes that are known.
    pub const ALL: [Self; 7] = [
        Self { name: "A4", width_mm: 210.0, height_mm: 297.0 },
        Self { name: "A3", width_mm: 297.0, height_mm: 420.0 },
        Self { name: "A2", width_mm: 420.0, height_mm: 594.0 },
        Self { name: "A1", width_mm: 594.0, height_mm: 841.0 },
        Self { name: "A0", width_mm: 841.0, height_mm: 1189.0 },
        Self { name: "letter", width_mm: 215.9, height_mm: 279.4 },
        Self { name: "ledger", width_mm: 279.4, height_mm: 431.8 },
    ];

    /// The paper with this name, in large or small letters.
    ///
    /// # Errors
    /// [`SheetError::UnknownPaper`].
    pub fn named(name: &str) -> Result<Self, SheetError> {
        let is_it = |paper: &&Self| paper.name.eq_ignore_ascii_case(name);
        Self::ALL.iter().find(is_it).copied().ok_or_else(|| SheetError::UnknownPaper(name.into()))
    }

    /// The largest edge of the black square that fits with its white margin, in whole 5 mm.
    #[must_use]
    pub fn largest_edge_mm(&self, family: TagFamily) -> f64 {
        let room_mm = (self.width_mm - 2.0 * BORDER_MM - SIDE_STRIP_MM)
            .min(self.height_mm - 2.0 * BORDER_MM - TOP_STRIP_MM - BOTTOM_STRIP_MM);
        let n_cells = f64::from(family.n_cells());
        (room_mm * n_cells / (n_cells + 2.0) / 5.0).floor() * 5.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A4: 210 − 10 − 12 = 188 mm for ten cells of 36h11, eight of which are the edge: 150.4 mm.
    #[test]
    fn the_largest_tag_of_a4_is_150_mm() {
        let a4 = Paper::named("a4").unwrap();
        assert!((a4.largest_edge_mm(TagFamily::Tag36h11) - 150.0).abs() < 1e-9);
        assert!(Paper::named("foolscap").is_err());
    }
}
