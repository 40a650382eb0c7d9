//! How it was measured: checks, instrument, rule, what the result is not.

use super::content::{Column, Part, Table};
use super::facts::Facts;
use super::{declared, words};
use crate::mapping::statement::{COVERAGE_FACTOR, Statement};
use crate::messages::Verdict as FixVerdict;
use crate::record::{Decision, SurveyPlace};
use crate::survey::{Flight, Reproduction};

/// Standing text.
const LIMITS: &str = "The volume is that between the measured surface and the base, of the ground that \
    the configuration counts. U follows the Guide to the Expression of Uncertainty in Measurement (JCGM \
    100:2008): the standard uncertainties of all sources, combined with their correlations, times k = 2. \
    Errors of the configuration itself, such as a bay's outline or a wrong base, are not in it. Tonnes are \
    the volume times the configured bulk density; what is said of its source, date and moisture is as somebody \
    has written it into the configuration. This is not a legal-for-trade measurement.";

/// Most lines of a list that may grow.
const MOST_LINES: usize = 12;

pub(super) fn parts(facts: &Facts, log_sha256: &str) -> Vec<Part> {
    let flight = &facts.flight;
    let mut parts = vec![
        Part::Heading("How it was measured".to_owned()),
        two_columns("Checks of this flight", "Found", checks(flight)),
        Part::Heading("Instrument".to_owned()),
        two_columns("Part", "What", instrument(facts)),
    ];
    parts.extend(declared::parts(flight));
    let densities = densities(flight);
    if !densities.rows.is_empty() {
        parts.push(Part::Heading("Density".to_owned()));
        parts.push(Part::Table(densities));
        parts.push(Part::Text(
            "u²(m) = (ρ u(V))² + (V u(ρ))² + (u(ρ) u(V))²: volume and density are independent."
                .to_owned(),
        ));
    }
    if !flight.warnings.is_empty() {
        parts.push(Part::Heading("What people were warned of in flight".to_owned()));
        parts.push(Part::List(warnings(flight)));
    }
    parts.extend([
        Part::Heading("Decision rule".to_owned()),
        Part::Text(facts.wishes.target.rule()),
        Part::Heading("To compute it again".to_owned()),
        Part::List(again(flight)),
        Part::Text(format!("SHA-256 of the log: {log_sha256}")),
        Part::Heading("What this is, and what not".to_owned()),
        Part::Text(LIMITS.to_owned()),
        Part::Signatures(signatures(facts)),
    ]);
    parts
}

fn two_columns(left: &'static str, right: &'static str, rows: Vec<Vec<String>>) -> Part {
    Part::Table(Table { columns: vec![Column::words(left, 1.0), Column::words(right, 2.6)], rows })
}

fn row(left: &str, right: impl Into<String>) -> Vec<String> {
    vec![left.to_owned(), right.into()]
}

#[expect(clippy::cast_precision_loss, reason = "counts of one flight")]
fn checks(flight: &Flight) -> Vec<Vec<String>> {
    let share = |part: u64, whole: u64| words::ratio(part as f64, (whole as f64).max(1.0));
    let mut rows = vec![row(
        "Computed again from the log",
        match flight.reproduction {
            Reproduction::Identical => "volumes and surface are equal to the last bit",
            Reproduction::Different => "not equal to the record: another build wrote it",
            Reproduction::ResultsOnly => "merged from other logs; not computed again here",
        },
    )];
    if flight.place.n_in_log > 1 {
        let SurveyPlace { number, n_in_log, .. } = flight.place;
        rows.push(row("Survey of the log", format!("number {number} of {n_in_log}")));
    }
    let decided = flight.decision.as_ref().map_or_else(|| "none yet".to_owned(), Decision::said);
    rows.push(row("Decision after the landing", decided));
    let counts = &flight.counts;
    if counts.received > 0 {
        rows.push(row(
            "Beams",
            format!("{} received, {} of the material", counts.received, counts.used),
        ));
        let elsewhere = counts.outside + counts.own_body + counts.no_return;
        rows.push(row(
            "Beams without material",
            format!(
                "{} (walls and borders, own body, no return)",
                share(elsewhere, counts.received)
            ),
        ));
        rows.push(row(
            "Hits that were not of the surface",
            format!("{} (dust, edges, machines)", share(counts.refused, counts.used)),
        ));
        let lost = counts.no_pose + counts.poor_pose + counts.forgotten;
        rows.push(row("Beams without a good pose", share(lost, counts.received)));
    }
    if flight.fixes.n_all() > 0 {
        let (n_all, n_used) = (flight.fixes.n_all(), flight.fixes.n_used());
        rows.push(row("Camera frames", format!("{n_all}, of which {n_used} were used")));
        let gated = flight.fixes.n_frames.get(&FixVerdict::Gated).copied().unwrap_or(0);
        rows.push(row("Frames refused by the filter", format!("{gated}")));
        if let Some(px) = flight.fixes.median_residual_px() {
            rows.push(row("Marker residual, median", format!("{px:.2} px")));
        }
    }
    if let Some(summary) = &flight.summary {
        let end = if summary.is_complete { "to its end" } else { "cut short" };
        rows.push(row(
            "Flight",
            format!(
                "{} waypoints, {:.1} m of path, {end}",
                summary.steps_done, summary.path_length_m
            ),
        ));
    }
    rows
}

fn instrument(facts: &Facts) -> Vec<Vec<String>> {
    let flight = &facts.flight;
    let config = &flight.config;
    let method = serde_json::to_value(config.surface.method).ok();
    let method =
        method.as_ref().and_then(serde_json::Value::as_str).unwrap_or("unknown").to_owned();
    let region = &config.hall.region;
    vec![
        row("LiDAR", flight.lidar_said()),
        row("Cameras, known tags", format!("{} and {}", config.cameras.len(), config.tags.len())),
        row("Surface", format!("{method}, cells of {} m", config.surface.cell_m)),
        row(
            "Region",
            format!(
                "x {} to {} m, y {} to {} m in the hall's own coordinates",
                region.x_min_m, region.x_max_m, region.y_min_m, region.y_max_m
            ),
        ),
        row(
            "Left out",
            format!(
                "{} exclusions, {} obstacles",
                config.hall.exclusions.len() + config.exclusions.len(),
                config.obstacles.len()
            ),
        ),
        row("Flown with", flight.build.clone()),
        row("Reported by", facts.reported_by.clone()),
        row(
            "SHA-256 of the configuration",
            crate::export::sha256_of_bytes(flight.config_toml.as_bytes()),
        ),
    ]
}

fn densities(flight: &Flight) -> Table {
    let rows = flight.config.bays.iter().filter_map(|bay| {
        let mean = bay.density_t_per_m3?;
        let sigma = bay.density_sigma_t_per_m3.unwrap_or(0.0);
        let stated = Statement::new(mean, sigma, COVERAGE_FACTOR, "t/m³").ok()?;
        let said = |word: &Option<String>| word.clone().unwrap_or_else(|| "not stated".to_owned());
        Some(vec![
            bay.name.clone(),
            said(&bay.material),
            words::amounts(&stated),
            said(&bay.density_source),
            said(&bay.density_date),
            said(&bay.moisture),
        ])
    });
    Table {
        columns: vec![
            Column::words("Bay", 1.3),
            Column::words("Material", 1.5),
            Column::numbers("ρ ± U, t/m³", 1.5),
            Column::words("How it was found", 2.4),
            Column::words("On", 1.2),
            Column::words("Moisture", 1.8),
        ],
        rows: rows.collect(),
    }
}

fn warnings(flight: &Flight) -> Vec<String> {
    let said = flight
        .warnings
        .iter()
        .map(|(at, text)| format!("{:.0} s: {}", at.seconds_since(flight.began_at), text.text));
    let mut lines: Vec<String> = said.take(MOST_LINES).collect();
    if flight.warnings.len() > MOST_LINES {
        lines.push(format!("and {} more in the log", flight.warnings.len() - MOST_LINES));
    }
    lines
}

/// Commands, each with what it does.
fn again(flight: &Flight) -> Vec<String> {
    let file = flight.log.file_name().unwrap_or_default().to_string_lossy();
    match flight.reproduction {
        Reproduction::ResultsOnly => {
            vec![format!("stockpilot merge {}", flight.merged_from.join(" "))]
        }
        Reproduction::Identical | Reproduction::Different => vec![
            format!("every result: stockpilot replay {file} --verify"),
            format!(
                "this report: stockpilot report {file} --flight {} --out DIR",
                flight.place.number
            ),
        ],
    }
}

fn signatures(facts: &Facts) -> Vec<String> {
    let operator = facts.wishes.operator.as_ref();
    let operator =
        operator.map_or_else(|| "Operator".to_owned(), |name| format!("Operator: {name}"));
    vec![operator, "Reviewed by".to_owned(), "Date".to_owned()]
}
