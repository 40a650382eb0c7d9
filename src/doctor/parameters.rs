//! The autopilot's parameters beside a file's, as lines of the table.

use super::{Check, Verdict};
use crate::link::params::{Comparison, LiveAutopilot, LiveError, ParamFile};
use crate::link::signing::WallClock;
use crate::link::{Guard, Settings};
use crate::service::clock::Clock;
use std::path::Path;

/// Reads every parameter of the file from the autopilot; nothing else may use the link meanwhile.
pub(super) async fn check(path: &Path, link: &Settings, clock: Clock) -> Vec<Check> {
    let subject = "parameters";
    let bad =
        |found: String, cure: &str| vec![Check::with_cure(subject, Verdict::Bad, found, cure)];
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) => {
            return bad(format!("{}: {error}", path.display()), "name a file that is there");
        }
    };
    let file = match ParamFile::parse(&text) {
        Ok(file) => file,
        Err(error) => {
            return bad(
                format!("{}: {error}", path.display()),
                "see firmware-params/ for the two forms",
            );
        }
    };
    let wall = clock.clone();
    let guard = match Guard::open(&link.security, WallClock::new(move || wall.since_1970())) {
        Ok(guard) => guard,
        Err(error) => return bad(error.to_string(), "mend link.signing"),
    };
    match compared(&file, link, guard, clock).await {
        Ok(comparisons) => judge(&comparisons, path),
        Err(error) => bad(error.to_string(), "mend the autopilot's line first"),
    }
}

async fn compared(
    file: &ParamFile,
    link: &Settings,
    guard: Guard,
    clock: Clock,
) -> Result<Vec<Comparison>, LiveError> {
    LiveAutopilot::find(&link.address, guard, clock).await?.compare(file).await
}

/// One line for each that is wrong, or one for all.
fn judge(comparisons: &[Comparison], path: &Path) -> Vec<Check> {
    let wrong = comparisons.iter().filter_map(|comparison| {
        let problem = comparison.problem?;
        let found = comparison.found.map_or_else(|| "-".to_owned(), |(_, value)| value.to_string());
        let cure =
            format!("`stockpilot params write {}`, then reboot the autopilot", path.display());
        Some(Check::with_cure(
            format!("parameter {}", comparison.name),
            Verdict::Bad,
            format!("{found}, wanted {}: {problem}", comparison.wanted),
            cure,
        ))
    });
    let mut checks: Vec<Check> = wrong.collect();
    if checks.is_empty() {
        let found = format!("all {} as in {}", comparisons.len(), path.display());
        checks.push(Check::good("parameters", found));
    }
    checks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::params::{Kind, Value, compare};

    #[test]
    fn each_wrong_parameter_has_a_line_with_its_cure() {
        let file = ParamFile::parse("EKF2_EV_CTRL 15\nEKF2_HGT_REF 3\n").unwrap();
        let has = |ev_ctrl| {
            let found = [(Kind::Int32, Value::Whole(ev_ctrl)), (Kind::Int32, Value::Whole(3))];
            std::iter::zip(&file.lines, found).map(|(l, f)| compare(l, Some(f))).collect::<Vec<_>>()
        };
        let checks = judge(&has(0), Path::new("indoor.params"));
        assert_eq!(checks.len(), 1);
        assert_eq!(checks[0].verdict, Verdict::Bad);
        assert!(
            checks[0].subject.contains("EKF2_EV_CTRL") && checks[0].found.contains("wanted 15")
        );
        assert!(checks[0].cure.as_ref().unwrap().contains("params write indoor.params"));
        let checks = judge(&has(15), Path::new("indoor.params"));
        assert_eq!((checks.len(), checks[0].verdict), (1, Verdict::Good));
    }
}
