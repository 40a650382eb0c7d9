//! Parameter files as ground stations write them.
//!
//! `.params` of QGroundControl has vehicle, component, name, value and type between tabs; `.parm`
//! of Mission Planner and MAVProxy has name and value, between blanks or a comma, and no type: it
//! is taken from the autopilot. `#` begins a comment in both.

use super::value::{Kind, Value};

/// Letters in a parameter's name.
const NAME_LETTERS: usize = 16;

/// What a line asks for.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// The parameter.
    pub name: String,
    /// Its value, as written.
    pub text: String,
    /// Its type, if the file has types.
    pub kind: Option<Kind>,
}

/// A whole file.
#[derive(Debug, Clone, PartialEq)]
pub struct ParamFile {
    /// Its parameters, in the file's order; each name once.
    pub lines: Vec<Line>,
}

/// What is wrong with a file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FileError {
    /// A line is neither a parameter nor a comment.
    #[error("line {line}: {text:?} is no parameter")]
    Line {
        /// Counted from 1.
        line: usize,
        /// What stands there.
        text: String,
    },
    /// A name stands twice.
    #[error("line {line}: {name} stands twice")]
    Twice {
        /// Counted from 1.
        line: usize,
        /// Which.
        name: String,
    },
    /// There is no parameter in it.
    #[error("the file holds no parameter")]
    Empty,
}

impl ParamFile {
    /// Reads either form.
    ///
    /// # Errors
    /// The first line that cannot be understood, a name that stands twice, or an empty file.
    pub fn parse(text: &str) -> Result<Self, FileError> {
        let mut lines: Vec<Line> = Vec::new();
        for (index, row) in text.lines().enumerate() {
            let row = row.split('#').next().unwrap_or("").trim();
            if row.is_empty() {
                continue;
            }
            let number = index + 1;
            let line = parse_line(row)
                .ok_or_else(|| FileError::Line { line: number, text: row.to_owned() })?;
            if lines.iter().any(|other| other.name == line.name) {
                return Err(FileError::Twice { line: number, name: line.name });
            }
            lines.push(line);
        }
        if lines.is_empty() { Err(FileError::Empty) } else { Ok(Self { lines }) }
    }
}

fn parse_line(row: &str) -> Option<Line> {
    let fields: Vec<&str> = row.split([' ', '\t', ',']).filter(|field| !field.is_empty()).collect();
    let (name, text, kind) = match fields[..] {
        [_, _, name, text, kind] => (name, text, Some(Kind::from_number(kind.parse().ok()?)?)),
        [name, text] => (name, text, None),
        _ => return None,
    };
    let is_name = name.len() <= NAME_LETTERS
        && name.chars().all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_');
    // Without a type any finite number will do for now.
    Value::parse(text, kind.unwrap_or(Kind::Real32))?;
    is_name.then(|| Line { name: name.to_owned(), text: text.to_owned(), kind })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_forms_are_read() {
        let px4 = "# Onboard parameters\n1\t1\tEKF2_EV_CTRL\t15\t6\n1\t1\tEKF2_EV_DELAY\t10.0\t9\n";
        let file = ParamFile::parse(px4).unwrap();
        assert_eq!(file.lines[0].kind, Some(Kind::Int32));
        assert_eq!(
            (file.lines[1].name.as_str(), file.lines[1].text.as_str()),
            ("EKF2_EV_DELAY", "10.0")
        );
        let ardupilot =
            "VISO_TYPE,1 # MAVLink\nEK3_SRC1_POSXY 6\n\n# nothing\nGUID_TIMEOUT   1.0\r\n";
        let file = ParamFile::parse(ardupilot).unwrap();
        let names: Vec<_> = file.lines.iter().map(|line| line.name.as_str()).collect();
        assert_eq!(names, ["VISO_TYPE", "EK3_SRC1_POSXY", "GUID_TIMEOUT"]);
        assert!(file.lines.iter().all(|line| line.kind.is_none()));
    }

    #[test]
    fn damaged_files_name_the_line() {
        for (text, word) in [
            ("A 1\nB", "line 2"),
            ("A 1\nA 2", "A stands twice"),
            ("A one", "line 1"),
            ("a 1", "line 1"),
            ("1\t1\tA\t1.5\t6", "line 1"),
            ("1\t1\tA\t1\t7", "line 1"),
            ("ABCDEFGHIJKLMNOPQ 1", "line 1"),
            ("# only this", "no parameter"),
        ] {
            let error = ParamFile::parse(text).unwrap_err().to_string();
            assert!(error.contains(word), "{text:?}: {error}");
        }
    }
}
