//! What a report states: everything derived from the flight, the earlier survey and the books, once,
//! for all forms of the report.

use super::ReportError;
use super::books::{self, Amount, BookDifference, BookEntry, BookError};
use super::verdict::{Target, Verdict};
use crate::config::{BaseSection, BaySection};
use crate::mapping::bay::WHOLE_REGION;
use crate::mapping::statement::Statement;
use crate::messages::{BudgetSource, VolumeAccount};
use crate::record::Decision;
use crate::survey::{BayChange, ChangeReport, Flight, Origin, Reproduction, Survey, compare, ids};

/// What a report is asked for.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Wishes {
    /// What the site is called; stays the same in all reports of it.
    pub site: Option<String>,
    /// What the hall is called in the books: its id and those of its bays are made from this.
    pub hall: Option<String>,
    /// Who flew.
    pub operator: Option<String>,
    /// How sure volumes must be.
    pub target: Target,
    /// An earlier survey of the same bays.
    pub against: Option<Survey>,
    /// Errors that the surveys do not share although their configurations are equal.
    pub independent: Vec<Origin>,
    /// What the books say.
    pub books: Vec<BookEntry>,
    /// How often noise may be called significant, for each line by itself.
    pub risk: f64,
}

/// One volume with all that is said of it.
#[derive(Debug, Clone, PartialEq)]
pub struct BayFacts {
    /// The volume and its account, as recorded.
    pub account: VolumeAccount,
    /// Area that counts, m²; unknown without a surface.
    pub area_m2: Option<f64>,
    /// Where the base comes from.
    pub base: String,
    /// Standard deviation of the volume by the base alone, m³.
    pub base_sigma_m3: f64,
    /// Since the earlier survey, where that has the bay.
    pub change: Option<BayChange>,
    /// Against the books, where these have it.
    pub book: Option<BookDifference>,
    /// What becomes of it.
    pub verdict: Verdict,
    /// What is to be known before it is used.
    pub remarks: Vec<String>,
}

/// Everything a report states.
#[derive(Debug, Clone, PartialEq)]
pub struct Facts {
    /// The flight.
    pub flight: Flight,
    /// The whole region first, then its bays.
    pub bays: Vec<BayFacts>,
    /// What was asked for.
    pub wishes: Wishes,
    /// What has changed since the earlier survey.
    pub changes: Option<ChangeReport>,
    /// What is to be known of the survey as a whole.
    pub remarks: Vec<String>,
    /// The build that reports, in all forms of the report.
    pub reported_by: String,
}

/// Share of the hits that may be of dust, edges and machines before it is remarked.
const REFUSED_REMARK: f64 = 0.05;
/// Share of the camera frames that may be refused before it is remarked.
const FRAMES_REMARK: f64 = 0.2;

impl Facts {
    /// Gathers what a report states.
    ///
    /// # Errors
    /// An earlier survey of something else, or books that do not fit.
    pub fn new(flight: Flight, wishes: Wishes) -> Result<Self, ReportError> {
        Self::reported_by(crate::record::build_identity(), flight, wishes)
    }

    /// The same, as another build has said it: to make its report again.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn reported_by(
        reported_by: String,
        flight: Flight,
        wishes: Wishes,
    ) -> Result<Self, ReportError> {
        let changes = match &wishes.against {
            None => None,
            Some(earlier) => {
                let independent = &wishes.independent;
                Some(compare(earlier, &flight.survey(), wishes.risk, independent)?)
            }
        };
        check_books(&flight, &wishes.books)?;
        let remarks = remarks(&flight, &reported_by);
        let areas_m2: Vec<f64> =
            flight.bays_on_surface().iter().map(|bay| bay.base.area_m2()).collect();
        let bays = flight.accounts.iter().enumerate().map(|(index, account)| {
            let change = changes.as_ref().and_then(|changes| {
                changes.bays.iter().find(|change| change.name == account.name).cloned()
            });
            let entry = wishes.books.iter().find(|entry| entry.bay == account.name);
            let compared = |amount: Amount| books::compare(account, amount, wishes.risk);
            let book = entry.map(|entry| compared(entry.amount)).transpose()?;
            let mut of_bay = bay_remarks(&flight, account);
            let has_remarks = !remarks.is_empty() || !of_bay.is_empty();
            let (mut verdict, own) = wishes.target.judge(account, flight.is_final, has_remarks);
            if flight.decision.as_ref().is_some_and(Decision::is_rejection) {
                verdict = Verdict::Repeat;
            }
            of_bay.extend(own);
            Ok(BayFacts {
                account: account.clone(),
                area_m2: areas_m2.get(index).copied(),
                base: base_of(&flight, &account.name),
                base_sigma_m3: account.budget.var_of_m6(BudgetSource::Base).max(0.0).sqrt(),
                change,
                book,
                verdict,
                remarks: of_bay,
            })
        });
        let bays = bays.collect::<Result<_, BookError>>()?;
        Ok(Self { bays, changes, remarks, flight, wishes, reported_by })
    }

    /// The hall's id in the books, where the hall is named.
    #[must_use]
    pub fn hall_id(&self) -> Option<String> {
        self.wishes.hall.as_deref().map(ids::of_hall)
    }

    /// A bay's id in the books, where the hall is named.
    #[must_use]
    pub fn bay_id(&self, bay: &BayFacts) -> Option<String> {
        Some(ids::of_bay(&self.hall_id()?, &bay.account.name))
    }

    /// A bay as configured; none for the whole hall beside its bays.
    #[must_use]
    pub fn section(&self, bay: &BayFacts) -> Option<&BaySection> {
        self.flight.config.bays.iter().find(|section| section.name == bay.account.name)
    }

    /// The verdict on all of it: the worst.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        self.bays.iter().map(|bay| bay.verdict).max().unwrap_or(Verdict::Repeat)
    }
}

impl BayFacts {
    /// V ± U (k = 2), m³, rounded.
    ///
    /// # Errors
    /// Numbers that cannot be stated.
    pub fn volume(&self) -> Result<Statement, ReportError> {
        let estimate = &self.account.estimate;
        Ok(Statement::of_volume(estimate.volume_m3, estimate.sigma_m3)?)
    }

    /// The mass ± its U (k = 2), t, rounded; none without a density.
    ///
    /// # Errors
    /// Numbers that cannot be stated.
    pub fn mass(&self) -> Result<Option<Statement>, ReportError> {
        let mass = self.account.mass.map(|mass| Statement::of_mass(mass.mass_t, mass.sigma_t));
        Ok(mass.transpose()?)
    }
}

fn check_books(flight: &Flight, entries: &[BookEntry]) -> Result<(), BookError> {
    let measured = || flight.accounts.iter().map(|account| account.name.clone());
    match entries.iter().find(|entry| !measured().any(|name| name == entry.bay)) {
        None => Ok(()),
        Some(entry) => {
            Err(BookError::Unknown { bay: entry.bay.clone(), measured: measured().collect() })
        }
    }
}

/// What is to be known of the survey as a whole.
#[expect(clippy::cast_precision_loss, reason = "counts of one flight")]
fn remarks(flight: &Flight, reported_by: &str) -> Vec<String> {
    let mut remarks = Vec::new();
    if let Some(decision) = flight.decision.as_ref().filter(|decision| decision.is_rejection()) {
        remarks.push(format!("the survey was {}", decision.said()));
    }
    if !flight.is_complete {
        remarks.push("the log ends early or has gaps".to_owned());
    }
    match flight.reproduction {
        Reproduction::Identical => {}
        Reproduction::Different => remarks.push(format!(
            "this build ({reported_by}) does not compute the recorded volumes again to the last bit; they \
             were written by {}",
            flight.build
        )),
        Reproduction::ResultsOnly => remarks.push(format!(
            "the survey was merged from {} and is computed again by `stockpilot merge`",
            flight.merged_from.join(", ")
        )),
    }
    if flight.summary.as_ref().is_some_and(|summary| !summary.is_complete) {
        remarks.push("the survey was cut short".to_owned());
    }
    let counts = &flight.counts;
    let refused = counts.refused as f64 / (counts.used as f64).max(1.0);
    if refused > REFUSED_REMARK {
        remarks.push(format!(
            "{:.0} % of the hits were not of the surface: dust, edges, machines",
            100.0 * refused
        ));
    }
    let (n_all, n_used) = (flight.fixes.n_all(), flight.fixes.n_used());
    let unused = 1.0 - n_used as f64 / (n_all as f64).max(1.0);
    if n_all > 0 && unused > FRAMES_REMARK {
        remarks.push(format!("{:.0} % of the camera frames were of no use", 100.0 * unused));
    }
    remarks
}

fn bay_remarks(flight: &Flight, account: &VolumeAccount) -> Vec<String> {
    let mut remarks = Vec::new();
    if account.budget.var_of_m6(BudgetSource::Base) <= 0.0 {
        remarks.push("the base counts as exact: no uncertainty of it is in U".to_owned());
    }
    if account.shares.disturbed_ratio > 0.0 {
        remarks.push(format!(
            "something moved over {:.1} % of the volume during the survey",
            100.0 * account.shares.disturbed_ratio
        ));
    }
    let section = flight.config.bays.iter().find(|bay| bay.name == account.name);
    if section.is_some_and(|bay| {
        bay.density_t_per_m3.is_some() && bay.density_sigma_t_per_m3.unwrap_or(0.0) <= 0.0
    }) {
        remarks
            .push("the density counts as exact: no uncertainty of it is in the tonnes".to_owned());
    }
    remarks
}

/// What a bay lies on, in words.
fn base_of(flight: &Flight, name: &str) -> String {
    let config = &flight.config;
    let hall = || match &config.hall.base {
        Some(base) => described(base),
        None => level(config.hall.base_height_m, config.hall.base_sigma_m),
    };
    match config.bays.iter().find(|bay| bay.name == name) {
        Some(bay) => bay.base.as_ref().map_or_else(hall, described),
        None if name == WHOLE_REGION && config.bays.iter().any(|bay| bay.base.is_some()) => {
            "the bases of its bays".to_owned()
        }
        None => hall(),
    }
}

fn level(height_m: f64, sigma_m: f64) -> String {
    format!("level at {height_m:.3} m ± {:.3} m", 2.0 * sigma_m)
}

fn described(base: &BaseSection) -> String {
    match base {
        BaseSection::Level { height_m, sigma_m } => level(*height_m, *sigma_m),
        BaseSection::Plane { height_m, slope: [x, y], sigma_m, .. } => format!(
            "plane at {height_m:.3} m ± {:.3} m, slope {:.2} % along x, {:.2} % along y",
            2.0 * sigma_m,
            100.0 * x,
            100.0 * y
        ),
        BaseSection::Survey { height_file, sigma_m, .. } => {
            let file = height_file.file_name().unwrap_or_default().to_string_lossy();
            format!("earlier survey {file} ± {:.3} m", 2.0 * sigma_m)
        }
        BaseSection::Triangulated { points_m, sigma_m, .. } => {
            format!("triangles between {} measured points ± {:.3} m", points_m.len(), 2.0 * sigma_m)
        }
    }
}
