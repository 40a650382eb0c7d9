//! Measured edges, put into a file that `markers survey --constraints` reads.

use super::constraints::{ConstraintError, Constraints, TagName};
use atomic_write_file::AtomicWriteFile;
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use toml_edit::{Array, ArrayOfTables, DocumentMut, Item, Table, value};

/// Notes that these tags measure so much; what the file said of them before goes, all else stays. A file that is not there
/// is made.
///
/// # Errors
/// A file that cannot be read or replaced, or that is no file of constraints.
pub fn note_edges(path: &Path, tags: &[TagName], edge_m: f64) -> Result<(), ConstraintError> {
    let unreadable = |source| ConstraintError::Unreadable { path: path.to_owned(), source };
    let text = match std::fs::read_to_string(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
        read => read.map_err(unreadable)?,
    };
    Constraints::parse(&text, path)?;
    let noted = with_edges(&text, tags, edge_m)
        .map_err(|error| unreadable(io::Error::new(ErrorKind::InvalidData, error)))?;
    // What was written must be what was meant; `edges = […]` on one line takes no more sections.
    let read = Constraints::parse(&noted, path)?;
    let is_noted = |tag: &TagName| read.edge_m(*tag).is_some_and(|m| (m - edge_m).abs() < 1e-4);
    if !tags.iter().all(is_noted) {
        let text = "the edges must stand as [[edges]] sections";
        return Err(unreadable(io::Error::new(ErrorKind::InvalidData, text)));
    }
    replace(path, &noted).map_err(unreadable)
}

fn with_edges(text: &str, tags: &[TagName], edge_m: f64) -> Result<String, toml_edit::TomlError> {
    let mut document: DocumentMut = text.parse()?;
    let names: Vec<String> = tags.iter().map(ToString::to_string).collect();
    let edges =
        document.entry("edges").or_insert_with(|| Item::ArrayOfTables(ArrayOfTables::new()));
    if let Some(edges) = edges.as_array_of_tables_mut() {
        for section in edges.iter_mut() {
            if let Some(listed) = section.get_mut("tags").and_then(Item::as_array_mut) {
                listed.retain(|tag| tag.as_str().is_none_or(|tag| !names.iter().any(|n| n == tag)));
            }
        }
        edges.retain(|section| {
            section.get("tags").and_then(Item::as_array).is_none_or(|listed| !listed.is_empty())
        });
        let mut section = Table::new();
        section["tags"] = value(names.iter().collect::<Array>());
        section["edge_m"] = value((1e5 * edge_m).round() / 1e5);
        edges.push(section);
    }
    Ok(document.to_string())
}

/// Mode and owner stay; a power cut leaves the old file or the new one.
fn replace(path: &Path, text: &str) -> io::Result<()> {
    let mut file = AtomicWriteFile::open(path)?;
    file.write_all(text.as_bytes())?;
    file.commit()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::TagFamily;

    fn tags(ids: &[u32]) -> Vec<TagName> {
        ids.iter().map(|id| TagName::new(TagFamily::Tag36h11, *id)).collect()
    }

    #[test]
    fn measured_edges_are_what_a_survey_reads() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("constraints.toml");
        let edge_m = |id| Constraints::read(&path).unwrap().edge_m(tags(&[id])[0]);
        note_edges(&path, &tags(&[0, 1, 2]), 0.14962).unwrap();
        note_edges(&path, &tags(&[7]), 0.2993).unwrap();
        assert_eq!([0, 2, 7, 8].map(edge_m), [Some(0.14962), Some(0.14962), Some(0.2993), None]);
        // One sheet was printed anew, and later all of them.
        note_edges(&path, &tags(&[1]), 0.15).unwrap();
        assert_eq!([0, 1, 2].map(edge_m), [Some(0.14962), Some(0.15), Some(0.14962)]);
        note_edges(&path, &tags(&[0, 1, 2]), 0.1501).unwrap();
        assert_eq!(
            [0, 1, 2, 7].map(edge_m),
            [Some(0.1501), Some(0.1501), Some(0.1501), Some(0.2993)]
        );
        assert_eq!(Constraints::read(&path).unwrap().edges.len(), 2);
    }

    #[test]
    fn tapes_and_comments_stay_and_nonsense_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("constraints.toml");
        let tape = "# Taped on Monday.\n[[tapes]]\nfrom = \"36h11:0\"\nto = \"36h11:9\"\n\
                    distance_m = 4.5\nsigma_m = 0.003\n";
        std::fs::write(&path, tape).unwrap();
        note_edges(&path, &tags(&[3]), 0.2).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with(tape), "{text}");
        assert_eq!(Constraints::read(&path).unwrap().edges[0].tags, tags(&[3]));
        std::fs::write(&path, "tags = 3").unwrap();
        assert!(note_edges(&path, &tags(&[3]), 0.2).is_err());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "tags = 3");
        assert!(note_edges(&folder.path().join("new.toml"), &tags(&[3]), f64::NAN).is_err());
    }
}
