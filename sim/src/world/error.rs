//! What can be wrong with a world.

/// Why a world could not be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WorldError {
    /// A header entry is missing or not a number.
    #[error("line {line}: expected `{key}` and a number, found {found:?}")]
    BadHeader {
        /// Line in the file, from 1.
        line: usize,
        /// The entry that was expected.
        key: &'static str,
        /// What stands there.
        found: String,
    },
    /// A height is not a number.
    #[error("line {line}: {found:?} is not a height")]
    BadHeight {
        /// Line in the file, from 1.
        line: usize,
        /// What stands there.
        found: String,
    },
    /// A cell has no data; a hole has no surface that a ray could hit.
    #[error("line {line}: a cell has no data ({nodata}); fill holes before use")]
    NoData {
        /// Line in the file, from 1.
        line: usize,
        /// The file's mark for it.
        nodata: f64,
    },
    /// More or fewer heights than the header promises.
    #[error("line {line}: {found} heights so far, the header promises {expected}")]
    WrongCount {
        /// Line in the file where it showed, from 1.
        line: usize,
        /// Number of heights read.
        found: usize,
        /// Columns times rows.
        expected: usize,
    },
    /// A field that is no surface.
    #[error("a height field needs at least 2 × 2 finite heights from 0 up and a pitch above 0 m")]
    BadField,
}
