//! What was in each bay, survey by survey, and what has changed.

use super::StoredSurvey;
use crate::mapping::statement::COVERAGE_FACTOR;
use crate::messages::VolumeAccount;
use crate::survey::{BayChange, Origin, compare, ids};
use serde::Serialize;

/// One volume of one survey, with what has changed since the newest survey before that has the bay.
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
    /// When the survey began, if that was noted.
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
    /// Volume less that of the newest earlier survey that has the bay, m³.
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
    /// Why there is no change although there are earlier surveys of the hall.
    pub not_compared: Option<String>,
    /// SHA-256 of the log.
    pub log_sha256: String,
    /// The id of the survey that the change is since.
    pub compared_with: Option<String>,
    /// The material's id, where one is configured.
    pub material_id: Option<String>,
    /// The material.
    pub material: Option<String>,
}

/// Every volume of surveys that stand in the order of time, hall by hall; `bay` picks one of them, `risk`
/// is how often noise may be called a change, `independent` names errors that no two of the surveys share.
///
/// A volume is compared with that of the newest survey before in which the bay was measured. Errors that a
/// survey was added with as independent are shared by none from before it with any from it on. What cannot be
/// compared says why in its line.
#[must_use]
pub fn history(
    surveys: &[StoredSurvey],
    bay: Option<&str>,
    risk: f64,
    independent: &[Origin],
) -> Vec<HistoryLine> {
    let mut lines = Vec::new();
    for (index, stored) in surveys.iter().enumerate() {
        let is_here = |other: &&StoredSurvey| other.hall_id == stored.hall_id;
        let before: Vec<&StoredSurvey> = surveys[..index].iter().filter(is_here).collect();
        for account in &stored.survey.accounts {
            if bay.is_none_or(|bay| bay == account.name) {
                let compared = compared(&before, stored, &account.name, (risk, independent));
                lines.push(line(stored, account, compared, risk));
            }
        }
    }
    lines
}

/// A change since an earlier survey, or why there is none.
enum Compared<'a> {
    /// It is the hall's first survey.
    First,
    Not(String),
    With(&'a StoredSurvey, Box<BayChange>),
}

fn compared<'a>(
    before: &[&'a StoredSurvey],
    stored: &StoredSurvey,
    bay: &str,
    (risk, independent): (f64, &[Origin]),
) -> Compared<'a> {
    if before.is_empty() {
        return Compared::First;
    }
    let has_bay =
        |other: &&&StoredSurvey| other.survey.accounts.iter().any(|account| account.name == bay);
    let Some(at) = before.iter().rposition(|other| has_bay(&other)) else {
        return Compared::Not(format!("no earlier survey of the hall has {bay:?}"));
    };
    let earlier = before[at];
    // Whatever was mounted, hung or laid anew in between.
    let renewed = before[at + 1..].iter().copied().chain([stored]);
    let independent: Vec<Origin> =
        renewed.flat_map(|survey| &survey.independent).chain(independent).copied().collect();
    match compare(&earlier.survey, &stored.survey, risk, &independent) {
        Err(error) => Compared::Not(format!("with {}: {error}", earlier.id)),
        Ok(report) => match report.bays.into_iter().find(|change| change.name == bay) {
            Some(change) => Compared::With(earlier, Box::new(change)),
            None => Compared::Not(format!("with {}: it lacks the bay", earlier.id)),
        },
    }
}

fn line(
    stored: &StoredSurvey,
    account: &VolumeAccount,
    compared: Compared<'_>,
    risk: f64,
) -> HistoryLine {
    let (change, not_compared, earlier) = match compared {
        Compared::First => (None, None, None),
        Compared::Not(why) => (None, Some(why), None),
        Compared::With(earlier, change) => (Some(change), None, Some(earlier)),
    };
    let expanded = |sigma: f64| COVERAGE_FACTOR * sigma;
    let mass_change = change.as_ref().and_then(|bay| bay.mass);
    let section = stored.survey.config.bays.iter().find(|bay| bay.name == account.name);
    let material = section.and_then(|bay| bay.material.clone());
    HistoryLine {
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
        change_m3: change.as_ref().map(|bay| bay.change.change_m3),
        change_expanded_m3: change.as_ref().map(|bay| expanded(bay.change.sigma_m3)),
        change_t: mass_change.map(|mass| mass.mass_t),
        change_expanded_t: mass_change.map(|mass| expanded(mass.sigma_t)),
        p_value: change.as_ref().map(|bay| bay.change.p_value),
        change_is_significant: change.as_ref().map(|bay| bay.change.p_value < risk),
        not_compared,
        log_sha256: stored.log_sha256.clone(),
        compared_with: earlier.map(|earlier| earlier.id.clone()),
        material_id: material.as_deref().map(ids::of_material),
        material,
    }
}
