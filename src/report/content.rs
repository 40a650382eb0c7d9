//! A report's content in the order of reading, before it becomes pages or HTML.

use super::verdict::Verdict;

/// One part of a report.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Part {
    /// The result in large letters.
    Headline(Headline),
    /// A heading over what follows.
    Heading(String),
    /// A heading within it.
    Subheading(String),
    /// A text.
    Text(String),
    /// Texts of equal rank.
    List(Vec<String>),
    /// Rows and columns.
    Table(Table),
    /// Parts of wholes as bars.
    Bars(Bars),
    /// Pictures, each with a line below it.
    Pictures(Vec<Picture>),
    /// Lines to sign on, with what stands below each.
    Signatures(Vec<String>),
    /// What follows begins on a page of its own.
    NewPage,
}

/// The result in large letters.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Headline {
    /// What was measured.
    pub(super) name: String,
    /// V ± U.
    pub(super) volume: String,
    /// The mass ± its U.
    pub(super) mass: Option<String>,
    /// What becomes of it.
    pub(super) verdict: Verdict,
}

/// Where a column's texts stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// Words.
    Left,
    /// Numbers.
    Right,
}

/// A column of a table.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Column {
    pub(super) title: &'static str,
    pub(super) side: Side,
    /// Its share of the width, in relation to the others.
    pub(super) weight: f64,
}

/// Rows and columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    pub(super) columns: Vec<Column>,
    pub(super) rows: Vec<Vec<String>>,
}

/// Wholes and their parts as bars of colours.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Bars {
    /// What the colours mean.
    pub(super) parts: Vec<(&'static str, Tone)>,
    /// Each bar: its label, the lengths of its parts (1 is the full width), and what stands behind.
    pub(super) rows: Vec<(String, Vec<f64>, String)>,
}

/// A colour with a meaning: the same ones as in the pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tone {
    /// Measured; good.
    Green,
    /// Interpolated; to be looked at.
    Sky,
    /// Unseen.
    Orange,
    /// Disturbed; bad.
    Red,
    /// A quantity.
    Blue,
}

impl Tone {
    /// Red, green, blue (Okabe and Ito 2008).
    pub(super) const fn rgb(self) -> (u8, u8, u8) {
        match self {
            Self::Green => (0, 158, 115),
            Self::Sky => (86, 180, 233),
            Self::Orange => (230, 159, 0),
            Self::Red => (213, 94, 0),
            Self::Blue => (0, 114, 178),
        }
    }
}

/// A picture with a line below it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Picture {
    /// The picture, SVG.
    pub(super) svg: String,
    /// What it shows.
    pub(super) caption: String,
}

/// A report, ready to be set.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Content {
    /// What the report is of.
    pub(super) title: String,
    /// When it was measured, by which file.
    pub(super) subtitle: String,
    /// Below every page.
    pub(super) footer: String,
    /// The parts in their order.
    pub(super) parts: Vec<Part>,
}

impl Column {
    pub(super) const fn words(title: &'static str, weight: f64) -> Self {
        Self { title, side: Side::Left, weight }
    }

    pub(super) const fn numbers(title: &'static str, weight: f64) -> Self {
        Self { title, side: Side::Right, weight }
    }
}
