//! From facts to what people read.

use super::ReportError;
use super::content::{Bars, Column, Content, Headline, Part, Table, Tone};
use super::facts::{BayFacts, Facts};
use super::{method, pictures, words};
use crate::mapping::statement::Statement;
use crate::messages::BudgetSource;
use crate::survey::Origin;

/// What stands below every page.
const FOOTER: &str = "Not a legal-for-trade measurement. U: expanded uncertainty, k = 2, about 95 %.";

/// The whole report; `log_sha256` names the log.
pub(super) fn content(facts: &Facts, log_sha256: &str) -> Result<Content, ReportError> {
    let mut parts = front(facts)?;
    parts.push(Part::NewPage);
    parts.extend(picture_pages(facts)?);
    parts.push(Part::NewPage);
    parts.extend(budget(facts)?);
    parts.push(Part::NewPage);
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
    parts.push(Part::Heading("Since the last survey".to_owned()));
    parts.extend(changes(facts));
    parts.push(Part::Heading("Against the books".to_owned()));
    parts.push(books(facts));
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

fn changes(facts: &Facts) -> Vec<Part> {
    let (Some(report), Some(earlier)) = (&facts.changes, &facts.wishes.against) else {
        return vec![Part::Text("No earlier survey was given.".to_owned())];
    };
    let row = |bay: &BayFacts| {
        let change = bay.change.as_ref()?;
        let stated = change.change.statement().map_or_else(|e| e.to_string(), |s| words::amounts(&s));
        let mass = change.mass.map_or_else(
            || "–".to_owned(),
            |mass| {
                let stated = Statement::of_mass(mass.mass_t, mass.sigma_t);
                stated.map_or_else(|e| e.to_string(), |s| words::amounts(&s))
            },
        );
        Some(vec![
            bay.account.name.clone(),
            format!("{:.1}", change.earlier.volume_m3),
            stated,
            mass,
            words::significance(change.change.p_value, change.change.risk),
        ])
    };
    let file = earlier.path.file_name().unwrap_or_default().to_string_lossy();
    let shared: Vec<&str> = report.shared.iter().map(|origin: &Origin| origin.name()).collect();
    let cancelled = if shared.is_empty() { "none".to_owned() } else { shared.join(", ") };
    vec![
        Part::Table(Table {
            columns: vec![
                Column::words("Measured", 1.8),
                Column::numbers("Earlier, m³", 1.2),
                Column::numbers("Change ± U, m³", 1.7),
                Column::numbers("Change ± U, t", 1.7),
                Column::numbers("Significance", 2.4),
            ],
            rows: facts.bays.iter().filter_map(row).collect(),
        }),
        Part::Text(format!(
            "Against {file}. Errors that both surveys share cancel: {cancelled}. Significant: seen \
             without a change with a probability below {} %.",
            100.0 * facts.wishes.risk
        )),
    ]
}

fn books(facts: &Facts) -> Part {
    let row = |bay: &BayFacts| {
        let book = bay.book.as_ref()?;
        Some(vec![
            bay.account.name.clone(),
            format!("{} {}", words::plain(book.book), book.unit),
            book.statement.replace(" (k = 2)", ""),
            words::significance(book.p_value, book.risk),
        ])
    };
    let rows: Vec<Vec<String>> = facts.bays.iter().filter_map(row).collect();
    if rows.is_empty() {
        return Part::Text("No books were given.".to_owned());
    }
    Part::Table(Table {
        columns: vec![
            Column::words("Measured", 1.8),
            Column::numbers("Book", 1.4),
            Column::numbers("Measured less book ± U", 2.4),
            Column::numbers("Significance", 2.4),
        ],
        rows,
    })
}

fn remarks(facts: &Facts) -> Vec<String> {
    let of_bay = |bay: &BayFacts| -> Vec<String> {
        let name = &bay.account.name;
        bay.remarks.iter().map(|remark| format!("{name}: {remark}.")).collect()
    };
    let of_all = facts.remarks.iter().map(|remark| format!("{}.", words::capital(remark)));
    of_all.chain(facts.bays.iter().flat_map(of_bay)).collect()
}

fn picture_pages(facts: &Facts) -> Result<Vec<Part>, ReportError> {
    let flight = &facts.flight;
    let bays = flight.bays_on_surface();
    let mut maps = pictures::maps(flight, &bays)?;
    let earlier = facts.wishes.against.as_ref();
    if let Some(earlier) = earlier.and_then(|survey| survey.surface.as_ref()) {
        maps.extend(pictures::change(flight, &bays, earlier)?);
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
        parts.push(Part::Heading(format!(
            "{}: {}",
            bay.account.name,
            words::statement(&bay.volume()?)
        )));
        parts.push(Part::Bars(sources(bay)));
    }
    parts.push(Part::Heading("What the sources are".to_owned()));
    let rows = BudgetSource::ALL
        .into_iter()
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
    let rows = budget.largest_first();
    let shown = rows.iter().filter(|row| row.var_m6 > LEAST_SHARE * total_m6.max(0.0));
    let largest_m3 =
        rows.iter().map(|row| row.var_m6.max(0.0).sqrt()).fold(f64::MIN_POSITIVE, f64::max);
    let bar = |row: &crate::messages::BudgetRow| {
        let sigma_m3 = row.var_m6.max(0.0).sqrt();
        let length = sigma_m3 / largest_m3;
        let expanded = words::two_digits(2.0 * sigma_m3);
        let is_of_volume = row.source != BudgetSource::Density;
        let said = if is_of_volume {
            format!("{expanded} m³  ({} of the variance)", words::ratio(row.var_m6, total_m6))
        } else {
            format!("{expanded} m³  (in the tonnes only)")
        };
        let lengths = if is_of_volume { vec![length, 0.0] } else { vec![0.0, length] };
        (words::source(row.source).to_owned(), lengths, said)
    };
    Bars {
        parts: vec![("in the volume", Tone::Blue), ("in the tonnes only", Tone::Grey)],
        rows: shown.map(bar).collect(),
    }
}
