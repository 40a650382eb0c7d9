//! The history as people read it.

use super::HistoryLine;
use crate::mapping::statement::Statement;
use std::fmt::Write as _;

/// One line for each volume.
#[must_use]
pub fn history_table(lines: &[HistoryLine]) -> String {
    let name = |line: &HistoryLine| format!("{}, {}", line.hall, line.bay);
    let width = lines.iter().map(|line| name(line).chars().count()).max().unwrap_or(0);
    let mut table = String::new();
    for line in lines {
        let when =
            line.started_utc.as_deref().map_or("time unknown", |utc| &utc[..utc.len().min(19)]);
        // Writing into a text cannot fail.
        let _ok = write!(
            table,
            "{when:19}  {:width$}  {}",
            name(line),
            stated(Statement::of_volume(line.volume_m3, 0.5 * line.volume_expanded_m3))
        );
        if let (Some(mass_t), Some(expanded_t)) = (line.mass_t, line.mass_expanded_t) {
            let _ok = write!(table, ", {}", stated(Statement::of_mass(mass_t, 0.5 * expanded_t)));
        }
        if let (Some(change_m3), Some(expanded_m3)) = (line.change_m3, line.change_expanded_m3) {
            let verdict = match line.change_is_significant {
                Some(true) => "significant",
                _ => "within noise",
            };
            let change = stated(Statement::of_volume(change_m3, 0.5 * expanded_m3));
            let _ok = write!(table, "; change {change}, {verdict}");
        }
        if let Some(why) = &line.not_compared {
            let _ok = write!(table, "; not compared: {why}");
        }
        table.push('\n');
    }
    table
}

fn stated<E: std::fmt::Display>(statement: Result<Statement, E>) -> String {
    statement.map_or_else(|error| error.to_string(), |statement| statement.to_string())
}
