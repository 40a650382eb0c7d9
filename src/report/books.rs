//! What the books say, beside what was measured.

use crate::mapping::statement::{Statement, StatementError};
use crate::messages::VolumeAccount;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// An amount as it stands in the books.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Amount {
    /// A volume, m³.
    VolumeM3(f64),
    /// A mass, t.
    MassT(f64),
}

/// One line of the books.
#[derive(Debug, Clone, PartialEq)]
pub struct BookEntry {
    /// Whose it is: a bay, or the whole hall.
    pub bay: String,
    /// How much there should be.
    pub amount: Amount,
}

/// Why the books cannot be compared with.
#[derive(Debug, thiserror::Error)]
pub enum BookError {
    /// The file cannot be read.
    #[error("cannot read the books: {0}")]
    Csv(#[from] csv::Error),
    /// A line has neither a volume nor a mass, or both.
    #[error("the books give {bay:?} not exactly one of volume_m3 and mass_t")]
    Amount {
        /// Whose.
        bay: String,
    },
    /// An amount that is none.
    #[error("the books give {bay:?} an amount of {value}")]
    BadAmount {
        /// Whose.
        bay: String,
        /// What.
        value: f64,
    },
    /// An argument that is no line of the books.
    #[error("{text:?} is no line of the books: write BAY=412.5m3 or BAY=660t")]
    Argument {
        /// The argument.
        text: String,
    },
    /// Nothing of that name was measured.
    #[error("the books have {bay:?}, the survey has {}", measured.join(", "))]
    Unknown {
        /// Whose.
        bay: String,
        /// What was measured.
        measured: Vec<String>,
    },
    /// Tonnes in the books of a bay without a density.
    #[error("the books have tonnes of {bay:?}, but its configuration has no density")]
    NoMass {
        /// Whose.
        bay: String,
    },
    /// A difference that cannot be stated.
    #[error("{bay}: {source}")]
    Statement {
        /// Whose.
        bay: String,
        /// Why.
        source: StatementError,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    bay: String,
    volume_m3: Option<f64>,
    mass_t: Option<f64>,
}

/// Reads a CSV file with the columns `bay` and `volume_m3` or `mass_t`; each line has one of the two.
///
/// # Errors
/// A file that cannot be read, or a line that makes no sense.
pub fn read_books(path: &Path) -> Result<Vec<BookEntry>, BookError> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(path)?;
    reader.deserialize::<Row>().map(|row| BookEntry::of(row?)).collect()
}

impl BookEntry {
    fn of(Row { bay, volume_m3, mass_t }: Row) -> Result<Self, BookError> {
        let amount = match (volume_m3, mass_t) {
            (Some(volume_m3), None) => Amount::VolumeM3(volume_m3),
            (None, Some(mass_t)) => Amount::MassT(mass_t),
            _ => return Err(BookError::Amount { bay }),
        };
        Self { bay, amount }.checked()
    }

    fn checked(self) -> Result<Self, BookError> {
        let (Amount::VolumeM3(value) | Amount::MassT(value)) = self.amount;
        if value.is_finite() {
            Ok(self)
        } else {
            Err(BookError::BadAmount { bay: self.bay, value })
        }
    }
}

impl std::str::FromStr for BookEntry {
    type Err = BookError;

    /// `BAY=412.5m3` or `BAY=660t`.
    fn from_str(text: &str) -> Result<Self, BookError> {
        let bad = || BookError::Argument { text: text.to_owned() };
        let (bay, amount) = text.rsplit_once('=').ok_or_else(bad)?;
        let number = |digits: &str| digits.trim().parse::<f64>().map_err(|_| bad());
        let amount = if let Some(digits) = amount.strip_suffix("m3") {
            Amount::VolumeM3(number(digits)?)
        } else if let Some(digits) = amount.strip_suffix('t') {
            Amount::MassT(number(digits)?)
        } else {
            return Err(bad());
        };
        Self { bay: bay.to_owned(), amount }.checked()
    }
}

/// What was measured less what the books say.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BookDifference {
    /// Unit of all amounts, `m³` or `t`.
    pub unit: &'static str,
    /// What the books say.
    pub book: f64,
    /// Measured less book.
    pub difference: f64,
    /// Standard deviation of that: the measurement's, for the books have none.
    pub sigma: f64,
    /// The difference with its expanded uncertainty, rounded.
    pub statement: String,
    /// How likely so large a difference is measured although the books are right.
    pub p_value: f64,
    /// The accepted risk of calling right books wrong.
    pub risk: f64,
    /// The books differ by more than the measurement may be wrong.
    pub is_significant: bool,
}

/// Compares an account with its line in the books.
///
/// # Errors
/// Tonnes in the books of a bay that has none, or a difference that cannot be stated.
pub(super) fn compare(
    account: &VolumeAccount,
    amount: Amount,
    risk: f64,
) -> Result<BookDifference, BookError> {
    let bay = || account.name.clone();
    let (unit, book, measured, sigma) = match amount {
        Amount::VolumeM3(book) => {
            ("m³", book, account.estimate.volume_m3, account.estimate.sigma_m3)
        }
        Amount::MassT(book) => {
            let mass = account.mass.ok_or_else(|| BookError::NoMass { bay: bay() })?;
            ("t", book, mass.mass_t, mass.sigma_t)
        }
    };
    let difference = measured - book;
    let statement = match unit {
        "t" => Statement::of_mass(difference, sigma),
        _ => Statement::of_volume(difference, sigma),
    }
    .map_err(|source| BookError::Statement { bay: bay(), source })?;
    // The probability that a normal error is at least as large, up or down.
    let p_value = if difference == 0.0 {
        1.0
    } else {
        libm::erfc(difference.abs() / (sigma * std::f64::consts::SQRT_2))
    };
    Ok(BookDifference {
        unit,
        book,
        difference,
        sigma,
        statement: statement.to_string(),
        p_value,
        risk,
        is_significant: p_value < risk,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Mass, VolumeBudget, VolumeEstimate, VolumeShares};
    use crate::time::Stamp;

    fn account() -> VolumeAccount {
        VolumeAccount {
            name: "gravel".to_owned(),
            estimate: VolumeEstimate {
                at: Stamp::ZERO,
                volume_m3: 412.6,
                sigma_m3: 2.5,
                coverage_ratio: 0.9,
            },
            mass: Some(Mass { mass_t: 660.0, sigma_t: 10.0 }),
            budget: VolumeBudget::default(),
            shares: VolumeShares::default(),
        }
    }

    #[test]
    fn two_sigma_are_just_significant_at_five_percent() {
        // erfc(2/√2) = 0.0455 (Abramowitz and Stegun, table 26.1)
        let off = compare(&account(), Amount::MassT(680.0), 0.05).expect("a difference");
        assert!((off.p_value - 0.0455).abs() < 1e-4 && off.is_significant);
        assert_eq!(off.statement, "(-20 ± 20) t (k = 2)");
        let near = compare(&account(), Amount::VolumeM3(410.0), 0.05).expect("a difference");
        assert!(!near.is_significant && near.unit == "m³");
        assert_eq!(near.statement, "(2.6 ± 5.0) m³ (k = 2)");
    }

    #[test]
    fn tonnes_need_a_density() {
        let account = VolumeAccount { mass: None, ..account() };
        let refused = compare(&account, Amount::MassT(1.0), 0.05);
        assert!(matches!(refused, Err(BookError::NoMass { .. })));
    }

    #[test]
    fn books_are_read_from_files_and_arguments() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("book.csv");
        std::fs::write(&path, "bay,volume_m3,mass_t\n\"gravel, coarse\",412.5,\nsalt,,660\n")
            .expect("a file");
        let books = read_books(&path).expect("books");
        assert_eq!(books[0].bay, "gravel, coarse");
        assert_eq!(books[0].amount, Amount::VolumeM3(412.5));
        assert_eq!(books[1].amount, Amount::MassT(660.0));
        assert_eq!("salt=660t".parse::<BookEntry>().expect("an entry"), books[1]);
        assert_eq!(
            "a=b=1.5m3".parse::<BookEntry>().expect("an entry"),
            BookEntry { bay: "a=b".to_owned(), amount: Amount::VolumeM3(1.5) }
        );
        for bad in ["salt", "salt=660", "salt=t", "salt=nant", "salt=infm3"] {
            assert!(bad.parse::<BookEntry>().is_err(), "{bad}");
        }
        for bad in [
            "bay,volume_m3,mass_t\nsalt,1,2\n",
            "bay,volume_m3,mass_t\nsalt,,\n",
            "bay,tons\nsalt,1\n",
        ] {
            std::fs::write(&path, bad).expect("a file");
            assert!(read_books(&path).is_err(), "{bad}");
        }
    }
}
