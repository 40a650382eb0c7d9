//! A survey during which the detector goes wrong for a while.

use nalgebra::{Matrix3, Vector3};
use std::time::Duration;
use stockpilot::messages::{FixRecord, FixSource, Verdict};
use stockpilot::mission::Phase;
use stockpilot::pilot::Action;
use stockpilot::time::{Mono, Stamp};
use stockpilot_sim::autopilot::Flavour;
use stockpilot_sim::camera::CameraModel;
use stockpilot_sim::camera_faults::CameraFault;
use stockpilot_sim::campaign::{DirectFlight, Witnessed};
use stockpilot_sim::consistency::{Update, with_update};
use stockpilot_sim::hall::{Devices, config};
use stockpilot_sim::scenario::{Conditions, Lidar, Planner, Scenario, Surface};
use stockpilot_sim::world::World;

/// √χ² of 99.7 % for three degrees of freedom (13.93): what 3σ is for one. The exact tail,
/// `2 (1 − Φ(x)) + √(2/π) x e^{−x²/2}`, is 0.0030 at 3.732.
pub(crate) const THREE_SIGMA: f64 = 3.732;
/// The same for the largest of 200 independent looks: the tail is 0.003/200 at 5.05. Errors live
/// for a tenth of a second, so a flight of ten to twenty seconds has about as many.
pub(crate) const THREE_SIGMA_OF_MANY: f64 = 5.05;

/// A survey over heaps that goes on for a minute at least.
pub(crate) fn survey(seed: u64) -> Scenario {
    Scenario {
        world: World::piles(seed).expect("a generated world"),
        planner: Planner::SquareWave,
        surface: Surface::KalmanGrid,
        variance: None,
        lidar: Lidar::Ld19,
        autopilot: Flavour::Px4,
        camera: CameraModel::ahead(),
        n_steps: 50,
        seed,
        conditions: Conditions::default(),
    }
}

/// What a flight with a fault showed, from the fault's beginning until some seconds after its end.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    /// Looks at the position.
    pub(crate) looks: Vec<PositionLook>,
    /// Errors of the velocity, m/s.
    pub(crate) velocity_errors_mps: Vec<f64>,
    /// Records of the frames that arrived while the fault lasted, and how far their fixes were turned
    /// from the truth, rad.
    pub(crate) records: Vec<(FixRecord, Option<f64>)>,
    /// What was said while the fault lasted and until the end.
    pub(crate) texts: Vec<String>,
    /// The marker that the fault was about.
    pub(crate) faulty_tag: Option<u32>,
    /// How often the pose was declared to have jumped.
    pub(crate) n_resets: u8,
}

/// The position beside the truth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PositionLook {
    /// Since the fault began, s.
    pub(crate) since_s: f64,
    /// Truth minus estimate, hall axes, m.
    pub(crate) error_m: Vector3<f64>,
    /// Its claimed covariance, m².
    pub(crate) cov_m2: Matrix3<f64>,
}

impl PositionLook {
    /// A displacement in σ of this look: √(dᵀ P⁻¹ d).
    fn sigmas(&self, displacement_m: &Vector3<f64>) -> f64 {
        let factor = self.cov_m2.cholesky().expect("a positive definite covariance");
        displacement_m.dot(&factor.solve(displacement_m)).sqrt()
    }
}

impl Seen {
    /// The largest position error in σ, and when, s.
    pub(crate) fn worst_error(&self) -> (f64, f64) {
        let all = self.looks.iter().map(|look| (look.sigmas(&look.error_m), look.since_s));
        all.max_by(|a, b| a.0.total_cmp(&b.0)).expect("looks at the estimate")
    }

    /// How far the fault has moved the estimate, in σ, and when, s: the error beside that of the
    /// same flight without the fault.
    pub(crate) fn worst_move(&self, without: &Self) -> (f64, f64) {
        let pairs = std::iter::zip(&self.looks, &without.looks);
        let all = pairs.map(|(with, without)| {
            assert!((with.since_s - without.since_s).abs() < 1e-9, "looks at other times");
            (with.sigmas(&(with.error_m - without.error_m)), with.since_s)
        });
        all.max_by(|a, b| a.0.total_cmp(&b.0)).expect("looks at the estimate")
    }

    /// The largest position error, m.
    pub(crate) fn worst_error_m(&self) -> f64 {
        self.looks.iter().map(|look| look.error_m.norm()).fold(0.0, f64::max)
    }

    /// Share of the records that tell of something wrong: not fused, or fused without some tag, or
    /// without more than an eighth of the points (the gate of a point refuses one in a hundred).
    pub(crate) fn told_ratio(&self) -> f64 {
        let is_told = |record: &FixRecord| {
            record.verdict != Verdict::Fused
                || record.n_tags_used < record.n_tags
                || 8 * record.n_points_used < 7 * record.n_points
        };
        let n_told = self.records.iter().filter(|(record, _)| is_told(record)).count();
        ratio(n_told, self.records.len())
    }

    /// True if the people were told of this marker.
    pub(crate) fn names_the_tag(&self) -> bool {
        let Some(id) = self.faulty_tag else { return false };
        let is_word =
            |word: &str| word.trim_matches(|c: char| !c.is_ascii_digit()) == id.to_string();
        self.texts.iter().any(|text| text.split_whitespace().any(is_word))
    }
}

#[expect(clippy::cast_precision_loss, reason = "few frames")]
pub(crate) fn ratio(n: usize, of: usize) -> f64 {
    assert!(of > 0, "nothing to look at");
    n as f64 / of as f64
}

/// Markers in the picture: so few that a wrong one matters. The hall has many more.
const N_TAGS: usize = 6;
/// Time watched after the fault's end, s.
const AFTERWARDS_S: f64 = 4.0;

/// Flies with `fault` for `fault_s`, beginning three seconds after the survey.
pub(crate) fn flown(seed: u64, update: Update, fault: Option<CameraFault>, fault_s: f64) -> Seen {
    let scenario = survey(seed);
    let mut config = config(&scenario, Devices::none());
    config.filter = with_update(&config.filter, update);
    let mut flight = DirectFlight::with_config(&scenario, &config).expect("a configuration");
    let mut seen = Seen::default();
    let started = Stamp::ZERO.plus(Duration::from_secs(60));
    while flight.phase() != Phase::Survey && flight.rig.now() < started {
        flight.step(&mut |_, _| {});
    }
    assert_eq!(flight.phase(), Phase::Survey, "{:?}", flight.texts());
    flight.faults.n_tags_max = Some(N_TAGS);
    let begin = flight.rig.now().plus(Duration::from_secs(3));
    while flight.rig.now() < begin {
        flight.step(&mut |_, _| {});
    }
    let resets_before = flight.estimate().map_or(0, |estimate| estimate.reset_counter);
    let n_texts_before = flight.texts().len();
    flight.faults.camera = fault;
    let end = begin.plus(Duration::from_secs_f64(fault_s));
    while flight.rig.now() < end.plus(Duration::from_secs_f64(AFTERWARDS_S)) {
        if flight.rig.now() >= end {
            flight.faults.camera = None;
        }
        let mut records = Vec::new();
        flight.step(&mut |_, witnessed| {
            if let Witnessed::Action(Action::FixTreated(record)) = witnessed
                && record.source != FixSource::Standstill
            {
                records.push(FixRecord::clone(record));
            }
        });
        seen.look(&flight, begin);
        for record in records.into_iter().filter(|_| flight.faults.camera == fault) {
            let turned = turned_rad(&flight, &record);
            seen.records.push((record, turned));
        }
        seen.faulty_tag = seen.faulty_tag.or(flight.faulty_tag());
    }
    seen.texts = flight.texts()[n_texts_before..].to_vec();
    let resets = flight.estimate().map_or(0, |estimate| estimate.reset_counter);
    seen.n_resets = resets.wrapping_sub(resets_before);
    seen
}

/// The angle between a record's fix and the true attitude at its time, rad.
fn turned_rad(flight: &DirectFlight, record: &FixRecord) -> Option<f64> {
    let truth = flight.rig.vehicle().pose_at(record.at)?;
    let fix = record.fix.as_ref()?;
    Some(fix.hall_from_body.rotation.minus(&truth.rotation).norm())
}

impl Seen {
    fn look(&mut self, flight: &DirectFlight, begin: Stamp<Mono>) {
        let Some(estimate) = flight.estimate() else { return };
        let Some(truth) = flight.rig.vehicle().motion_at(estimate.at) else { return };
        self.looks.push(PositionLook {
            since_s: flight.rig.now().seconds_since(begin),
            error_m: truth.position_m - estimate.hall_from_body.origin.coords,
            cov_m2: estimate.error_cov.fixed_view::<3, 3>(0, 0).into_owned(),
        });
        let velocity: Vector3<f64> = truth.velocity_mps - estimate.velocity_mps.coords;
        self.velocity_errors_mps.push(velocity.norm());
    }
}
