//! What holds a survey of markers beside its frames: a file of its own.
//!
//! ```toml
//! # Corners that somebody measured: lower left, lower right, upper right, upper left.
//! [[known]]
//! tag = "36h11:0"
//! corners_m = [[22.0, 10.25, 2.0], [22.0, 9.75, 2.0], [22.0, 9.75, 2.5], [22.0, 10.25, 2.5]]
//! sigma_m = 0.003
//!
//! # Distances between the middles of two tags; with check = true it is compared and not used.
//! [[tapes]]
//! from = "36h11:0"
//! to = "36h11:17"
//! distance_m = 18.432
//! sigma_m = 0.003
//! check = false
//!
//! # What the rulers of the sheets told; `markers print --edges` writes it.
//! [[edges]]
//! tags = ["36h11:0", "36h11:1"]
//! edge_m = 0.1496
//! ```

use crate::messages::TagFamily;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// A tag's family and number, written `36h11:7`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TagName {
    /// The family.
    pub family: TagFamily,
    /// The number.
    pub id: u32,
}

impl TagName {
    /// The name of this tag.
    #[must_use]
    pub const fn new(family: TagFamily, id: u32) -> Self {
        Self { family, id }
    }
}

impl fmt::Display for TagName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.family.name(), self.id)
    }
}

impl FromStr for TagName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refuse = || format!("{text:?} is no tag such as 36h11:7");
        let (family, id) = text.split_once(':').ok_or_else(refuse)?;
        let family = TagFamily::from_name(family).ok_or_else(refuse)?;
        let id = id.parse().map_err(|_| refuse())?;
        Ok(Self { family, id })
    }
}

impl Serialize for TagName {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for TagName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// A tag whose corners somebody measured.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnownSection {
    /// Which.
    pub tag: TagName,
    /// Its corners, m.
    pub corners_m: [[f64; 3]; 4],
    /// σ of each corner, each axis, m.
    pub sigma_m: f64,
}

/// A distance between the middles of two tags.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TapeSection {
    /// From this tag.
    pub from: TagName,
    /// To this one.
    pub to: TagName,
    /// Measured, m.
    pub distance_m: f64,
    /// Its σ, m.
    pub sigma_m: f64,
    /// It is compared and not used.
    #[serde(default)]
    pub check: bool,
}

/// What tags really measure.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EdgesSection {
    /// Which tags.
    pub tags: Vec<TagName>,
    /// Edge of the black square, m.
    pub edge_m: f64,
}

/// The whole file.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Constraints {
    /// Known places.
    pub known: Vec<KnownSection>,
    /// Distances.
    pub tapes: Vec<TapeSection>,
    /// Sizes.
    pub edges: Vec<EdgesSection>,
}

/// Constraints that cannot be.
#[derive(Debug, thiserror::Error)]
pub enum ConstraintError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    Unreadable {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is no such file.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        source: toml::de::Error,
    },
    /// A number that cannot be.
    #[error("{what} is {value}, it must be positive and finite")]
    Number {
        /// Of what.
        what: String,
        /// The number.
        value: f64,
    },
    /// A tape from a tag to itself.
    #[error("a tape goes from tag {0} to itself")]
    SameTag(TagName),
    /// A tag that is to be trusted and has no place.
    #[error("tag {0} is to be trusted, but it is not in the log's configuration")]
    NotMapped(TagName),
}

impl Constraints {
    /// Reads a file.
    ///
    /// # Errors
    /// An unreadable file, unknown keys, numbers that cannot be.
    pub fn read(path: &Path) -> Result<Self, ConstraintError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| ConstraintError::Unreadable { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// What stands in the text of a file.
    pub(super) fn parse(text: &str, path: &Path) -> Result<Self, ConstraintError> {
        let constraints: Self = toml::from_str(text)
            .map_err(|source| ConstraintError::File { path: path.to_owned(), source })?;
        constraints.checked()
    }

    fn checked(self) -> Result<Self, ConstraintError> {
        let positive = |what: String, value: f64| {
            let is_good = value.is_finite() && value > 0.0;
            if is_good { Ok(()) } else { Err(ConstraintError::Number { what, value }) }
        };
        for known in &self.known {
            positive(format!("sigma_m of {}", known.tag), known.sigma_m)?;
        }
        for tape in &self.tapes {
            if tape.from == tape.to {
                return Err(ConstraintError::SameTag(tape.from));
            }
            let name = format!("of the tape from {} to {}", tape.from, tape.to);
            positive(format!("distance_m {name}"), tape.distance_m)?;
            positive(format!("sigma_m {name}"), tape.sigma_m)?;
        }
        for edges in &self.edges {
            positive("edge_m".to_owned(), edges.edge_m)?;
        }
        Ok(self)
    }

    /// All tags that are named as known or by a tape.
    pub(super) fn names(&self) -> impl Iterator<Item = TagName> {
        let known = self.known.iter().map(|known| known.tag);
        known.chain(self.tapes.iter().flat_map(|tape| [tape.from, tape.to]))
    }

    /// The edge of a tag: as told, or as its known corners have it.
    pub(super) fn edge_m(&self, name: TagName) -> Option<f64> {
        let told = self.edges.iter().find(|edges| edges.tags.contains(&name));
        let of_corners = || {
            let known = self.known.iter().find(|known| known.tag == name)?;
            let [a, b, ..] = known.corners_m.map(nalgebra::Vector3::from);
            Some((b - a).norm())
        };
        told.map(|edges| edges.edge_m).or_else(of_corners)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_and_nonsense_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tapes.toml");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            Constraints::read(&path)
        };
        let tape =
            "[[tapes]]\nfrom = \"36h11:0\"\nto = \"16h5:3\"\ndistance_m = 4.5\nsigma_m = 0.003\n";
        let constraints = read(tape).unwrap();
        assert_eq!(constraints.tapes[0].to, TagName::new(TagFamily::Tag16h5, 3));
        assert!(!constraints.tapes[0].check);
        let refusal = |text: &str| read(text).unwrap_err().to_string();
        assert!(refusal(&tape.replace("16h5:3", "36h11:0")).contains("itself"));
        assert!(refusal(&tape.replace("0.003", "0.0")).contains("sigma_m"));
        assert!(refusal(&tape.replace("36h11:0", "36h11-0")).contains("36h11:7"));
        assert!(refusal(&tape.replace("sigma_m", "sigma")).contains("sigma"));
    }
}
