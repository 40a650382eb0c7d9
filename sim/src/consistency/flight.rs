//! One flight, looked at five times a second.

use super::update::{Update, with_update};
use crate::camera_faults::CameraFault;
use crate::campaign::{DirectFlight, Witnessed};
use crate::hall::{Devices, config};
use crate::scenario::Scenario;
use crate::vehicle::MotionState;
use anyhow::bail;
use nalgebra::{DMatrix, DVector, Vector3};
use std::time::Duration;
use stockpilot::messages::{FixRecord, FixSource, NavEstimate, Verdict};
use stockpilot::mission::Phase;
use stockpilot::pilot::Action;
use stockpilot::stats::chi2_gate_99;
use stockpilot::time::{Mono, Stamp};

/// Time between two looks.
pub(super) const LOOK_EVERY: Duration = Duration::from_millis(200);
/// A vehicle that has not left by then will not leave by itself.
const LONGEST_START: Duration = Duration::from_secs(60);

/// What is flown, besides the scenario.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightPlan {
    /// From exposure to arrival of a frame.
    pub latency: Duration,
    /// How frames enter the filter.
    pub update: Update,
    /// The flight is watched this long from its start.
    pub longest: Duration,
    /// What the detector gets wrong, and from when to when after the survey's start, s.
    pub fault: Option<(CameraFault, f64, f64)>,
}

/// One look at the belief.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// When, s since the simulation's start.
    pub at_s: f64,
    /// In the air, and not landing.
    pub is_flying: bool,
    /// NEES of [`super::GROUPS`]; NaN where the covariance has no factor.
    pub nees: [f64; 4],
    /// Length of the position error, m.
    pub position_error_m: f64,
    /// Error of the yaw, rad.
    pub yaw_error_rad: f64,
    /// Mapped tags in the last frame that reached the filter.
    pub n_tags: usize,
}

/// One attempt to fuse a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NisLook {
    /// When the frame was exposed, s since the simulation's start.
    pub at_s: f64,
    /// In the air, and not landing.
    pub is_flying: bool,
    /// Normalised innovation squared.
    pub nis: f64,
    /// Its degrees of freedom.
    pub dof: f64,
    /// Refused by the gate.
    pub is_gated: bool,
}

/// What one flight showed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FlownFlight {
    /// Seed of everything drawn.
    pub seed: u64,
    /// Looks at the belief.
    pub looks: Vec<Look>,
    /// Attempts to fuse a frame.
    pub fixes: Vec<NisLook>,
}

/// Flies one scenario and looks.
///
/// # Errors
/// A configuration that does not fit, or a flight that never leaves the ground.
pub fn fly(scenario: &Scenario, plan: &FlightPlan) -> anyhow::Result<FlownFlight> {
    let mut flight = direct_flight(scenario, plan)?;
    let mut flown = FlownFlight { seed: scenario.seed, ..FlownFlight::default() };
    let mut watch = Watch::default();
    let end = Stamp::ZERO.plus(plan.longest);
    let mut survey_at = None;
    while flight.summary().is_none() && flight.rig.now() < end {
        flight.step(&mut |_, witnessed| watch.note(witnessed));
        let now = flight.rig.now();
        let is_flying = is_flying(flight.phase());
        if flight.phase() == Phase::Survey {
            survey_at.get_or_insert(now);
        } else if survey_at.is_none() && now > Stamp::ZERO.plus(LONGEST_START) {
            bail!("seed {}: no survey; last words: {:?}", scenario.seed, flight.texts());
        }
        flight.faults.camera = plan.fault.and_then(|(fault, from_s, to_s)| {
            let since_s = now.seconds_since(survey_at?);
            (from_s..to_s).contains(&since_s).then_some(fault)
        });
        flown.fixes.extend(watch.fixes.drain(..).map(|fix| NisLook { is_flying, ..fix }));
        if now >= watch.next_look {
            watch.next_look = watch.next_look.plus(LOOK_EVERY);
            let seen = look_at(&flight);
            flown.looks.extend(seen.map(|l| Look { is_flying, n_tags: watch.n_tags, ..l }));
        }
    }
    Ok(flown)
}

/// The flight with the plan's latency and update, and without the surface's cost.
pub(super) fn direct_flight(
    scenario: &Scenario,
    plan: &FlightPlan,
) -> anyhow::Result<DirectFlight> {
    let mut scenario = scenario.clone();
    scenario.camera.detector.latency = (plan.latency, plan.latency);
    let mut config = config(&scenario, Devices::none());
    config.filter = with_update(&config.filter, plan.update);
    config.surface.solve_interval_s = Some(SELDOM_S);
    Ok(DirectFlight::with_config(&scenario, &config)?)
}

/// The surface is of no interest here and costs most of the time.
const SELDOM_S: f64 = 60.0;

const fn is_flying(phase: Phase) -> bool {
    matches!(phase, Phase::TakeOff | Phase::Survey | Phase::Hold | Phase::Return)
}

/// The newest belief beside the truth at its own stamp.
pub(super) fn look_at(flight: &DirectFlight) -> Option<Look> {
    let estimate = flight.estimate()?;
    let vehicle = flight.rig.vehicle();
    // The comparison of clocks may put the newest sample a few microseconds ahead.
    let truth = vehicle.motion_at(estimate.at.min(vehicle.now()))?;
    Some(look(&estimate, &truth))
}

/// One belief beside the truth.
#[must_use]
pub fn look(estimate: &NavEstimate, truth: &MotionState) -> Look {
    let position = truth.position_m - estimate.hall_from_body.origin.coords;
    let claimed = estimate.hall_from_body.rotation.quaternion();
    let attitude = (claimed.inverse() * truth.attitude).scaled_axis();
    let velocity = truth.velocity_mps - estimate.velocity_mps.coords;
    let parts = [position, attitude, velocity];
    let error = DVector::from_iterator(9, parts.iter().flatten().copied());
    let cov = DMatrix::from_fn(9, 9, |row, column| estimate.error_cov[(row, column)]);
    let yaw_rad = yaw_rad(&truth.attitude) - yaw_rad(claimed);
    Look {
        at_s: estimate.at.seconds(),
        is_flying: false,
        nees: [(0, 3), (3, 3), (6, 3), (0, 9)].map(|states| nees(&error, &cov, states)),
        position_error_m: position.norm(),
        yaw_error_rad: yaw_rad.sin().atan2(yaw_rad.cos()),
        n_tags: 0,
    }
}

fn yaw_rad(attitude: &nalgebra::UnitQuaternion<f64>) -> f64 {
    let ahead = attitude * Vector3::x();
    ahead.y.atan2(ahead.x)
}

/// eᵀ P⁻¹ e over `n` states from `first` on; NaN if P has no factor.
fn nees(error: &DVector<f64>, cov: &DMatrix<f64>, (first, n): (usize, usize)) -> f64 {
    let e = error.rows(first, n).into_owned();
    let block = cov.view((first, first), (n, n)).into_owned();
    block.cholesky().map_or(f64::NAN, |factor| e.dot(&factor.solve(&e)))
}

/// What is remembered between two looks.
#[derive(Debug, Default)]
struct Watch {
    next_look: Stamp<Mono>,
    n_tags: usize,
    fixes: Vec<NisLook>,
}

impl Watch {
    fn note(&mut self, witnessed: Witnessed<'_>) {
        let Witnessed::Action(Action::FixTreated(record)) = witnessed else { return };
        if record.source == FixSource::Standstill {
            return;
        }
        self.n_tags = record.n_tags_used;
        self.fixes.extend(nis_look(record));
    }
}

fn nis_look(record: &FixRecord) -> Option<NisLook> {
    Some(NisLook {
        at_s: record.at.seconds(),
        is_flying: false,
        nis: record.nis?,
        dof: dof_of_gate(record.nis_gate)?,
        is_gated: record.verdict != Verdict::Fused,
    })
}

/// The degrees of freedom whose 99 % gate this is.
fn dof_of_gate(gate: f64) -> Option<f64> {
    const MOST: usize = 512;
    let dof = (1..=MOST).find(|&dof| (chi2_gate_99(dof) - gate).abs() < 1e-6)?;
    u32::try_from(dof).ok().map(f64::from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{SMatrix, UnitQuaternion};
    use stockpilot::geometry::{Direction, Point, Rotation, Transform};

    #[test]
    fn errors_are_counted_in_the_filters_own_axes() {
        let mut cov = SMatrix::<f64, 15, 15>::identity() * 1e-4;
        // Correlated position and velocity along x: their joint NEES is not the sum.
        cov[(0, 6)] = 5e-5;
        cov[(6, 0)] = 5e-5;
        let rotation = Rotation::from_euler_rad(0.3, -0.2, 2.0);
        let estimate = NavEstimate {
            at: Stamp::from_nanos(7),
            hall_from_body: Transform::new(rotation, Point::new(1.0, 2.0, 3.0)),
            velocity_mps: Direction::new(0.5, 0.0, 0.0),
            gyro_radps: Vector3::zeros(),
            gyro_bias_radps: Vector3::zeros(),
            accel_bias_mps2: Vector3::zeros(),
            error_cov: cov,
            reset_counter: 0,
        };
        // 2 cm in x, 0.03 rad about the body's own y, 1 cm/s in x.
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.03, 0.0));
        let truth = MotionState {
            position_m: Vector3::new(1.02, 2.0, 3.0),
            attitude: rotation.quaternion() * turn,
            velocity_mps: Vector3::new(0.51, 0.0, 0.0),
            rate_radps: Vector3::zeros(),
        };
        let seen = look(&estimate, &truth);
        // 0.02²/1e-4 = 4, 0.03²/1e-4 = 9, 0.01²/1e-4 = 1; together (ρ = 0.5, in σ: 2 and 1):
        // (4 − 2·0.5·2·1 + 1)/(1 − 0.25) = 4, and 9 more.
        let expected = [4.0, 9.0, 1.0, 13.0];
        for (nees, expected) in std::iter::zip(seen.nees, expected) {
            assert!((nees - expected).abs() < 1e-9, "{:?}", seen.nees);
        }
        assert!((seen.position_error_m - 0.02).abs() < 1e-12);
    }

    #[test]
    fn a_gate_tells_its_degrees_of_freedom() {
        for dof in [2_u32, 6, 8, 80] {
            let gate = chi2_gate_99(usize::try_from(dof).unwrap());
            assert_eq!(dof_of_gate(gate), Some(f64::from(dof)));
        }
        assert_eq!(dof_of_gate(17.0), None);
    }
}
