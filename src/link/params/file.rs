//! Parameter files as ground stations write them.
//!
//! `.params` of QGroundControl has vehicle, component, name, value and type between tabs; `.parm`
//! of Mission Planner and MAVProxy has name and value, between blanks or a comma, and no type: it
//! is taken from the autopilot. `#` begins a comment in both.
//!
//! Some values are the owner's to choose, by his battery, but must be chosen: a comment of the form
//! `# demand BATT_CRT_VOLT or BATT_CRT_MAH above 0` asks for one of them. Other programs pass over it.

use super::value::{Kind, Value};

/// How a demand begins.
const DEMAND: &str = "# demand ";
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
    /// What it asks of parameters whose values it leaves open.
    pub demands: Vec<Demand>,
}

/// One of these parameters must be larger than a number.
#[derive(Debug, Clone, PartialEq)]
pub struct Demand {
    /// The parameters; at least one.
    pub names: Vec<String>,
    /// The number.
    pub above: f32,
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
    /// A demand that cannot be understood would never be checked.
    #[error("line {line}: {text:?} is no demand: # demand NAME or NAME above NUMBER")]
    Demand {
        /// Counted from 1.
        line: usize,
        /// What stands there.
        text: String,
    },
}

impl ParamFile {
    /// Reads either form.
    ///
    /// # Errors
    /// The first line that cannot be understood, a name that stands twice, or an empty file.
    pub fn parse(text: &str) -> Result<Self, FileError> {
        let mut lines: Vec<Line> = Vec::new();
        let mut demands = Vec::new();
        for (index, row) in text.lines().enumerate() {
            let number = index + 1;
            if let Some(demand) = row.trim().strip_prefix(DEMAND) {
                let no_demand = || FileError::Demand { line: number, text: row.to_owned() };
                demands.push(parse_demand(demand).ok_or_else(no_demand)?);
            }
            let row = row.split('#').next().unwrap_or("").trim();
            if row.is_empty() {
                continue;
            }
            let line = parse_line(row)
                .ok_or_else(|| FileError::Line { line: number, text: row.to_owned() })?;
            if lines.iter().any(|other| other.name == line.name) {
                return Err(FileError::Twice { line: number, name: line.name });
            }
            lines.push(line);
        }
        if lines.is_empty() { Err(FileError::Empty) } else { Ok(Self { lines, demands }) }
    }
}

fn parse_line(row: &str) -> Option<Line> {
    let fields: Vec<&str> = row.split([' ', '\t', ',']).filter(|field| !field.is_empty()).collect();
    let (name, text, kind) = match fields[..] {
        [_, _, name, text, kind] => (name, text, Some(Kind::from_number(kind.parse().ok()?)?)),
        [name, text] => (name, text, None),
        _ => return None,
    };
    // Without a type any finite number will do for now.
    Value::parse(text, kind.unwrap_or(Kind::Real32))?;
    is_name(name).then(|| Line { name: name.to_owned(), text: text.to_owned(), kind })
}

fn parse_demand(text: &str) -> Option<Demand> {
    let (names, above) = text.split_once(" above ")?;
    let names: Vec<String> = names.split(" or ").map(|name| name.trim().to_owned()).collect();
    let above = above.trim().parse().ok().filter(|above: &f32| above.is_finite())?;
    names.iter().all(|name| is_name(name)).then_some(Demand { names, above })
}

fn is_name(name: &str) -> bool {
    (1..=NAME_LETTERS).contains(&name.len())
        && name.chars().all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_')
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
    fn what_is_the_owners_to_choose_is_demanded() {
        let text = "# demand BATT_CRT_VOLT or BATT_CRT_MAH above 0\nVISO_TYPE 1\n";
        let file = ParamFile::parse(text).unwrap();
        assert_eq!(file.lines.len(), 1);
        assert_eq!(file.demands.len(), 1);
        assert_eq!(file.demands[0].names, ["BATT_CRT_VOLT", "BATT_CRT_MAH"]);
        assert!(file.demands[0].above.abs() < f32::EPSILON);
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
            ("A 1\n# demand B at least 1", "line 2"),
            ("# demand b above 1\nA 1", "is no demand"),
            ("# demand B above none\nA 1", "is no demand"),
        ] {
            let error = ParamFile::parse(text).unwrap_err().to_string();
            assert!(error.contains(word), "{text:?}: {error}");
        }
    }
}
