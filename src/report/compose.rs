//! From facts to what people read.

use super::ReportError;
use super::books::BookDifference;
use super::content::{Bars, Column, Content, Headline, Part, Table, Tone};
use super::facts::{BayFacts, Facts};
use super::{method, pictures, words};
use crate::messages::{BudgetRow, BudgetSource};
use crate::survey::Origin;

/// What stands below every page.
const FOOTER: &str =
    "Not a legal-for-trade measurement. U: expanded uncertainty, k = 2, about 95 %.";

/// The whole report; `log_sha256` names the log.
pub(super) fn content(facts: &Facts, log_sha256: &str) -> Result<Content, ReportError> {
    let mut parts = front(facts)?;
    parts.push(Part::NewPage);
    parts.extend(picture_pages(facts)?);
    parts.extend(budget(facts)?);
    parts.extend(method::parts(facts, log_sha256));
    Ok(Content {
        title: facts.wishes.site.clone().unwrap_or_else(|| "Stockpile survey".to_owned()),
        subtitle: words::when(&facts.flight),
        footer: FOOTER.to_owned(),
        parts,
    })
}

fn front(facts: &Facts) -> Result<Vec<Part>, ReportError> {
    let mut parts = Vec::new();
    if let Some(hall) = facts.bays.first() {
        parts.push(Part::Headline(Headline {
            name: hall.account.name.clone(),
            volume: words::statement(&hall.volume()?),
            mass: hall.mass()?.as_ref().map(words::statement),
            verdict: facts.verdict(),
        }));
    }
    parts.push(Part::Table(volumes(facts)?));
    parts.push(Part::Heading("How much of the volume was seen".to_owned()));
    parts.push(Part::Bars(shares(facts)));
    parts.push(Part::Heading("What it lies on".to_owned()));
    parts.push(Part::Table(bases(facts)));
    parts.push(Part::Heading("Since the last survey, and against the books".to_owned()));
    parts.extend(differences(facts));
    let remarks = remarks(facts);
    if !remarks.is_empty() {
        parts.push(Part::Heading("Remarks".to_owned()));
        parts.push(Part::List(remarks));
    }
    Ok(parts)
}

fn volumes(facts: &Facts) -> Result<Table, ReportError> {
    let columns = vec![
        Column::words("Measured", 2.2),
        Column::numbers("Volume ± U, m³", 1.9),
        Column::numbers("U / V", 0.9),
        Column::numbers("Mass ± U, t", 1.9),
        Column::numbers("Verdict", 1.8),
    ];
    let row = |bay: &BayFacts| -> Result<Vec<String>, ReportError> {
        let estimate = &bay.account.estimate;
        let mass = bay.mass()?.as_ref().map_or_else(|| "no density".to_owned(), words::amounts);
        Ok(vec![
            bay.account.name.clone(),
            words::amounts(&bay.volume()?),
            words::ratio(2.0 * estimate.sigma_m3, estimate.volume_m3),
            mass,
            bay.verdict.name().to_owned(),
        ])
    };
    Ok(Table { columns, rows: facts.bays.iter().map(row).collect::<Result<_, _>>()? })
}

fn shares(facts: &Facts) -> Bars {
    let row = |bay: &BayFacts| {
        let shares = &bay.account.shares;
        let parts = [
            shares.measured_ratio,
            shares.interpolated_ratio,
            shares.unseen_ratio,
            shares.disturbed_ratio,
        ];
        let said = words::shares(&parts);
        (bay.account.name.clone(), parts.to_vec(), said)
    };
    Bars {
        parts: vec![
            ("measured", Tone::Green),
            ("interpolated", Tone::Sky),
            ("unseen", Tone::Orange),
            ("disturbed", Tone::Red),
        ],
        rows: facts.bays.iter().map(row).collect(),
    }
}

fn bases(facts: &Facts) -> Table {
    let row = |bay: &BayFacts| {
        vec![
            bay.account.name.clone(),
            bay.base.clone(),
            bay.area_m2.map_or_else(|| "–".to_owned(), |area| format!("{area:.1}")),
            words::two_digits(2.0 * bay.base_sigma_m3),
        ]
    };
    Table {
        columns: vec![
            Column::words("Measured", 1.6),
            Column::words("Base, as configured (k = 2)", 4.2),
            Column::numbers("Area, m²", 1.0),
            Column::numbers("U by it, m³", 1.1),
        ],
        rows: facts.bays.iter().map(row).collect(),
    }
}

/// The change since the earlier survey and the difference from the books, side by side.
fn differences(facts: &Facts) -> Vec<Part> {
    let has_any = |bay: &&BayFacts| bay.change.is_some() || bay.book.is_some();
    let none = || "–".to_owned();
    let row = |bay: &BayFacts| {
        let change = bay.change.as_ref().map(|bay| &bay.change);
        let changed = change.map(|change| {
            change.statement().map_or_else(|e| e.to_string(), |stated| words::amounts(&stated))
        });
        let book = bay.book.as_ref();
        let differs =
            |book: &BookDifference| book.statement.replace(" (k = 2)", "").replace('-', "−");
        vec![
            bay.account.name.clone(),
            changed.unwrap_or_else(none),
            change.map_or_else(none, |change| words::significance(change.p_value, change.risk)),
            book.map_or_else(none, |book| {
                format!("{}\u{a0}{}", words::plain(book.book), book.unit)
            }),
            book.map_or_else(none, differs),
            book.map_or_else(none, |book| words::significance(book.p_value, book.risk)),
        ]
    };
    let rows: Vec<Vec<String>> = facts.bays.iter().filter(has_any).map(row).collect();
    let mut parts = Vec::new();
    if !rows.is_empty() {
        parts.push(Part::Table(Table {
            columns: vec![
                Column::words("Measured", 1.5),
                Column::numbers("Change ± U, m³", 1.5),
                Column::numbers("", 1.3),
                Column::numbers("Book", 1.1),
                Column::numbers("Measured less book ± U", 1.9),
                Column::numbers("", 1.3),
            ],
            rows,
        }));
    }
    parts.push(Part::Text(compared_with(facts)));
    parts
}

/// What the survey was compared with, and what "significant" means.
fn compared_with(facts: &Facts) -> String {
    let mut said = match (&facts.changes, &facts.wishes.against) {
        (Some(report), Some(earlier)) => {
            let file = words::log_of(earlier);
            let shared: Vec<&str> =
                report.shared.iter().map(|origin: &Origin| origin.name()).collect();
            let shared = if shared.is_empty() { "none".to_owned() } else { shared.join(", ") };
            format!("Earlier survey: {file}. Errors that both share cancel: {shared}.")
        }
        _ => "No earlier survey was given.".to_owned(),
    };
    let has_book = facts.bays.iter().any(|bay| bay.book.is_some());
    if !has_book {
        said.push_str(" No books were given.");
    }
    if has_book || facts.changes.is_some() {
        said.push_str(&format!(
            " Significant: by chance alone so much is seen in less than {}\u{a0}% of all cases.",
            100.0 * facts.wishes.risk
        ));
    }
    said
}

/// Remarks on the whole survey, then those on volumes: each once, with the names that it concerns.
fn remarks(facts: &Facts) -> Vec<String> {
    let mut of_bays: Vec<(&str, Vec<&str>)> = Vec::new();
    for bay in &facts.bays {
        let name = bay.account.name.as_str();
        for remark in &bay.remarks {
            match of_bays.iter_mut().find(|(known, _)| known == remark) {
                Some((_, names)) => names.push(name),
                None => of_bays.push((remark, vec![name])),
            }
        }
    }
    let said = |(remark, names): (&str, Vec<&str>)| {
        let is_all = names.len() == facts.bays.len() && names.len() > 1;
        let names = if is_all { "all volumes".to_owned() } else { names.join(", ") };
        format!("{}: {remark}.", words::capital(&names))
    };
    let of_all = facts.remarks.iter().map(|remark| format!("{}.", words::capital(remark)));
    of_all.chain(of_bays.into_iter().map(said)).collect()
}

fn picture_pages(facts: &Facts) -> Result<Vec<Part>, ReportError> {
    let flight = &facts.flight;
    let bays = flight.bays_on_surface();
    let mut maps = pictures::maps(flight)?;
    let earlier = facts.wishes.against.as_ref();
    if let Some(earlier) = earlier.and_then(|survey| survey.surface.as_ref()) {
        maps.extend(pictures::change(flight, earlier)?);
    }
    if maps.is_empty() {
        return Ok(vec![Part::Text("The log holds no surface.".to_owned())]);
    }
    let sections = pictures::sections(flight, &bays)?;
    Ok(vec![
        Part::Heading("The surface".to_owned()),
        Part::Pictures(maps),
        Part::Heading("Sections".to_owned()),
        Part::Pictures(sections),
    ])
}

/// Sources with less than this share of the variance are left out of the bars.
const LEAST_SHARE: f64 = 1e-4;

fn budget(facts: &Facts) -> Result<Vec<Part>, ReportError> {
    let mut parts = vec![
        Part::Heading("Where the uncertainty comes from".to_owned()),
        Part::Text(
            "Each source's U (k = 2) of the volume, largest first; squares add up. What cells share (pose, \
             mounting, range, markers, base) is carried through the whole volume and does not average \
             out."
                .to_owned(),
        ),
    ];
    for bay in &facts.bays {
        parts.push(Part::Subheading(format!(
            "{}: {}",
            bay.account.name,
            words::statement(&bay.volume()?)
        )));
        parts.push(Part::Bars(sources(bay)));
        parts.extend(density(bay).map(Part::Text));
    }
    parts.push(Part::Heading("What the sources are".to_owned()));
    let occurs = |source: &BudgetSource| {
        facts.bays.iter().any(|bay| bay.account.budget.var_of_m6(*source) > 0.0)
    };
    let rows = BudgetSource::ALL
        .into_iter()
        .filter(occurs)
        .map(|source| vec![words::source(source).to_owned(), words::meaning(source).to_owned()]);
    parts.push(Part::Table(Table {
        columns: vec![Column::words("Source", 1.2), Column::words("Errors of", 4.0)],
        rows: rows.collect(),
    }));
    Ok(parts)
}

fn sources(bay: &BayFacts) -> Bars {
    let budget = &bay.account.budget;
    let total_m6 = budget.var_m6();
    let mut rows = budget.largest_first();
    rows.retain(|row| {
        row.source != BudgetSource::Density && row.var_m6 > LEAST_SHARE * total_m6.max(0.0)
    });
    let sigma_m3 = |row: &BudgetRow| row.var_m6.max(0.0).sqrt();
    let largest_m3 = rows.iter().map(sigma_m3).fold(f64::MIN_POSITIVE, f64::max);
    let bar = |row: &BudgetRow| {
        let expanded = words::two_digits(2.0 * sigma_m3(row));
        let share = words::ratio(row.var_m6, total_m6);
        let said = format!("{expanded}\u{a0}m³, {share} of the variance");
        (words::source(row.source).to_owned(), vec![sigma_m3(row) / largest_m3], said)
    };
    Bars { parts: vec![("U by source", Tone::Blue)], rows: rows.iter().map(bar).collect() }
}

/// What the density adds to the tonnes.
fn density(bay: &BayFacts) -> Option<String> {
    let mass = bay.account.mass?;
    let of_density_m3 = bay.account.budget.var_of_m6(BudgetSource::Density).max(0.0).sqrt();
    let t_per_m3 = mass.mass_t / bay.account.estimate.volume_m3;
    Some(format!(
        "Tonnes: the volume's U of {}\u{a0}t and the density's of {}\u{a0}t give {}\u{a0}t.",
        words::two_digits(2.0 * t_per_m3 * bay.account.estimate.sigma_m3),
        words::two_digits(2.0 * t_per_m3 * of_density_m3),
        words::two_digits(2.0 * mass.sigma_t)
    ))
}
