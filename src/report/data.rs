//! The report as data: JSON with everything, CSV with one row for each volume.

use super::ReportError;
use super::books::BookDifference;
use super::declared::{self, DeclarationData, DustData};
use super::facts::{BayFacts, Facts};
use super::verdict::Verdict;
use crate::config::{BaySection, Config};
use crate::mapping::statement::COVERAGE_FACTOR;
use crate::messages::{BudgetSource, GridGeometry, HeightMap, VolumeAccount};
use crate::record::Decision;
use crate::survey::{AccountLine, BayChange, Flight, Reproduction, Survey, ids};
use serde::Serialize;

/// Name and version of the JSON form; keys may be added within a version, not changed.
pub const SCHEMA: &str = "stockpilot-report-1";

/// The JSON form.
#[derive(Debug, Serialize)]
pub struct ReportData {
    schema: &'static str,
    site: Option<String>,
    /// The hall as the books call it.
    hall: Option<String>,
    hall_id: Option<String>,
    operator: Option<String>,
    /// Of all U in the file.
    coverage_factor: f64,
    verdict: Verdict,
    remarks: Vec<String>,
    log: LogData,
    survey: SurveyData,
    accounts: Vec<AccountData>,
    /// Covariances of the volumes, m⁶.
    covariance: CovarianceData,
    surface: Option<SurfaceData>,
    beams: BeamData,
    /// The survey that changes are since.
    earlier: Option<EarlierData>,
    /// Origins of errors that this and the earlier survey share, so that they cancel.
    shared_with_earlier: Vec<&'static str>,
}

#[derive(Debug, Serialize)]
struct LogData {
    file: String,
    sha256: String,
    version: String,
    build: String,
    reported_by: String,
    complete: bool,
    reproduction: &'static str,
    merged_from: Vec<String>,
}

/// An earlier survey.
#[derive(Debug, Serialize)]
struct EarlierData {
    file: String,
    /// Which of the log's surveys it is, from 1.
    number: usize,
    surveys_in_log: usize,
}

#[derive(Debug, Serialize)]
struct SurveyData {
    /// Which of the log's surveys it is, from 1.
    number: usize,
    surveys_in_log: usize,
    log_started_utc: Option<String>,
    started_utc: Option<String>,
    measured_from_utc: Option<String>,
    measured_to_utc: Option<String>,
    is_final: bool,
    lidar: String,
    /// What the hall's configuration says of dust.
    dust: DustData,
    /// What people said before the motors turned.
    declarations: Vec<DeclarationData>,
    /// What a person decided of it.
    decision: Option<Decision>,
    waypoints: Option<usize>,
    path_length_m: Option<f64>,
}

#[derive(Debug, Serialize)]
struct AccountData {
    #[serde(flatten)]
    account: AccountLine,
    expanded_m3: f64,
    mass_expanded_t: Option<f64>,
    area_m2: Option<f64>,
    base: String,
    base_expanded_m3: f64,
    /// Made from the hall's name in the books and the bay's.
    bay_id: Option<String>,
    material: Option<String>,
    material_id: Option<String>,
    density: Option<DensityData>,
    change: Option<ChangeData>,
    book: Option<BookDifference>,
    verdict: Verdict,
    remarks: Vec<String>,
}

/// The bulk density, as configured.
#[derive(Debug, Serialize)]
struct DensityData {
    t_per_m3: f64,
    sigma_t_per_m3: f64,
    source: Option<String>,
    date: Option<String>,
    moisture: Option<String>,
}

#[derive(Debug, Serialize)]
struct ChangeData {
    earlier_m3: f64,
    change_m3: f64,
    sigma_m3: f64,
    /// What σ would be if the surveys shared no error.
    unshared_sigma_m3: f64,
    change_t: Option<f64>,
    sigma_t: Option<f64>,
    p_value: f64,
    risk: f64,
    is_significant: bool,
    detectable_m3: f64,
}

/// Covariances between volumes.
#[derive(Debug, Serialize)]
struct CovarianceData {
    /// The volumes, in the order of rows and columns.
    names: Vec<String>,
    /// On the diagonal each volume's variance; elsewhere what errors that last the whole flight
    /// (mounting, range, clock, base) make common. Errors of the pose and of the surface between
    /// neighbouring bays, and those of markers, are not in it.
    of_constant_errors_m6: Vec<Vec<f64>>,
}

#[derive(Debug, Serialize)]
struct SurfaceData {
    x_min_m: f64,
    y_min_m: f64,
    cell_m: f64,
    n_cols: usize,
    n_rows: usize,
    /// Smallest and largest height of cells that count, m.
    lowest_m: f64,
    highest_m: f64,
    /// Mean height of the cells that count, m.
    mean_m: f64,
    n_counting_cells: usize,
    /// Some cells, to check other forms of the map by.
    probes: Vec<ProbeData>,
}

#[derive(Debug, Serialize)]
struct ProbeData {
    col: usize,
    row: usize,
    x_m: f64,
    y_m: f64,
    height_m: f64,
    sigma_m: f64,
}

#[derive(Debug, Serialize)]
struct BeamData {
    received: u64,
    used: u64,
    refused: u64,
    hits_exported: usize,
}

impl ReportData {
    /// Everything that a report states.
    #[must_use]
    pub fn new(facts: &Facts, log_sha256: &str) -> Self {
        let flight = &facts.flight;
        let shared = facts.changes.as_ref().map_or(&[][..], |changes| &changes.shared);
        Self {
            schema: SCHEMA,
            site: facts.wishes.site.clone(),
            hall: facts.wishes.hall.clone(),
            hall_id: facts.hall_id(),
            operator: facts.wishes.operator.clone(),
            coverage_factor: COVERAGE_FACTOR,
            verdict: facts.verdict(),
            remarks: facts.remarks.clone(),
            log: log(facts, log_sha256),
            survey: survey(flight),
            accounts: facts.bays.iter().map(|bay| account(facts, bay)).collect(),
            covariance: covariance(&flight.config, &flight.accounts),
            surface: surface(flight),
            beams: BeamData {
                received: flight.counts.received,
                used: flight.counts.used,
                refused: flight.counts.refused,
                hits_exported: flight.hits.len(),
            },
            earlier: facts.wishes.against.as_ref().map(earlier),
            shared_with_earlier: shared.iter().map(|origin| origin.name()).collect(),
        }
    }
}

fn log(facts: &Facts, sha256: &str) -> LogData {
    let flight = &facts.flight;
    LogData {
        file: flight.log.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        sha256: sha256.to_owned(),
        version: flight.version.clone(),
        build: flight.build.clone(),
        reported_by: facts.reported_by.clone(),
        complete: flight.is_complete,
        reproduction: match flight.reproduction {
            Reproduction::Identical => "identical",
            Reproduction::Different => "different",
            Reproduction::ResultsOnly => "results_only",
        },
        merged_from: flight.merged_from.clone(),
    }
}

fn earlier(survey: &Survey) -> EarlierData {
    EarlierData {
        file: survey.path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        number: survey.place.number,
        surveys_in_log: survey.place.n_in_log,
    }
}

fn survey(flight: &Flight) -> SurveyData {
    let between = flight.measured_between();
    let civil = |at| flight.civil(at).map(|at| at.to_string());
    SurveyData {
        number: flight.place.number,
        surveys_in_log: flight.place.n_in_log,
        log_started_utc: flight.log_started.map(|at| at.to_string()),
        started_utc: flight.started.map(|at| at.to_string()),
        measured_from_utc: between.and_then(|(from, _)| civil(from)),
        measured_to_utc: between.and_then(|(_, to)| civil(to)),
        is_final: flight.is_final,
        lidar: flight.lidar_said(),
        dust: declared::dust(flight),
        declarations: declared::data(flight),
        decision: flight.decision.clone(),
        waypoints: flight.summary.as_ref().map(|summary| summary.steps_done),
        path_length_m: flight.summary.as_ref().map(|summary| summary.path_length_m),
    }
}

fn account(facts: &Facts, bay: &BayFacts) -> AccountData {
    let (account, section) = (&bay.account, facts.section(bay));
    let material = section.and_then(|section| section.material.clone());
    AccountData {
        account: AccountLine::from(account),
        expanded_m3: COVERAGE_FACTOR * account.estimate.sigma_m3,
        mass_expanded_t: account.mass.map(|mass| COVERAGE_FACTOR * mass.sigma_t),
        area_m2: bay.area_m2,
        base: bay.base.clone(),
        base_expanded_m3: COVERAGE_FACTOR * bay.base_sigma_m3,
        bay_id: facts.bay_id(bay),
        material_id: material.as_deref().map(ids::of_material),
        material,
        density: section.and_then(density),
        change: bay.change.as_ref().map(change),
        book: bay.book.clone(),
        verdict: bay.verdict,
        remarks: bay.remarks.clone(),
    }
}

fn density(section: &BaySection) -> Option<DensityData> {
    Some(DensityData {
        t_per_m3: section.density_t_per_m3?,
        sigma_t_per_m3: section.density_sigma_t_per_m3.unwrap_or(0.0),
        source: section.density_source.clone(),
        date: section.density_date.clone(),
        moisture: section.moisture.clone(),
    })
}

fn change(bay: &BayChange) -> ChangeData {
    let change = &bay.change;
    ChangeData {
        earlier_m3: bay.earlier.volume_m3,
        change_m3: change.change_m3,
        sigma_m3: change.sigma_m3,
        unshared_sigma_m3: change.unshared_sigma_m3,
        change_t: bay.mass.map(|mass| mass.mass_t),
        sigma_t: bay.mass.map(|mass| mass.sigma_t),
        p_value: change.p_value,
        risk: change.risk,
        is_significant: change.p_value < change.risk,
        detectable_m3: change.detectable_m3,
    }
}

/// Variances, and what constant errors make common to two volumes.
///
/// ```text
/// cov(V_a, V_b) = Σ_c (∂V_a/∂c) (∂V_b/∂c) σ_c²
/// ```
fn covariance(config: &Config, accounts: &[VolumeAccount]) -> CovarianceData {
    let of = |a: &VolumeAccount, b: &VolumeAccount| {
        if a.name == b.name {
            return a.budget.var_m6();
        }
        let mut sum_m6 = 0.0;
        for item in &a.budget.shared {
            let is_common = match item.source {
                BudgetSource::Base => {
                    have_one_base(config, &a.name, &b.name) && item.component == 0
                }
                BudgetSource::MarkerMap => false,
                _ => true,
            };
            let same = b.budget.shared.iter().find(|other| {
                is_common && other.source == item.source && other.component == item.component
            });
            sum_m6 += same.map_or(0.0, |other| item.dv_dc * other.dv_dc * item.sigma * other.sigma);
        }
        sum_m6
    };
    CovarianceData {
        names: accounts.iter().map(|account| account.name.clone()).collect(),
        of_constant_errors_m6: accounts
            .iter()
            .map(|a| accounts.iter().map(|b| of(a, b)).collect())
            .collect(),
    }
}

/// True if two bays lie on the same base, so that it is wrong under both by the same.
fn have_one_base(config: &Config, a: &str, b: &str) -> bool {
    let base = |name: &str| config.bays.iter().find(|bay| bay.name == name).map(|bay| &bay.base);
    match (base(a), base(b)) {
        (Some(a), Some(b)) => a == b,
        // The whole hall, beside one of its bays.
        _ => config.bays.iter().all(|bay| bay.base == config.bays[0].base),
    }
}

#[expect(clippy::cast_precision_loss, reason = "cell counts stay far below 2^53")]
fn surface(flight: &Flight) -> Option<SurfaceData> {
    let surface = flight.surface.as_ref()?;
    let bays = flight.bays_on_surface();
    let counts = &bays.first()?.base.cell_areas_m2;
    let heights = || {
        std::iter::zip(&surface.mean_m, counts).filter(|(_, area)| **area > 0.0).map(|(h, _)| *h)
    };
    let n_counting_cells = heights().count();
    let GridGeometry { x_min_m, y_min_m, cell_m, n_cols, n_rows } = surface.grid;
    Some(SurfaceData {
        x_min_m,
        y_min_m,
        cell_m,
        n_cols,
        n_rows,
        lowest_m: heights().fold(f64::INFINITY, f64::min),
        highest_m: heights().fold(f64::NEG_INFINITY, f64::max),
        mean_m: heights().sum::<f64>() / (n_counting_cells as f64).max(1.0),
        n_counting_cells,
        probes: probes(surface, counts),
    })
}

/// Cells spread over the map, of those that count.
fn probes(surface: &HeightMap, counts: &[f64]) -> Vec<ProbeData> {
    const N_PROBES: usize = 12;
    let cells: Vec<usize> = (0..counts.len()).filter(|cell| counts[*cell] > 0.0).collect();
    let step = (cells.len() / N_PROBES).max(1);
    let probe = |cell: &usize| {
        let (x_m, y_m) = surface.grid.centre_m(*cell);
        ProbeData {
            col: cell % surface.grid.n_cols,
            row: cell / surface.grid.n_cols,
            x_m,
            y_m,
            height_m: surface.mean_m[*cell],
            sigma_m: surface.sigma_m[*cell],
        }
    };
    cells.iter().step_by(step).map(probe).collect()
}

/// A row of the CSV form; the names of its columns stay as they are.
#[derive(Serialize)]
struct Row<'a> {
    site: &'a str,
    bay: &'a str,
    measured_from_utc: Option<String>,
    measured_to_utc: Option<String>,
    volume_m3: f64,
    volume_expanded_m3: f64,
    mass_t: Option<f64>,
    mass_expanded_t: Option<f64>,
    coverage_factor: f64,
    verdict: &'static str,
    base: &'a str,
    base_expanded_m3: f64,
    measured_ratio: f64,
    interpolated_ratio: f64,
    unseen_ratio: f64,
    disturbed_ratio: f64,
    change_m3: Option<f64>,
    change_expanded_m3: Option<f64>,
    change_is_significant: Option<bool>,
    book_m3: Option<f64>,
    book_t: Option<f64>,
    book_difference: Option<f64>,
    book_difference_expanded: Option<f64>,
    book_is_significant: Option<bool>,
    remarks: String,
    log_sha256: &'a str,
    survey_id: String,
    hall_id: Option<String>,
    bay_id: Option<String>,
    material_id: Option<String>,
    material: Option<&'a str>,
    density_source: Option<&'a str>,
    density_date: Option<&'a str>,
    moisture: Option<&'a str>,
}

/// One row for each volume, the whole region first.
///
/// # Errors
/// None but by a defect: the rows are plain.
pub(super) fn csv(facts: &Facts, log_sha256: &str) -> Result<Vec<u8>, ReportError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for bay in &facts.bays {
        writer.serialize(row(facts, bay, log_sha256))?;
    }
    writer.into_inner().map_err(|error| ReportError::Csv(csv::Error::from(error.into_error())))
}

fn row<'a>(facts: &'a Facts, bay: &'a BayFacts, log_sha256: &'a str) -> Row<'a> {
    let account = &bay.account;
    let between = facts.flight.measured_between();
    let civil = |at| facts.flight.civil(at).map(|at| at.to_string());
    let change = bay.change.as_ref().map(|bay| &bay.change);
    let book = bay.book.as_ref();
    let section = facts.section(bay);
    let word = |of: fn(&BaySection) -> &Option<String>| section.and_then(|bay| of(bay).as_deref());
    let material = word(|section| &section.material);
    let book_in = |unit: &str| book.filter(|book| book.unit == unit).map(|book| book.book);
    Row {
        site: facts.wishes.site.as_deref().unwrap_or(""),
        bay: &account.name,
        measured_from_utc: between.and_then(|(from, _)| civil(from)),
        measured_to_utc: between.and_then(|(_, to)| civil(to)),
        volume_m3: account.estimate.volume_m3,
        volume_expanded_m3: COVERAGE_FACTOR * account.estimate.sigma_m3,
        mass_t: account.mass.map(|mass| mass.mass_t),
        mass_expanded_t: account.mass.map(|mass| COVERAGE_FACTOR * mass.sigma_t),
        coverage_factor: COVERAGE_FACTOR,
        verdict: bay.verdict.name(),
        base: &bay.base,
        base_expanded_m3: COVERAGE_FACTOR * bay.base_sigma_m3,
        measured_ratio: account.shares.measured_ratio,
        interpolated_ratio: account.shares.interpolated_ratio,
        unseen_ratio: account.shares.unseen_ratio,
        disturbed_ratio: account.shares.disturbed_ratio,
        change_m3: change.map(|change| change.change_m3),
        change_expanded_m3: change.map(|change| COVERAGE_FACTOR * change.sigma_m3),
        change_is_significant: change.map(|change| change.p_value < change.risk),
        book_m3: book_in("m³"),
        book_t: book_in("t"),
        book_difference: book.map(|book| book.difference),
        book_difference_expanded: book.map(|book| COVERAGE_FACTOR * book.sigma),
        book_is_significant: book.map(|book| book.is_significant),
        remarks: bay.remarks.join("; "),
        log_sha256,
        survey_id: ids::of_survey(&facts.flight.identity),
        hall_id: facts.hall_id(),
        bay_id: facts.bay_id(bay),
        material_id: material.map(ids::of_material),
        material,
        density_source: word(|section| &section.density_source),
        density_date: word(|section| &section.density_date),
        moisture: word(|section| &section.moisture),
    }
}
