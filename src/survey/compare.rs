//! `stockpilot change`: what has changed between two surveys of the same bays.
//!
//! Which constant errors both surveys have is read from their configurations:
//!
//! | errors | shared if |
//! | --- | --- |
//! | LiDAR: mounting, range bias and scale | model, mounting, the calibrated bias and scale, and their σ are equal |
//! | marker map | all tags, points and their σ are equal |
//! | base | the bases of the hall and of all bays are equal |
//! | clock | never: it is compared anew after each start |
//!
//! All else is independent. The volume under ground that neither survey saw counts as changed
//! independently, which is too careful where nothing moved.
//!
//! Both must measure the same ground on the same cells, and leave out the same: exclusions, their
//! margin and the obstacles that stand on the floor. The hall's own volume is the sum of its bays,
//! so it is compared only where both surveys have bays of the same outlines.

use crate::config::{BaySection, Config, ConfigError};
use crate::mapping::bay::WHOLE_REGION;
use crate::mapping::change::{Change, ChangeError, ChangeVerdict, SurveyVolume, change};
use crate::mapping::density::Density;
use crate::mapping::region::Region;
use crate::mapping::statement::Statement;
use crate::messages::{BudgetSource, HeightMap, Mass, VolumeAccount, VolumeEstimate};
use crate::record::replay::ReplayError;
use crate::record::{SurveyPlace, read_accounts_of};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

/// A group of constant errors with a common origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Origin {
    /// The LiDAR on its vehicle.
    Lidar,
    /// The marker map.
    Markers,
    /// What the material lies on.
    Base,
}

impl Origin {
    /// Every origin.
    pub const ALL: [Self; 3] = [Self::Lidar, Self::Markers, Self::Base];

    /// A short stable name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lidar => "lidar",
            Self::Markers => "markers",
            Self::Base => "base",
        }
    }

    /// Where the constant errors of a source come from; none if surveys never share them.
    #[must_use]
    pub const fn of(source: BudgetSource) -> Option<Self> {
        match source {
            BudgetSource::LidarMounting | BudgetSource::RangeBias | BudgetSource::RangeScale => {
                Some(Self::Lidar)
            }
            BudgetSource::MarkerMap => Some(Self::Markers),
            BudgetSource::Base => Some(Self::Base),
            BudgetSource::Prior
            | BudgetSource::BeamNoise
            | BudgetSource::Roughness
            | BudgetSource::Occlusion
            | BudgetSource::HiddenGround
            | BudgetSource::Pose
            | BudgetSource::ClockOffset
            | BudgetSource::Density => None,
        }
    }
}

/// A survey as its log has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// The log.
    pub path: PathBuf,
    /// Its configuration.
    pub config: Config,
    /// Which survey of the log it is.
    pub place: SurveyPlace,
    /// The whole region first, then its bays.
    pub accounts: Vec<VolumeAccount>,
    /// The newest surface, if the log holds one.
    pub surface: Option<HeightMap>,
    /// The volumes are those after the landing.
    pub is_final: bool,
}

/// Why surveys cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum SurveyError {
    /// A log cannot be read.
    #[error("{}: {source}", path.display())]
    Log {
        /// Which.
        path: PathBuf,
        /// Why.
        source: ReplayError,
    },
    /// Its configuration cannot be read.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// It holds no volume.
    #[error(
        "{} holds no volume; if it is cut, `stockpilot merge` computes one from what it has",
        path.display()
    )]
    NoVolume {
        /// Which.
        path: PathBuf,
    },
    /// The surveys do not measure the same.
    #[error("{what} is not the same in both surveys: their volumes cannot be compared")]
    Different {
        /// What.
        what: String,
    },
    /// The budgets do not fit.
    #[error("{bay}: {source}")]
    Change {
        /// Which bay.
        bay: String,
        /// Why.
        source: ChangeError,
    },
}

/// One bay, or the whole hall, in both surveys.
#[derive(Debug, Clone, PartialEq)]
pub struct BayChange {
    /// Its name.
    pub name: String,
    /// The earlier volume.
    pub earlier: VolumeEstimate,
    /// The later volume.
    pub later: VolumeEstimate,
    /// The change.
    pub change: Change,
    /// The change of mass, where densities are configured.
    pub mass: Option<Mass>,
}

/// The change between two surveys.
#[derive(Debug, Clone, PartialEq)]
pub struct ChangeReport {
    /// The whole hall first, unless it is left out, then the bays that both surveys have.
    pub bays: Vec<BayChange>,
    /// The whole hall is not compared: it is the sum of its bays, and their outlines are not the same.
    pub is_hall_left_out: bool,
    /// Origins of errors that both surveys share.
    pub shared: Vec<Origin>,
    /// Bays of the earlier survey only.
    pub only_earlier: Vec<String>,
    /// Bays of the later survey only.
    pub only_later: Vec<String>,
}

impl Survey {
    /// Reads the last survey with volumes of a log, or what `stockpilot merge` has written.
    ///
    /// # Errors
    /// As [`Self::read_one`].
    pub fn read(path: &Path) -> Result<Self, SurveyError> {
        Self::read_one(path, None)
    }

    /// Reads the newest volumes of the survey with this number in a log, or of the last one.
    ///
    /// # Errors
    /// A log that cannot be read, or a survey that it does not hold or that has no volume.
    pub fn read_one(path: &Path, number: Option<usize>) -> Result<Self, SurveyError> {
        let read = read_accounts_of(path, number)
            .map_err(|source| SurveyError::Log { path: path.to_owned(), source })?;
        if read.accounts.is_empty() {
            return Err(SurveyError::NoVolume { path: path.to_owned() });
        }
        Ok(Self {
            path: path.to_owned(),
            config: Config::from_log(&read.config_toml, path)?,
            place: read.place,
            accounts: read.accounts,
            surface: read.surface,
            is_final: read.is_final,
        })
    }

    /// The densities of the bays, by name.
    fn densities(&self) -> BTreeMap<&str, Density> {
        let of = |mean: Option<f64>, sigma: Option<f64>| {
            Some(Density { mean_t_per_m3: mean?, sigma_t_per_m3: sigma.unwrap_or(0.0) })
        };
        let hall = &self.config.hall;
        let of_hall = of(hall.density_t_per_m3, hall.density_sigma_t_per_m3);
        let of_bay = |bay: &'_ BaySection| of(bay.density_t_per_m3, bay.density_sigma_t_per_m3);
        let bays = self.config.bays.iter().map(|bay| (bay.name.as_str(), of_bay(bay)));
        let all = bays.chain([(WHOLE_REGION, of_hall)]);
        all.filter_map(|(name, density)| Some((name, density?))).collect()
    }
}

/// The change from one survey to another; `independent` names origins whose errors are not the same
/// although the configurations are, such as those of a second vehicle of the same build.
///
/// # Errors
/// Surveys of different regions, or budgets that contradict each other.
pub fn compare(
    earlier: &Survey,
    later: &Survey,
    risk: f64,
    independent: &[Origin],
) -> Result<ChangeReport, SurveyError> {
    let is_hall_left_out = !has_equal_ground(&earlier.config, &later.config)?;
    let shared: Vec<Origin> = Origin::ALL
        .into_iter()
        .filter(|origin| is_same(*origin, &earlier.config, &later.config))
        .filter(|origin| !independent.contains(origin))
        .collect();
    let is_shared =
        |source| Origin::of(source).is_some_and(|origin: Origin| shared.contains(&origin));
    let mut bays = Vec::new();
    let in_later = |name: &str| later.accounts.iter().find(|account| account.name == name);
    for before in &earlier.accounts {
        let Some(after) = in_later(&before.name) else { continue };
        if is_hall_left_out && before.name == WHOLE_REGION {
            continue;
        }
        let of = |account: &VolumeAccount| account.estimate.volume_m3;
        let change = change(
            SurveyVolume { volume_m3: of(before), budget: &before.budget },
            SurveyVolume { volume_m3: of(after), budget: &after.budget },
            risk,
            is_shared,
        )
        .map_err(|source| SurveyError::Change { bay: before.name.clone(), source })?;
        bays.push(BayChange {
            name: before.name.clone(),
            earlier: before.estimate,
            later: after.estimate,
            change,
            mass: mass(&change, (earlier, before), (later, after)),
        });
    }
    let only = |these: &Survey, those: &Survey| {
        let is_there = |name: &str| those.accounts.iter().any(|account| account.name == name);
        let names = these.accounts.iter().map(|account| account.name.clone());
        names.filter(|name| !is_there(name)).collect()
    };
    Ok(ChangeReport {
        bays,
        is_hall_left_out,
        shared,
        only_earlier: only(earlier, later),
        only_later: only(later, earlier),
    })
}

/// Checks that what both surveys have can be compared; true if the bays of both together are the same
/// ground.
fn has_equal_ground(a: &Config, b: &Config) -> Result<bool, SurveyError> {
    let differs = |what: &str| Err(SurveyError::Different { what: what.to_owned() });
    if a.hall.region != b.hall.region {
        return differs("hall.region");
    }
    if a.surface.cell_m.to_bits() != b.surface.cell_m.to_bits() {
        return differs("surface.cell_m");
    }
    let (of_a, of_b) = (a.measured_region()?, b.measured_region()?);
    if of_a.exclusion_margin_m.to_bits() != of_b.exclusion_margin_m.to_bits() {
        return differs("hall.exclusion_margin_m");
    }
    if !is_same_set(&of_a.exclusions, &of_b.exclusions) {
        return differs("the set of exclusions and of obstacles that stand on the floor");
    }
    for bay in &a.bays {
        let same_name = b.bays.iter().find(|other| other.name == bay.name);
        if same_name.is_some_and(|other| other.polygon_m != bay.polygon_m) {
            return differs(&format!("the outline of bay {:?}", bay.name));
        }
    }
    if a.bays.is_empty() != b.bays.is_empty() {
        return differs("the ground that counts (one has bays, the other none)");
    }
    let outlines =
        |region: &Region| -> Vec<_> { region.bays.iter().map(|bay| bay.outline.clone()).collect() };
    Ok(is_same_set(&outlines(&of_a), &outlines(&of_b)))
}

/// True if each of these is among those and the other way round.
fn is_same_set<T: PartialEq>(these: &[T], those: &[T]) -> bool {
    these.iter().all(|item| those.contains(item)) && those.iter().all(|item| these.contains(item))
}

/// True if the configurations say that both surveys have the same errors of this origin.
fn is_same(origin: Origin, a: &Config, b: &Config) -> bool {
    let (u, v) = (&a.surface.uncertainty, &b.surface.uncertainty);
    let same = |x: f64, y: f64| x.to_bits() == y.to_bits();
    match origin {
        // The port's name changes with the socket that it is plugged into.
        Origin::Lidar => {
            a.lidar.model == b.lidar.model
                && a.lidar.mount == b.lidar.mount
                // What is taken off the ranges: a new calibration has a new error.
                && same(a.lidar.range_bias_m, b.lidar.range_bias_m)
                && same(a.lidar.range_scale, b.lidar.range_scale)
                && same(u.range_bias_sigma_m, v.range_bias_sigma_m)
                && same(u.range_scale_sigma, v.range_scale_sigma)
                && same(u.mount_position_sigma_m, v.mount_position_sigma_m)
                && same(u.mount_rotation_sigma_deg, v.mount_rotation_sigma_deg)
        }
        Origin::Markers => {
            a.tags == b.tags
                && a.points == b.points
                && same(u.marker_sigma_m, v.marker_sigma_m)
                && same(u.marker_datum_sigma_m, v.marker_datum_sigma_m)
        }
        Origin::Base => {
            let of_hall = |c: &Config| (c.hall.base.clone(), c.hall.base_height_m.to_bits());
            let bases = |c: &Config| -> Vec<_> {
                c.bays.iter().map(|bay| (bay.name.clone(), bay.base.clone())).collect()
            };
            of_hall(a) == of_hall(b)
                && same(a.hall.base_sigma_m, b.hall.base_sigma_m)
                && bases(a) == bases(b)
        }
    }
}

/// The change of mass: of one material by its density, else the difference of two masses whose
/// errors count as independent.
fn mass(
    change: &Change,
    (earlier, before): (&Survey, &VolumeAccount),
    (later, after): (&Survey, &VolumeAccount),
) -> Option<Mass> {
    let (m1, m2) = (before.mass?, after.mass?);
    let (all1, all2) = (earlier.densities(), later.densities());
    let name = before.name.as_str();
    // The hall has a mass if all its bays have one density.
    let of = |all: &BTreeMap<&str, Density>| all.get(name).or_else(|| all.values().next()).copied();
    match (of(&all1), of(&all2)) {
        (Some(rho1), Some(rho2)) if rho1 == rho2 => Some(change.mass(&rho1)),
        _ => Some(Mass { mass_t: m2.mass_t - m1.mass_t, sigma_t: m1.sigma_t.hypot(m2.sigma_t) }),
    }
}

impl fmt::Display for BayChange {
    /// `gravel: (12.0 ± 4.0) m³ (k = 2), significant (p = 0.0012 …)`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let change = &self.change;
        write!(f, "{}: {}", self.name, super::table::stated(change.statement()))?;
        if let Some(mass) = self.mass {
            write!(f, ", {}", super::table::stated(Statement::of_mass(mass.mass_t, mass.sigma_t)))?;
        }
        let percent = 100.0 * change.risk;
        match change.verdict {
            ChangeVerdict::Significant => write!(
                f,
                ", significant (without a change so much is seen with a probability of {:.2e}, \
                 accepted {percent} %)",
                change.p_value,
            ),
            ChangeVerdict::Noise => write!(
                f,
                ", noise (so much is seen without a change with a probability of {:.2}, accepted \
                 {percent} %; a change of {:.1} m³ would be noticed in 80 % of all cases)",
                change.p_value, change.detectable_m3,
            ),
        }
    }
}

#[cfg(test)]
mod tests;
