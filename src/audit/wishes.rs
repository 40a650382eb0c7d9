//! What a report was asked for, so that it can be made again from the pack alone.

use super::{AuditError, EARLIER, at};
use crate::export::sha256_of_file;
use crate::report::{Amount, BookEntry, Target, Wishes};
use crate::survey::{Origin, Survey};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The wishes in a pack.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PackedWishes {
    /// Which survey of the log, from 1.
    pub(super) flight: usize,
    site: Option<String>,
    hall: Option<String>,
    operator: Option<String>,
    target_percent: f64,
    target_least_m3: f64,
    risk: f64,
    /// The earlier survey, whose log lies in the pack.
    pub(super) against: Option<PackedEarlier>,
    independent: Vec<String>,
    books: Vec<PackedBook>,
}

/// The earlier survey of a report.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PackedEarlier {
    /// What its log is called outside of the pack; the report names it.
    file: String,
    pub(super) sha256: String,
    /// Which survey of it, from 1; the last in packs that do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    flight: Option<usize>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PackedBook {
    bay: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    volume_m3: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mass_t: Option<f64>,
}

impl PackedWishes {
    /// The wishes of a report on the survey of this number.
    pub(super) fn new(flight: usize, wishes: &Wishes) -> Result<Self, AuditError> {
        let against = wishes.against.as_ref().map(|survey| {
            let file = survey.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let sha256 = sha256_of_file(&survey.path).map_err(at(&survey.path))?;
            Ok::<_, AuditError>(PackedEarlier { file, sha256, flight: Some(survey.place.number) })
        });
        Ok(Self {
            flight,
            site: wishes.site.clone(),
            hall: wishes.hall.clone(),
            operator: wishes.operator.clone(),
            target_percent: wishes.target.percent,
            target_least_m3: wishes.target.least_m3,
            risk: wishes.risk,
            against: against.transpose()?,
            independent: wishes.independent.iter().map(|origin| origin.name().to_owned()).collect(),
            books: wishes.books.iter().map(PackedBook::from).collect(),
        })
    }

    /// The same wishes, with the earlier log of the pack in `folder`.
    pub(super) fn unpacked(&self, folder: &Path) -> Result<Wishes, AuditError> {
        let against = self.against.as_ref().map(|earlier| {
            let survey = Survey::read_one(&folder.join(EARLIER), earlier.flight)?;
            Ok::<_, AuditError>(Survey { path: PathBuf::from(&earlier.file), ..survey })
        });
        let is_named = |origin: &Origin| self.independent.iter().any(|name| name == origin.name());
        Ok(Wishes {
            site: self.site.clone(),
            hall: self.hall.clone(),
            operator: self.operator.clone(),
            target: Target { percent: self.target_percent, least_m3: self.target_least_m3 },
            risk: self.risk,
            against: against.transpose()?,
            independent: Origin::ALL.into_iter().filter(is_named).collect(),
            books: self.books.iter().filter_map(PackedBook::entry).collect(),
        })
    }
}

impl From<&BookEntry> for PackedBook {
    fn from(entry: &BookEntry) -> Self {
        let (volume_m3, mass_t) = match entry.amount {
            Amount::VolumeM3(volume_m3) => (Some(volume_m3), None),
            Amount::MassT(mass_t) => (None, Some(mass_t)),
        };
        Self { bay: entry.bay.clone(), volume_m3, mass_t }
    }
}

impl PackedBook {
    fn entry(&self) -> Option<BookEntry> {
        let mass = self.mass_t.map(Amount::MassT);
        let amount = self.volume_m3.map(Amount::VolumeM3).or(mass)?;
        Some(BookEntry { bay: self.bay.clone(), amount })
    }
}
