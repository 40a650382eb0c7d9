//! Everything that a log tells of one of its surveys, for reports and exports.

use crate::config::{Config, ConfigError};
use crate::mapping::base::BaseSurface;
use crate::mapping::bay::BayOnGrid;
use crate::mapping::{self, KeptHit};
use crate::messages::{
    CellCoverage, Declaration, FixRecord, HeightMap, HitCounts, Severity, StatusText, Verdict,
    VolumeAccount,
};
use crate::pilot::{Action, Event, FlightSummary, JobOutput, PhaseChange, Pilot};
use crate::record::replay::ReplayError;
use crate::record::{Decision, FlownAgain, SurveyPlace, Watcher, fly_again, read_decision};
use crate::survey::{Survey, SurveyError};
use crate::time::{Mono, Stamp};
use jiff::Timestamp;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Points of the flown path are this far apart in time.
const PATH_STEP: Duration = Duration::from_millis(200);

/// A survey as its log has it, its flights flown again by this build.
#[derive(Debug, Clone, PartialEq)]
pub struct Flight {
    /// The log.
    pub log: PathBuf,
    /// Version of the program that wrote it.
    pub version: String,
    /// Build of that program.
    pub build: String,
    /// The effective configuration, TOML.
    pub config_toml: String,
    /// The same, read.
    pub config: Config,
    /// The same, as the map takes it.
    pub settings: mapping::Settings,
    /// Which survey of the log it is.
    pub place: SurveyPlace,
    /// What it is known by, however the log goes on.
    pub identity: String,
    /// What people said before its motors turned: at the START, and at flights into its gaps.
    pub declarations: Vec<(Stamp<Mono>, Declaration)>,
    /// Civil time at the survey's START, if the log's was noted.
    pub started: Option<Timestamp>,
    /// Civil time at the log's start, if it was noted.
    pub log_started: Option<Timestamp>,
    /// When the log began.
    pub began_at: Stamp<Mono>,
    /// Which LiDAR answered, if that was noted.
    pub lidar: Option<String>,
    /// Logs that this one was merged from.
    pub merged_from: Vec<String>,
    /// The whole region first, then its bays, as recorded.
    pub accounts: Vec<VolumeAccount>,
    /// The surface that belongs to them, as recorded.
    pub surface: Option<HeightMap>,
    /// What each cell of the surface rests on; empty if it was not computed again.
    pub states: Vec<CellCoverage>,
    /// Every hit that changed the map; empty if the log holds none.
    pub hits: Vec<KeptHit>,
    /// Where the vehicle was, m, in equal steps of time.
    pub path_m: Vec<[f64; 3]>,
    /// Where the beams went.
    pub counts: HitCounts,
    /// Steps of the mission.
    pub phases: Vec<PhaseChange>,
    /// What people were told and should have heeded: warnings and worse.
    pub warnings: Vec<(Stamp<Mono>, StatusText)>,
    /// How the camera frames were treated.
    pub fixes: FixStatistics,
    /// What the flight came to.
    pub summary: Option<FlightSummary>,
    /// What a person decided of it.
    pub decision: Option<Decision>,
    /// How far this build agrees with the record.
    pub reproduction: Reproduction,
    /// The volumes are those after the landing.
    pub is_final: bool,
    /// The log has its proper end and no gap.
    pub is_complete: bool,
}

/// What became of the record when it was computed again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reproduction {
    /// Volumes and surface are equal to the last bit.
    Identical,
    /// They are not: another build has written the log, or it was changed.
    Different,
    /// The log holds results only; what they were merged from can be computed again.
    ResultsOnly,
}

/// How camera frames were treated.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FixStatistics {
    /// Frames by what became of them.
    pub n_frames: BTreeMap<Verdict, usize>,
    /// Reprojection residuals of fixes, root mean square of each frame, px, ascending.
    pub residuals_px: Vec<f64>,
}

impl FixStatistics {
    fn take(&mut self, fix: &FixRecord) {
        *self.n_frames.entry(fix.verdict).or_default() += 1;
        self.residuals_px.extend(fix.fix.as_ref().map(|fix| fix.residual_rms_px));
    }

    /// All frames.
    #[must_use]
    pub fn n_all(&self) -> usize {
        self.n_frames.values().sum()
    }

    /// Frames that were used.
    #[must_use]
    pub fn n_used(&self) -> usize {
        let of = |verdict| self.n_frames.get(&verdict).copied().unwrap_or(0);
        of(Verdict::Fused) + of(Verdict::Initialized)
    }

    /// The middle residual, px.
    #[must_use]
    pub fn median_residual_px(&self) -> Option<f64> {
        self.residuals_px.get(self.residuals_px.len() / 2).copied()
    }
}

#[derive(Default)]
struct Eye {
    states: Vec<CellCoverage>,
    path_m: Vec<[f64; 3]>,
    newest_point_at: Option<Stamp<Mono>>,
    phases: Vec<PhaseChange>,
    warnings: Vec<(Stamp<Mono>, StatusText)>,
    fixes: FixStatistics,
    summary: Option<FlightSummary>,
}

impl Watcher for Eye {
    fn begin(&mut self) {
        *self = Self::default();
    }

    fn event(&mut self, event: &Event) {
        if let Event::Finished { output, .. } = event
            && let JobOutput::SurfaceSolved(Ok(solved)) = output.as_ref()
        {
            self.states.clone_from(&solved.coverage);
        }
    }

    fn action(&mut self, at: Stamp<Mono>, action: &Action) {
        match action {
            Action::PublishOdometry(estimate) => {
                let is_due = self
                    .newest_point_at
                    .is_none_or(|newest| estimate.at.since(newest) >= PATH_STEP);
                if is_due {
                    self.newest_point_at = Some(estimate.at);
                    self.path_m.push(estimate.hall_from_body.origin.coords.into());
                }
            }
            Action::PhaseChanged(change) => self.phases.push(change.clone()),
            Action::Say(text) if text.severity <= Severity::Warning => {
                self.warnings.push((at, text.clone()));
            }
            Action::FixTreated(fix) => self.fixes.take(fix),
            Action::Ended(summary) => self.summary = Some(summary.as_ref().clone()),
            _ => {}
        }
    }
}

impl Flight {
    /// Reads a log and flies it again, up to the end of its last survey with volumes.
    ///
    /// # Errors
    /// As [`Self::read_one`].
    pub fn read(log: &Path) -> Result<Self, SurveyError> {
        Self::read_one(log, None)
    }

    /// Reads a log and flies it again, up to the end of the survey with this number, or of the last one.
    ///
    /// # Errors
    /// A log that cannot be read, or a survey that it does not hold or that has no volume.
    pub fn read_one(log: &Path, number: Option<usize>) -> Result<Self, SurveyError> {
        let mut eye = Eye::default();
        let unread = |source: ReplayError| SurveyError::Log { path: log.to_owned(), source };
        let again =
            fly_again(log, number, |toml| pilot_for(toml, log), &mut eye).map_err(unread)?;
        if again.recorded.accounts.is_empty() {
            return Err(SurveyError::NoVolume { path: log.to_owned() });
        }
        let decision = read_decision(log, &again.place).map_err(unread)?;
        Ok(Self { decision, ..Self::of(log, again, eye)? })
    }

    fn of(log: &Path, again: FlownAgain, mut eye: Eye) -> Result<Self, ConfigError> {
        let config = Config::from_log(&again.config_toml, log)?;
        let settings = config.pilot_settings()?.mapping;
        let reproduction = match (again.n_events, again.is_reproduced) {
            (0, _) => Reproduction::ResultsOnly,
            (_, true) => Reproduction::Identical,
            (_, false) => Reproduction::Different,
        };
        eye.fixes.residuals_px.sort_by(f64::total_cmp);
        let merged_from = again
            .notes
            .get("merged_from")
            .map_or_else(Vec::new, |names| names.lines().map(str::to_owned).collect());
        Ok(Self {
            log: log.to_owned(),
            version: again.version,
            build: again.build,
            place: again.place,
            identity: again.identity,
            declarations: again.declarations,
            started: again.started_utc.and_then(|text| text.parse().ok()),
            log_started: again.notes.get("started_utc").and_then(|text| text.parse().ok()),
            began_at: again.began_at,
            lidar: again.notes.get("lidar").cloned(),
            merged_from,
            accounts: again.recorded.accounts,
            surface: again.recorded.surface,
            states: eye.states,
            hits: again.pilot.mapper().kept_hits().to_vec(),
            path_m: eye.path_m,
            counts: since(again.pilot.mapper().counts(), &again.earlier_hits),
            phases: eye.phases,
            warnings: eye.warnings,
            fixes: eye.fixes,
            summary: eye.summary,
            decision: None,
            reproduction,
            is_final: again.recorded.is_final,
            is_complete: again.is_complete,
            config_toml: again.config_toml,
            config,
            settings,
        })
    }

    /// Its volumes, to compare with those of another.
    #[must_use]
    pub fn survey(&self) -> Survey {
        Survey {
            path: self.log.clone(),
            config: self.config.clone(),
            place: self.place.clone(),
            accounts: self.accounts.clone(),
            surface: self.surface.clone(),
            is_final: self.is_final,
        }
    }

    /// The LiDAR: what answered, else what is configured.
    #[must_use]
    pub fn lidar_said(&self) -> String {
        let configured = self.config.lidar.model.as_str();
        let is_auto = configured.eq_ignore_ascii_case("auto");
        match &self.lidar {
            Some(answered) if is_auto => answered.clone(),
            Some(answered) => format!("{answered} (configured: {configured})"),
            None if is_auto => "found by itself; the log does not say which".to_owned(),
            None => format!("{configured}, as configured"),
        }
    }

    /// Civil time of an instant, where the log says when it began.
    #[must_use]
    pub fn civil(&self, at: Stamp<Mono>) -> Option<Timestamp> {
        let after = jiff::SignedDuration::from_nanos(at.nanos_since(self.began_at));
        self.log_started?.checked_add(after).ok()
    }

    /// When the first and the last hit of the map were measured.
    #[must_use]
    pub fn measured_between(&self) -> Option<(Stamp<Mono>, Stamp<Mono>)> {
        Some((self.hits.first()?.at, self.hits.last()?.at))
    }

    /// By cell of the surface: some of it counts.
    #[must_use]
    pub fn counting_cells(&self) -> Vec<bool> {
        self.bays_on_surface().first().map_or_else(Vec::new, |hall| {
            hall.base.cell_areas_m2.iter().map(|area_m2| *area_m2 > 0.0).collect()
        })
    }

    /// The accounts' ground on the cells of the surface, in their order.
    #[must_use]
    pub fn bays_on_surface(&self) -> Vec<BayOnGrid> {
        let Some(surface) = &self.surface else { return Vec::new() };
        let hall_base = BaseSurface::level(self.settings.base_height_m);
        self.settings.region.whole_and_bays_on(&surface.grid, &hall_base)
    }
}

/// The counts of a survey: the brain's go on from one to the next, but for what the newest solve has refused.
const fn since(all: HitCounts, earlier: &HitCounts) -> HitCounts {
    HitCounts {
        received: all.received - earlier.received,
        used: all.used.saturating_sub(earlier.used),
        no_return: all.no_return - earlier.no_return,
        own_body: all.own_body - earlier.own_body,
        outside: all.outside - earlier.outside,
        no_pose: all.no_pose - earlier.no_pose,
        poor_pose: all.poor_pose - earlier.poor_pose,
        on_ground: all.on_ground - earlier.on_ground,
        refused: all.refused,
        forgotten: all.forgotten.saturating_sub(earlier.forgotten),
    }
}

fn pilot_for(toml: &str, log: &Path) -> Result<Pilot, ConfigError> {
    let mut pilot = Config::from_log(toml, log)?.pilot_settings().map(Pilot::new)?;
    pilot.keep_hits();
    Ok(pilot)
}
