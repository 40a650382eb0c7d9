//! Volumes as people and scripts read them.

use crate::mapping::statement::Statement;
use crate::messages::{BudgetSource, VolumeAccount};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Sources with less than this share of the variance are left out of a table.
const LEAST_SHARE: f64 = 0.005;

/// One volume, as a line of JSON has it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AccountLine {
    /// What was measured.
    pub name: String,
    /// Volume, m³.
    pub volume_m3: f64,
    /// Its standard deviation, m³.
    pub sigma_m3: f64,
    /// y ± U with k = 2, rounded.
    pub statement: String,
    /// Mass, t; `null` without a density.
    pub mass_t: Option<f64>,
    /// Its standard deviation, t.
    pub mass_sigma_t: Option<f64>,
    /// Share of the area that a beam has hit.
    pub coverage: f64,
    /// Share of the volume over cells that a beam has hit.
    pub measured: f64,
    /// Share near such cells.
    pub interpolated: f64,
    /// Share that nobody saw.
    pub unseen: f64,
    /// Share where something moved since.
    pub disturbed: f64,
    /// Variance by source, m⁶.
    pub budget_m6: BTreeMap<&'static str, f64>,
}

impl From<&VolumeAccount> for AccountLine {
    fn from(account: &VolumeAccount) -> Self {
        let VolumeAccount { estimate, mass, budget, shares, .. } = account;
        Self {
            name: account.name.clone(),
            volume_m3: estimate.volume_m3,
            sigma_m3: estimate.sigma_m3,
            statement: stated(Statement::of_volume(estimate.volume_m3, estimate.sigma_m3)),
            mass_t: mass.map(|mass| mass.mass_t),
            mass_sigma_t: mass.map(|mass| mass.sigma_t),
            coverage: estimate.coverage_ratio,
            measured: shares.measured_ratio,
            interpolated: shares.interpolated_ratio,
            unseen: shares.unseen_ratio,
            disturbed: shares.disturbed_ratio,
            budget_m6: budget.rows.iter().map(|row| (row.source.name(), row.var_m6)).collect(),
        }
    }
}

/// A statement, or why there is none.
pub(super) fn stated<E: std::fmt::Display>(statement: Result<Statement, E>) -> String {
    statement.map_or_else(|error| error.to_string(), |statement| statement.to_string())
}

/// Every volume with its mass, its shares and its budget, largest source first: two or three lines
/// for each.
#[must_use]
pub fn accounts_table(accounts: &[VolumeAccount]) -> String {
    let width = accounts.iter().map(|account| account.name.chars().count()).max().unwrap_or(0);
    let mut table = String::new();
    for account in accounts {
        // Writing into a text cannot fail.
        let _ok = writeln!(table, "{:width$}  {}", account.name, amounts(account));
        let _ok = writeln!(table, "{:width$}  {}", "", shares(account));
        let _ok = writeln!(table, "{:width$}  U by source: {}", "", sources(account));
    }
    table
}

fn amounts(account: &VolumeAccount) -> String {
    let estimate = &account.estimate;
    let volume = stated(Statement::of_volume(estimate.volume_m3, estimate.sigma_m3));
    account.mass.map_or_else(
        || volume.clone(),
        |mass| format!("{volume}, {}", stated(Statement::of_mass(mass.mass_t, mass.sigma_t))),
    )
}

fn shares(account: &VolumeAccount) -> String {
    let shares = &account.shares;
    let mut text = format!(
        "{:.0} % measured, {:.0} % interpolated, {:.0} % unseen",
        100.0 * shares.measured_ratio,
        100.0 * shares.interpolated_ratio,
        100.0 * shares.unseen_ratio,
    );
    if shares.disturbed_ratio > 0.0 {
        let _ok = write!(text, ", {:.1} % disturbed", 100.0 * shares.disturbed_ratio);
    }
    text
}

/// `roughness 0.42, pose 0.31 m³; density 5.1 m³ (tonnes only)`
fn sources(account: &VolumeAccount) -> String {
    let budget = &account.budget;
    let total_m6 = budget.var_m6();
    let expanded = |var_m6: f64| format!("{:.2}", 2.0 * var_m6.max(0.0).sqrt());
    let rows: Vec<String> = budget
        .largest_first()
        .iter()
        .filter(|row| row.source != BudgetSource::Density && row.var_m6 > LEAST_SHARE * total_m6)
        .map(|row| format!("{} {}", row.source.name(), expanded(row.var_m6)))
        .collect();
    let density_m6 = budget.var_of_m6(BudgetSource::Density);
    let mut text = if rows.is_empty() { "none".to_owned() } else { rows.join(", ") + " m³" };
    if density_m6 > 0.0 {
        let _ok = write!(text, "; density {} m³ (tonnes only)", expanded(density_m6));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{BudgetRow, Mass, VolumeBudget, VolumeEstimate, VolumeShares};
    use crate::time::Stamp;

    fn account() -> VolumeAccount {
        let row = |source, var_m6| BudgetRow { source, var_m6 };
        VolumeAccount {
            name: "gravel".to_owned(),
            estimate: VolumeEstimate {
                at: Stamp::ZERO,
                volume_m3: 412.614,
                sigma_m3: 2.5,
                coverage_ratio: 0.9,
            },
            mass: Some(Mass { mass_t: 660.2, sigma_t: 9.1 }),
            budget: VolumeBudget {
                rows: vec![
                    row(BudgetSource::Prior, 2.25),
                    row(BudgetSource::Pose, 4.0),
                    row(BudgetSource::RangeScale, 0.001),
                    row(BudgetSource::Density, 25.0),
                ],
                shared: Vec::new(),
            },
            shares: VolumeShares {
                measured_ratio: 0.9,
                interpolated_ratio: 0.06,
                unseen_ratio: 0.03,
                disturbed_ratio: 0.01,
            },
        }
    }

    #[test]
    fn a_table_has_amounts_shares_and_sources_largest_first() {
        let empty = VolumeAccount {
            name: "empty bay".to_owned(),
            mass: None,
            budget: VolumeBudget::default(),
            ..account()
        };
        let table = accounts_table(&[account(), empty]);
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines[0], "gravel     (412.6 ± 5.0) m³ (k = 2), (660 ± 18) t (k = 2)");
        assert_eq!(lines[1].trim(), "90 % measured, 6 % interpolated, 3 % unseen, 1.0 % disturbed");
        assert_eq!(
            lines[2].trim(),
            "U by source: pose 4.00, prior 3.00 m³; density 10.00 m³ (tonnes only)"
        );
        assert_eq!(lines[3], "empty bay  (412.6 ± 5.0) m³ (k = 2)");
        assert!(lines[5].ends_with("U by source: none"));
    }

    #[test]
    fn json_has_every_source_and_no_mass_without_a_density() {
        let line = serde_json::to_value(AccountLine::from(&account())).expect("json");
        assert_eq!(line["statement"], "(412.6 ± 5.0) m³ (k = 2)");
        assert_eq!(line["budget_m6"]["range_scale"], 0.001);
        assert_eq!(line["mass_t"], 660.2);
        let bare = VolumeAccount { mass: None, ..account() };
        let line = serde_json::to_value(AccountLine::from(&bare)).expect("json");
        assert!(line["mass_t"].is_null());
    }
}
