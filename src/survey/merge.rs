//! `stockpilot merge`: one map of several logs.

use crate::config::{Config, ConfigError};
use crate::mapping::footprint::Footprint;
use crate::mapping::merge::{FlightTurns, MergeError, merged};
use crate::mapping::{Mapper, SolveError};
use crate::messages::{HeightMap, HitCounts, VolumeAccount};
use crate::pilot::{self, Action, FlightSummary, Pilot};
use crate::record::replay::ReplayError;
use crate::record::{LogHeader, LoggedFlights, RecordError, Recorder, read_flights};
use crate::time::{Mono, Stamp};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What the caller knows of the logs and they do not say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MergeOptions {
    /// Every log is of a vehicle of its own. Else logs with the same LiDAR, mounted alike, are of
    /// one vehicle.
    pub separate_vehicles: bool,
    /// All flights of each log count, not the last one only.
    pub all_flights: bool,
}

/// Why logs have no common map.
#[derive(Debug, thiserror::Error)]
pub enum MergeLogsError {
    /// A log cannot be read.
    #[error("{}: {source}", path.display())]
    Log {
        /// Which.
        path: PathBuf,
        /// Why.
        source: ReplayError,
    },
    /// The configuration in a log does not work with this build.
    #[error("{}: {source}", path.display())]
    Config {
        /// Which.
        path: PathBuf,
        /// Why.
        source: ConfigError,
    },
    /// A log without a turn over the material.
    #[error(
        "{} holds no flight that measured with surface.method = \"matern-field\"",
        path.display()
    )]
    NoFlight {
        /// Which.
        path: PathBuf,
    },
    /// Two logs have another marker map.
    #[error(
        "{} has other tags or points than {}: their hall is not the same",
        path.display(),
        first.display()
    )]
    Markers {
        /// Which.
        path: PathBuf,
        /// The first log.
        first: PathBuf,
    },
    /// Two logs hold the same flight, which must not count twice.
    #[error("{} and {} hold the same flight", path.display(), first.display())]
    SameFlight {
        /// Which.
        path: PathBuf,
        /// The one that came before.
        first: PathBuf,
    },
    /// Two logs measure different things.
    #[error("{}: {source}", path.display())]
    Different {
        /// The log that does not fit the first one.
        path: PathBuf,
        /// What differs.
        source: MergeError,
    },
    /// The common map cannot be solved.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// The merged log cannot be written.
    #[error(transparent)]
    Write(#[from] RecordError),
}

/// What one log gave.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MergedLog {
    /// The log.
    pub path: PathBuf,
    /// Flights taken from it.
    pub n_flights: usize,
    /// Turns of the scanner in them.
    pub n_turns: usize,
    /// Number of its vehicle, from 0.
    pub vehicle_idx: usize,
    /// It has its proper end and no gap.
    pub is_complete: bool,
}

/// One survey of several flights.
#[derive(Debug, Clone, PartialEq)]
pub struct MergedSurvey {
    /// The whole region first, then its bays.
    pub accounts: Vec<VolumeAccount>,
    /// The surface.
    pub surface: HeightMap,
    /// Where the beams of all logs went.
    pub hits: HitCounts,
    /// What each log gave.
    pub logs: Vec<MergedLog>,
    /// Configuration of the first log, TOML.
    pub config_toml: String,
}

/// A log with what was read from it.
struct Source {
    path: PathBuf,
    settings: pilot::Settings,
    read: LoggedFlights,
    vehicle_idx: usize,
}

/// The turns of all logs in one map, not solved yet.
pub(super) struct Joined {
    /// The map.
    pub(super) mapper: Mapper,
    /// The last instant of any log.
    pub(super) at: Stamp<Mono>,
    sources: Vec<Source>,
}

/// Reads the flights of all logs again and solves one map of all their turns.
///
/// # Errors
/// A log that cannot be read, holds nothing, or measures something else than the first.
pub fn merge_logs(logs: &[PathBuf], options: MergeOptions) -> Result<MergedSurvey, MergeLogsError> {
    let Joined { mapper, at, sources } = join(logs, options)?;
    let solved = mapper.snapshot(at, true).run()?;
    let mut hits = HitCounts::default();
    sources.iter().for_each(|source| hits += source.read.hits);
    hits.refused = solved.n_beams_refused;
    Ok(MergedSurvey {
        accounts: solved.accounts,
        surface: solved.surface,
        hits,
        logs: sources.iter().map(Source::summary).collect(),
        config_toml: sources.into_iter().next().map_or_else(String::new, |s| s.read.config_toml),
    })
}

/// Reads the flights of all logs again, into one map.
pub(super) fn join(logs: &[PathBuf], options: MergeOptions) -> Result<Joined, MergeLogsError> {
    let mut sources: Vec<Source> = Vec::new();
    for path in logs {
        let mut source = read(path, options)?;
        check(&source, &sources)?;
        source.vehicle_idx = vehicle_of(&source, &sources, options);
        sources.push(source);
    }
    let flights: Vec<(&Source, FlightTurns<'_>)> = sources
        .iter()
        .flat_map(|source| source.read.flights.iter().map(move |turns| (source, turns)))
        .map(|(source, turns)| {
            let (settings, vehicle_idx) = (&source.settings.mapping, source.vehicle_idx);
            (source, FlightTurns { settings, vehicle_idx, turns })
        })
        .collect();
    let turns: Vec<FlightTurns<'_>> = flights.iter().map(|(_, turns)| turns.clone()).collect();
    let mapper = merged(&turns).map_err(|source| {
        let index = match source {
            MergeError::Different { flight, .. } | MergeError::Vehicle { flight } => flight,
            MergeError::NoFlight | MergeError::Method => 0,
        };
        let path = flights.get(index).map_or_else(PathBuf::new, |(of, _)| of.path.clone());
        MergeLogsError::Different { path, source }
    })?;
    let at = sources.iter().map(|source| source.read.last_at).fold(Stamp::ZERO, Stamp::max);
    Ok(Joined { mapper, at, sources })
}

fn read(path: &Path, options: MergeOptions) -> Result<Source, MergeLogsError> {
    let of_config = |source: ConfigError| MergeLogsError::Config { path: path.to_owned(), source };
    let mut settings = None;
    let make_pilot = |toml: &str| -> Result<Pilot, ConfigError> {
        let found = Config::from_log(toml, path)?.pilot_settings()?;
        settings = Some(found.clone());
        Ok(Pilot::new(found))
    };
    let read = read_flights(path, make_pilot)
        .map_err(|source| MergeLogsError::Log { path: path.to_owned(), source })?;
    let settings = match settings {
        Some(settings) => settings,
        None => Config::from_log(&read.config_toml, path)
            .and_then(|config| config.pilot_settings())
            .map_err(of_config)?,
    };
    let mut read = read;
    if !options.all_flights {
        // The flights before may have measured other material.
        let first_kept = read.flights.len().saturating_sub(1);
        read.flights.drain(..first_kept);
    }
    if read.flights.is_empty() {
        return Err(MergeLogsError::NoFlight { path: path.to_owned() });
    }
    Ok(Source { path: path.to_owned(), settings, read, vehicle_idx: 0 })
}

/// Checks a log against those before it.
fn check(source: &Source, before: &[Source]) -> Result<(), MergeLogsError> {
    let Some(first) = before.first() else { return Ok(()) };
    let path = source.path.clone();
    let markers = |source: &Source| source.settings.localization.marker_map.clone();
    if markers(source) != markers(first) {
        return Err(MergeLogsError::Markers { path, first: first.path.clone() });
    }
    // A flight is known by its first turn, so a cut copy is found too.
    let firsts = |source: &Source| -> Vec<Arc<Footprint>> {
        source.read.flights.iter().filter_map(|turns| turns.first().cloned()).collect()
    };
    let own = firsts(source);
    let same = before.iter().find(|other| firsts(other).iter().any(|turn| own.contains(turn)));
    same.map_or(Ok(()), |other| Err(MergeLogsError::SameFlight { path, first: other.path.clone() }))
}

/// The vehicle of a log: a known one with the same LiDAR, or a new one.
fn vehicle_of(source: &Source, before: &[Source], options: MergeOptions) -> usize {
    let is_same = |other: &&Source| other.settings.mapping.lidar == source.settings.mapping.lidar;
    let known = before.iter().find(is_same).filter(|_| !options.separate_vehicles);
    let n_vehicles = before.iter().map(|other| other.vehicle_idx + 1).max().unwrap_or(0);
    known.map_or(n_vehicles, |other| other.vehicle_idx)
}

impl Source {
    fn summary(&self) -> MergedLog {
        MergedLog {
            path: self.path.clone(),
            n_flights: self.read.flights.len(),
            n_turns: self.read.flights.iter().map(Vec::len).sum(),
            vehicle_idx: self.vehicle_idx,
            is_complete: self.read.is_complete,
        }
    }
}

impl MergedSurvey {
    /// Writes the survey as a log of its own, for viewers and for the comparison with others.
    ///
    /// # Errors
    /// The file exists already or cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), MergeLogsError> {
        let at: Stamp<Mono> = self.surface.at;
        let names: Vec<String> =
            self.logs.iter().map(|log| log.path.display().to_string()).collect();
        let header = LogHeader {
            started_at: at,
            config_toml: self.config_toml.clone(),
            notes: [("merged_from".to_owned(), names.join("\n"))].into(),
            body_from_lidar: None,
        };
        let mut recorder = Recorder::create(path, &header)?.waiting();
        recorder.result(at, &Action::VolumesAccounted(self.accounts.clone()));
        recorder.result(at, &Action::SurfaceSolved(Box::new(self.surface.clone())));
        if let Some(hall) = self.accounts.first() {
            let summary = FlightSummary {
                at,
                volume: hall.estimate,
                accounts: self.accounts.clone(),
                hits: self.hits,
                steps_done: 0,
                path_length_m: 0.0,
                is_complete: self.logs.iter().all(|log| log.is_complete),
                is_final: true,
            };
            recorder.result(at, &Action::Ended(Box::new(summary)));
        }
        let _stats = recorder.close();
        Ok(())
    }
}
