//! What a tag looks like: its black and white cells.

mod codes;

use super::TagFamily;

/// The cells of one tag, from the outer edge of its black border inwards.
///
/// ```text
///  col 0        n−1
///    ■ ■ ■ ■ ■ ■   row 0, the top of the upright tag
///    ■ □ ■ ■ □ ■
///    ■ ■ □ □ □ ■   detectors put the corners on the outer edge of the black border;
///    ■ □ □ ■ ■ ■   around it a white margin of at least one cell belongs to the tag
///    ■ ■ □ ■ □ ■
///    ■ ■ ■ ■ ■ ■   row n−1
/// ```
///
/// Checked: `the_detector_reads_every_pattern`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TagPattern {
    n_cells: u8,
    /// White cells by row, bit `col`.
    rows: [u16; MAX_CELLS],
}

/// Cells along the border of the largest family.
const MAX_CELLS: usize = 8;

impl TagPattern {
    /// The tag with this number; `None` if the family has no such tag.
    #[must_use]
    pub fn new(family: TagFamily, id: u32) -> Option<Self> {
        let index = usize::try_from(id).ok()?;
        let (codes, bits): (&[u64], &[(u8, u8)]) = match family {
            TagFamily::Tag36h11 => (&codes::CODES_36H11, &codes::BITS_36H11),
            TagFamily::Tag25h9 => (&codes::CODES_25H9, &codes::BITS_25H9),
            TagFamily::Tag16h5 => (&codes::CODES_16H5, &codes::BITS_16H5),
        };
        let code = *codes.get(index)?;
        let mut rows = [0_u16; MAX_CELLS];
        for (i, &(col, row)) in bits.iter().enumerate() {
            let is_white = code >> (bits.len() - 1 - i) & 1 == 1;
            rows[usize::from(row)] |= u16::from(is_white) << col;
        }
        Some(Self { n_cells: family.n_cells(), rows })
    }

    /// Cells along one side, the black border included.
    #[must_use]
    pub const fn n_cells(&self) -> u8 {
        self.n_cells
    }

    /// True for a white cell; outside of the border everything is white.
    #[must_use]
    pub fn is_white(&self, col: i32, row: i32) -> bool {
        let inside = 0..i32::from(self.n_cells);
        if !inside.contains(&col) || !inside.contains(&row) {
            return true;
        }
        let row = usize::try_from(row).unwrap_or(0);
        self.rows[row] >> col & 1 == 1
    }
}

impl TagFamily {
    /// Cells along one side of a tag, the black border included.
    #[must_use]
    pub const fn n_cells(self) -> u8 {
        match self {
            Self::Tag36h11 => 8,
            Self::Tag25h9 => 7,
            Self::Tag16h5 => 6,
        }
    }

    /// How many tags the family has.
    #[must_use]
    pub const fn n_tags(self) -> u32 {
        match self {
            Self::Tag36h11 => 587,
            Self::Tag25h9 => 35,
            Self::Tag16h5 => 30,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn families_end_where_their_tables_do() {
        for family in [TagFamily::Tag36h11, TagFamily::Tag25h9, TagFamily::Tag16h5] {
            assert!(TagPattern::new(family, family.n_tags() - 1).is_some());
            assert!(TagPattern::new(family, family.n_tags()).is_none());
        }
    }

    /// Drawn by hand from the code 0x27c8 and the places of its bits in `tag16h5.c`.
    #[test]
    fn tag16h5_0_looks_as_drawn_by_hand() {
        // 0010 0111 1100 1000: bits 2, 5, 6, 7, 8, 9 and 12 are white.
        let expected = ["......", "...#..", "...##.", "....#.", ".#.##.", "......"];
        let pattern = TagPattern::new(TagFamily::Tag16h5, 0).unwrap();
        for (row, line) in (0..).zip(expected) {
            for (col, cell) in (0..).zip(line.chars()) {
                assert_eq!(pattern.is_white(col, row), cell == '#', "{col}, {row}");
            }
        }
        assert!(pattern.is_white(-1, 3) && pattern.is_white(3, 6));
    }
}
