//! What was in each bay, survey by survey, and what has changed.

use super::{StoredSurvey, ids};
use crate::mapping::statement::COVERAGE_FACTOR;
use crate::survey::compare;
use serde::Serialize;

/// One volume of one survey, with what has changed since the survey before.
///
/// The names of the fields are those of the JSON and the CSV; they stay as they are.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HistoryLine {
    /// The hall's id.
    pub hall_id: String,
    /// The hall.
    pub hall: String,
    /// The bay's id.
    pub bay_id: String,
    /// The bay, or the hall as a whole.
    pub bay: String,
    /// The survey's id.
    pub survey_id: String,
    /// When the log began, if that was noted.
    pub started_utc: Option<String>,
    /// Volume, m³.
    pub volume_m3: f64,
    /// Its expanded uncertainty (k = 2), m³.
    pub volume_expanded_m3: f64,
    /// Mass, t, where a density is configured.
    pub mass_t: Option<f64>,
    /// Its expanded uncertainty (k = 2), t.
    pub mass_expanded_t: Option<f64>,
    /// k of all expanded uncertainties.
    pub coverage_factor: f64,
    /// Volume less that of the survey before, m³; none in the first one.
    pub change_m3: Option<f64>,
    /// Its expanded uncertainty, errors that both surveys share cancelled, m³.
    pub change_expanded_m3: Option<f64>,
    /// The same in tonnes.
    pub change_t: Option<f64>,
    /// Its expanded uncertainty, t.
    pub change_expanded_t: Option<f64>,
    /// How likely so much is seen without a change.
    pub p_value: Option<f64>,
    /// That is less than the accepted risk.
    pub change_is_significant: Option<bool>,
    /// Why there is no change although there is an earlier survey.
    pub not_compared: Option<String>,
    /// SHA-256 of the log.
    pub log_sha256: String,
}

/// Every volume of surveys that stand in the order of time, hall by hall; `bay` picks one of them, `risk`
/// is how often noise may be called
/// a change. Surveys that cannot be compared say why in their lines.
#[must_use]
pub fn history(surveys: &[StoredSurvey], bay: Option<&str>, risk: f64) -> Vec<HistoryLine> {
    let mut lines = Vec::new();
    for (index, stored) in surveys.iter().enumerate() {
        let before = index.checked_sub(1).map(|k| &surveys[k]);
        let before = before.filter(|before| before.hall_id == stored.hall_id);
        let compared = before.map(|before| compare(&before.survey, &stored.survey, risk, &[]));
        for account in &stored.survey.accounts {
            if bay.is_some_and(|bay| bay != account.name) {
                continue;
            }
            let report = compared.as_ref().and_then(|compared| compared.as_ref().ok());
            let change = report
                .and_then(|report| report.bays.iter().find(|change| change.name == account.name));
            let expanded = |sigma: f64| COVERAGE_FACTOR * sigma;
            lines.push(HistoryLine {
                hall_id: stored.hall_id.clone(),
                hall: stored.hall.clone(),
                bay_id: ids::of_bay(&stored.hall_id, &account.name),
                bay: account.name.clone(),
                survey_id: stored.id.clone(),
                started_utc: stored.started_utc.clone(),
                volume_m3: account.estimate.volume_m3,
                volume_expanded_m3: expanded(account.estimate.sigma_m3),
                mass_t: account.mass.map(|mass| mass.mass_t),
                mass_expanded_t: account.mass.map(|mass| expanded(mass.sigma_t)),
                coverage_factor: COVERAGE_FACTOR,
                change_m3: change.map(|bay| bay.change.change_m3),
                change_expanded_m3: change.map(|bay| expanded(bay.change.sigma_m3)),
                change_t: change.and_then(|bay| bay.mass).map(|mass| mass.mass_t),
                change_expanded_t: change.and_then(|bay| bay.mass).map(|m| expanded(m.sigma_t)),
                p_value: change.map(|bay| bay.change.p_value),
                change_is_significant: change.map(|bay| bay.change.p_value < risk),
                not_compared: compared
                    .as_ref()
                    .and_then(|compared| compared.as_ref().err().map(ToString::to_string)),
                log_sha256: stored.log_sha256.clone(),
            });
        }
    }
    lines
}
