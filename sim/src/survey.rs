//! One flight with an eye on its survey: what was claimed when, how far and at what cost.

use crate::campaign::{DirectFlight, LONGEST_FLIGHT, Witnessed, wall_clock};
use crate::judge::{FreeSpaceJudge, FreeSpaceRule};
use crate::report::RunReport;
use crate::rig::Rig;
use crate::scenario::Scenario;
use std::time::Duration;
use stockpilot::config::{Config, ConfigError};
use stockpilot::messages::{HeightMap, VolumeEstimate};
use stockpilot::mission::Phase;
use stockpilot::pilot::Action;
use stockpilot::time::{Mono, Stamp};

/// The rotors reach 0.35 m from the middle of the body.
const HULL_M: f64 = 0.35;
/// A vehicle that flies well is nowhere farther from its trajectory, m.
const TRACKING_M: f64 = 0.25;
/// Time between two looks at the true place.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// One solved surface's volume, with what it had cost by then since the survey began.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub at_s: f64,
    /// Length of the true path, m.
    pub path_m: f64,
    /// Energy out of the battery, Wh.
    pub energy_wh: f64,
    /// Samples that the LiDAR had sent.
    pub n_samples: u64,
    /// Waypoints reached, as last reported.
    pub steps: usize,
    /// The claim, m³.
    pub volume_m3: f64,
    /// Its claimed standard deviation, m³.
    pub sigma_m3: f64,
}

/// The surface when so many waypoints had been reached.
#[derive(Debug, Clone, PartialEq)]
pub struct StepMap {
    /// Waypoints that were asked for.
    pub asked_steps: usize,
    /// Claims at that moment.
    pub sample: Sample,
    /// The surface.
    pub map: HeightMap,
    /// The true path of the survey so far is the track up to here.
    pub n_track: usize,
}

/// What one flight showed.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// The flight's result beside the truth; `None` if it had no end.
    pub report: Option<RunReport>,
    /// Every solved volume, the final one last.
    pub samples: Vec<Sample>,
    /// The surfaces that were asked for, in the order of steps. What the survey did not reach is
    /// shown by its final surface.
    pub maps: Vec<StepMap>,
    /// True places since the survey began: x, y, z, m.
    pub track_m: Vec<[f64; 3]>,
    /// What each planning job took on this machine, ms.
    pub plan_ms: Vec<f64>,
    /// The vehicle touched something.
    pub has_collided: bool,
    /// It left the true free space during the survey.
    pub has_left_free_space: bool,
    /// Smallest distance to anything solid during the survey, m, 2 at most; infinite without one.
    pub least_clearance_m: f64,
    /// Charge of the battery at the end, 0 to 1.
    pub final_charge_ratio: f64,
}

impl Survey {
    /// The first sample whose claimed σ/V is at most this.
    #[must_use]
    pub fn first_within(&self, sigma_over_volume: f64) -> Option<&Sample> {
        self.samples
            .iter()
            .find(|s| s.volume_m3 > 0.0 && s.sigma_m3 <= sigma_over_volume * s.volume_m3)
    }
}

/// Flies one scenario and watches; `config` is that of the scenario, perhaps changed.
///
/// Surfaces are kept at the first solve after so many waypoints of `maps_after`, which rise.
///
/// # Errors
/// A configuration that does not fit.
pub fn fly(
    scenario: &Scenario,
    config: &Config,
    maps_after: &[usize],
) -> Result<Survey, ConfigError> {
    let began = wall_clock();
    let mut flight = DirectFlight::with_config(scenario, config)?;
    let mut watch = Watch::new(config, maps_after);
    let limit = Stamp::ZERO.plus(LONGEST_FLIGHT);
    while flight.summary().is_none() && flight.rig.now() < limit {
        let mut heard = Heard::default();
        flight.step(&mut |_, seen| heard.take(seen));
        watch.look(&flight, heard);
    }
    let report = flight.report(scenario, began.elapsed());
    watch.finish();
    Ok(Survey {
        report,
        samples: watch.samples,
        maps: watch.maps,
        track_m: watch.track_m,
        plan_ms: flight.plan_times().iter().map(|t| 1e3 * t.as_secs_f64()).collect(),
        has_collided: flight.rig.vehicle().collision().is_some(),
        has_left_free_space: watch.judge.has_left(),
        least_clearance_m: watch.judge.least_clearance_m(),
        final_charge_ratio: flight.rig.vehicle().battery().charge_ratio(),
    })
}

/// What the brain said during one step of the simulation.
#[derive(Debug, Default)]
struct Heard {
    volume: Option<VolumeEstimate>,
    map: Option<HeightMap>,
    steps: Option<usize>,
}

impl Heard {
    fn take(&mut self, seen: Witnessed<'_>) {
        match seen {
            Witnessed::Action(Action::VolumesAccounted(accounts)) => {
                self.volume = accounts.first().map(|account| account.estimate);
            }
            Witnessed::Action(Action::SurfaceSolved(map)) => self.map = Some((**map).clone()),
            Witnessed::Action(Action::ReportVolume(report)) => self.steps = Some(report.steps_done),
            _ => {}
        }
    }
}

/// Time, way, energy and samples so far.
#[derive(Debug, Clone, Copy)]
struct Spent {
    at: Stamp<Mono>,
    path_m: f64,
    energy_wh: f64,
    n_samples: u64,
}

#[derive(Debug)]
struct Watch {
    wanted: Vec<usize>,
    judge: FreeSpaceJudge,
    energy_wh: f64,
    last_at: Stamp<Mono>,
    next_look: Stamp<Mono>,
    /// What had been spent when the survey began.
    start: Option<Spent>,
    steps: usize,
    newest_map: Option<HeightMap>,
    samples: Vec<Sample>,
    maps: Vec<StepMap>,
    track_m: Vec<[f64; 3]>,
}

impl Watch {
    fn new(config: &Config, maps_after: &[usize]) -> Self {
        let rule = FreeSpaceRule {
            min_quality: config.planning.min_fix_quality,
            least_clearance_m: HULL_M,
            tolerance_m: TRACKING_M,
        };
        Self {
            wanted: maps_after.to_vec(),
            judge: FreeSpaceJudge::new(rule),
            energy_wh: 0.0,
            last_at: Stamp::ZERO,
            next_look: Stamp::ZERO,
            start: None,
            steps: 0,
            newest_map: None,
            samples: Vec::new(),
            maps: Vec::new(),
            track_m: Vec::new(),
        }
    }

    fn look(&mut self, flight: &DirectFlight, heard: Heard) {
        let rig = &flight.rig;
        self.draw(rig);
        let is_surveying = flight.phase() == Phase::Survey;
        if is_surveying && self.start.is_none() {
            self.start = Some(self.spent(flight));
        }
        if is_surveying && rig.now() >= self.next_look {
            self.next_look = rig.now().plus(LOOK_EVERY);
            let pose = rig.vehicle().hall_from_body();
            self.judge.look(rig.world(), rig.camera(), &pose);
            self.track_m.push(pose.origin.coords.into());
        }
        self.steps = heard.steps.unwrap_or(self.steps);
        if let Some(map) = heard.map {
            self.newest_map = Some(map);
        }
        if let (Some(volume), Some(start)) = (heard.volume, self.start) {
            self.samples.push(self.sample(&volume, &start, &self.spent(flight)));
            self.keep_maps();
        }
    }

    /// Adds up what the battery gives.
    fn draw(&mut self, rig: &Rig) {
        let battery = rig.vehicle().battery();
        let hours = rig.now().seconds_since(self.last_at) / 3600.0;
        self.last_at = rig.now();
        self.energy_wh += battery.voltage_v() * battery.current_a() * hours;
    }

    fn spent(&self, flight: &DirectFlight) -> Spent {
        Spent {
            at: flight.rig.now(),
            path_m: flight.rig.flown_m(),
            energy_wh: self.energy_wh,
            n_samples: flight.n_samples_sent(),
        }
    }

    fn sample(&self, volume: &VolumeEstimate, start: &Spent, now: &Spent) -> Sample {
        Sample {
            at_s: now.at.seconds_since(start.at),
            path_m: now.path_m - start.path_m,
            energy_wh: now.energy_wh - start.energy_wh,
            n_samples: now.n_samples - start.n_samples,
            steps: self.steps,
            volume_m3: volume.volume_m3,
            sigma_m3: volume.sigma_m3,
        }
    }

    /// Keeps the newest surface for every number of steps that is due.
    fn keep_maps(&mut self) {
        while self.wanted.first().is_some_and(|wanted| self.steps >= *wanted) {
            self.keep_map();
        }
    }

    fn keep_map(&mut self) {
        let asked_steps = self.wanted.remove(0);
        let newest = self.newest_map.clone().zip(self.samples.last().copied());
        self.maps.extend(newest.map(|(map, sample)| StepMap {
            asked_steps,
            sample,
            map,
            n_track: self.track_m.len(),
        }));
    }

    /// What was asked for and never reached is shown as it was in the end.
    fn finish(&mut self) {
        while !self.wanted.is_empty() {
            self.keep_map();
        }
    }
}
