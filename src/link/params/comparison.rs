//! What a file wants beside what an autopilot has.

use super::file::{Demand, Line};
use super::value::{Kind, Value};
use std::fmt;

/// A line of a file, judged.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The parameter.
    pub name: String,
    /// What the file wants, as written.
    pub wanted: String,
    /// What the autopilot has; `None` if it does not know the name.
    pub found: Option<(Kind, Value)>,
    /// What is wrong; `None` if nothing is.
    pub problem: Option<Problem>,
}

/// What is wrong with a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Problem {
    /// The autopilot does not know the name: another firmware or version.
    Unknown,
    /// The autopilot has it as another type than the file says.
    OtherType,
    /// The wanted number does not fit the autopilot's type.
    DoesNotFit,
    /// The value differs.
    Differs,
    /// None of the parameters that can do it is set: they are the owner's to choose.
    NotChosen,
    /// The value is the wanted one, written by a tool that does not know the encoding.
    WrongEncoding,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unknown => "unknown to the autopilot: another firmware or version",
            Self::OtherType => "of another type on the autopilot: another firmware or version",
            Self::DoesNotFit => "the wanted value does not fit the autopilot's type",
            Self::Differs => "differs",
            Self::NotChosen => "not chosen yet: the file's page says how",
            Self::WrongEncoding => {
                "differs: written by a tool that mixes up numbers and their bits"
            }
        })
    }
}

/// Judges one line against what the autopilot has.
#[must_use]
pub fn compare(line: &Line, found: Option<(Kind, Value)>) -> Comparison {
    Comparison {
        name: line.name.clone(),
        wanted: line.text.clone(),
        found,
        problem: problem(line, found),
    }
}

/// Judges a demand by what the autopilot has under its names, in their order.
#[must_use]
pub fn compare_demand(demand: &Demand, found: &[Option<(Kind, Value)>]) -> Comparison {
    let is_above = |value: &Option<(Kind, Value)>| {
        value.is_some_and(|(_, value)| value.as_f64() > f64::from(demand.above))
    };
    // The one that holds is told, otherwise the first that is there.
    let told = found.iter().find(|value| is_above(value));
    let told = told.or_else(|| found.iter().find(|value| value.is_some())).copied().flatten();
    let problem = match told {
        None => Some(Problem::Unknown),
        told if is_above(&told) => None,
        Some(_) => Some(Problem::NotChosen),
    };
    Comparison {
        name: demand.names.join(" or "),
        wanted: format!("above {}", demand.above),
        found: told,
        problem,
    }
}

fn problem(line: &Line, found: Option<(Kind, Value)>) -> Option<Problem> {
    let Some((kind, value)) = found else { return Some(Problem::Unknown) };
    if line.kind.is_some_and(|wanted| wanted != kind) {
        return Some(Problem::OtherType);
    }
    let Some(wanted) = Value::parse(&line.text, kind) else { return Some(Problem::DoesNotFit) };
    if wanted == value {
        None
    } else if value.is_reinterpreted(wanted) {
        Some(Problem::WrongEncoding)
    } else {
        Some(Problem::Differs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(kind: Option<Kind>, text: &str, found: Option<(Kind, Value)>) -> Option<Problem> {
        let line = Line { name: "A".to_owned(), text: text.to_owned(), kind };
        compare(&line, found).problem
    }

    #[test]
    fn every_kind_of_mistake_has_its_name() {
        let whole = |value| Some((Kind::Int32, Value::Whole(value)));
        let real = |value| Some((Kind::Real32, Value::Real(value)));
        assert_eq!(judged(Some(Kind::Int32), "15", whole(15)), None);
        assert_eq!(judged(None, "15", whole(15)), None);
        assert_eq!(judged(None, "0.2", real(0.2)), None);
        assert_eq!(judged(None, "15", None), Some(Problem::Unknown));
        assert_eq!(judged(Some(Kind::Int32), "15", real(15.0)), Some(Problem::OtherType));
        assert_eq!(judged(None, "1.5", whole(1)), Some(Problem::DoesNotFit));
        assert_eq!(judged(Some(Kind::Int32), "15", whole(3)), Some(Problem::Differs));
        // 15.0 as bits is 1097859072.
        let bits = Some(Problem::WrongEncoding);
        assert_eq!(judged(Some(Kind::Int32), "15", whole(1_097_859_072)), bits);
        assert_eq!(judged(None, "10", real(f32::from_bits(10))), bits);
        // 0 has the same bits either way, so nothing can be mixed up.
        assert_eq!(judged(None, "0", whole(4)), Some(Problem::Differs));
        assert_eq!(judged(None, "4", whole(0)), Some(Problem::Differs));
    }
}
