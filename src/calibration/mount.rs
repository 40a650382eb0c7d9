//! The LiDAR's place and direction on the body by least squares over beams that ended on known faces.
//!
//! ```text
//! n·(p + R (t + δt + R_l exp(δφ^) u(α) (d + b))) − (c + δc) = noise
//! ∂/∂δt = Rᵀn,   ∂/∂δφ = u d × (R R_l)ᵀ n,   ∂/∂b = n·R R_l u,   ∂/∂τ = −n·(v + R (ω × s)),   ∂/∂δc = −1
//! ```
//! - n, c: the face; δc its own error, constant, with the σ that the hall states
//! - p, R: pose at the beam's own time; t, `R_l`: the mounting; α, d: angle and range of the beam
//! - b: constant error of the ranges, with the σ that the configuration states
//! - τ: the stamps come this much later than the beams; v, ω: velocity and rate of the body; s: the hit in
//!   body axes
//!
//! Beams of one turn on one face share the pose's error: together they weigh no more than one look
//! with that error. Errors of the pose last longer than a turn, though, so the σ come from leaving out
//! one of twenty spans of time after the other (jackknife) where that says more than the normal equations.
//!
//! What the data do not show (σ above [`Limits`]) is left as it was configured, and named.
//! Source: least squares and the delete-a-group jackknife, [Efron, Stein 1981].
//! Checked: `tests`; on recorded flights by the simulator's `calibrate` tests.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

mod normal;
#[cfg(test)]
mod tests;

use super::planes::{Plane, face_of};
use crate::geometry::{Body, Hall, Lidar, Transform, skew};
use crate::mapping::projection::LidarMount;
use nalgebra::{DVector, Matrix6, Vector3, Vector6};
use normal::Blocks;

/// A beam with the pose of its own time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedBeam {
    /// Pose of the body.
    pub hall_from_body: Transform<Hall, Body>,
    /// Direction in the scan plane, rad.
    pub angle_rad: f64,
    /// Measured distance, m.
    pub range_m: f64,
}

/// A turn of the scanner.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedTurn {
    /// Covariance of the pose's error that its beams share: position in hall axes, attitude in body
    /// axes.
    pub pose_cov: Matrix6<f64>,
    /// Velocity of the body in hall axes, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Angular velocity in body axes, rad/s.
    pub rate_radps: Vector3<f64>,
    /// Its beams.
    pub beams: Vec<PlacedBeam>,
}

/// What is known before.
#[derive(Debug, Clone, PartialEq)]
pub struct Before {
    /// The LiDAR as configured.
    pub lidar: LidarMount,
    /// Standard deviation of its place, each axis, m.
    pub position_sigma_m: f64,
    /// Standard deviation of its direction, about each axis, rad.
    pub rotation_sigma_rad: f64,
    /// Standard deviation of the constant error of its ranges, m.
    pub range_bias_sigma_m: f64,
    /// Standard deviation of its stamps against the poses, s.
    pub clock_sigma_s: f64,
}

/// An axis counts as seen up to these σ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Of the place, m.
    pub position_sigma_m: f64,
    /// Of the direction, rad.
    pub rotation_sigma_rad: f64,
    /// Of the stamps, s.
    pub clock_sigma_s: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            position_sigma_m: 0.005,
            rotation_sigma_rad: 0.1_f64.to_radians(),
            clock_sigma_s: 0.001,
        }
    }
}

/// One number of the mounting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Change against the configured mounting, m or rad; 0 if it was not seen.
    pub change: f64,
    /// Its standard deviation, m or rad; the configured one if it was not seen.
    pub sigma: f64,
    /// The data show it.
    pub is_seen: bool,
    /// Change of the first half of the flight minus that of the second, in its own σ.
    pub halves_z: f64,
}

/// Halves of a flight that differ by more σ contradict each other: by chance it happens in one axis of 370.
const CONTRADICTION_Z: f64 = 3.0;
/// Up to so many σ they agree.
const AGREEMENT_Z: f64 = 2.0;

impl Found {
    /// The halves of the flight contradict each other: what was found is the mean of two things, and no σ tells how wrong.
    ///
    /// Also of an axis that was not seen: halves far apart make its σ so large that it counts as such.
    #[must_use]
    pub fn contradicts_itself(&self) -> bool {
        self.halves_z.abs() > CONTRADICTION_Z
    }

    /// The standard deviation with what the halves say: as far apart as `z` σ instead of the 2 σ of chance, they make it
    /// larger by `z`/2.
    #[must_use]
    pub fn sigma_by_halves(&self) -> f64 {
        let factor = if self.is_seen { (self.halves_z.abs() / AGREEMENT_Z).max(1.0) } else { 1.0 };
        factor * self.sigma
    }
}

/// How a face was met.
#[derive(Debug, Clone, PartialEq)]
pub struct FaceReport {
    /// Which.
    pub name: String,
    /// Beams on it that count.
    pub n_beams: usize,
    /// Root mean square of their distances from it after the solution, m.
    pub rms_m: f64,
}

/// The mounting as found.
#[derive(Debug, Clone, PartialEq)]
pub struct MountCalibration {
    /// The LiDAR on the body, what was seen of it put right.
    pub body_from_lidar: Transform<Body, Lidar>,
    /// Place along x, y, z of the body, m, then direction about x, y, z of the LiDAR, rad.
    pub axes: [Found; 6],
    /// Constant error of the ranges, m, and its σ.
    pub range_bias_m: (f64, f64),
    /// How much later than the beams the stamps come, s; seen if [`Limits`] say so.
    pub clock_offset_s: Found,
    /// The faces of the hall.
    pub faces: Vec<FaceReport>,
}

/// The mounting cannot be found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum CalibrationError {
    /// Too few beams ended on known faces.
    #[error(
        "only {n_beams} beams ended on the known floor and walls: are hall.walls_m and the floor right, \
         and does the flight pass them?"
    )]
    TooFew {
        /// How many did.
        n_beams: usize,
    },
    /// The equations have no solution.
    #[error("the beams contradict each other: the equations have no solution")]
    NoSolution,
}

/// The names of the axes, in the order of [`MountCalibration::axes`].
pub const AXES: [&str; 6] =
    ["place x", "place y", "place z", "about lidar x", "about lidar y", "about lidar z"];

/// Numbers of the mounting.
const N_MOUNT: usize = 6;
/// Behind them: the bias of the ranges, the offset of the stamps, and the faces' own errors.
const BIAS: usize = N_MOUNT;
const CLOCK: usize = N_MOUNT + 1;
const FACES: usize = N_MOUNT + 2;
/// Fewer beams are no calibration.
const LEAST_BEAMS: usize = 500;
/// A LiDAR may be off by so much before: its place, m, and its direction, rad.
const ANYWHERE: (f64, f64) = (0.1, 0.087);
/// A beam may be so far from its face, round by round, m …
const GATES_M: [f64; 6] = [0.5, 0.3, 0.15, 0.1, 0.06, 0.06];
/// … and always so many σ of its range.
const GATE_SIGMAS: f64 = 5.0;

/// Finds the mounting.
///
/// # Errors
/// [`CalibrationError`].
pub fn calibrate(
    turns: &[PlacedTurn],
    planes: &[Plane],
    before: &Before,
    limits: &Limits,
) -> Result<MountCalibration, CalibrationError> {
    let (p, r) = ANYWHERE;
    let first = solve(turns, planes, before, [p, p, p, r, r, r])?;
    let limit = |axis| if axis < 3 { limits.position_sigma_m } else { limits.rotation_sigma_rad };
    let is_seen: [bool; N_MOUNT] = std::array::from_fn(|axis| first.sigma[axis] <= limit(axis));
    // What was not seen stays as well known as before, and must not lean on what was.
    let usual = |axis| if axis < 3 { before.position_sigma_m } else { before.rotation_sigma_rad };
    let loose = |axis| if axis < 3 { p } else { r };
    let prior = std::array::from_fn(|axis| if is_seen[axis] { loose(axis) } else { usual(axis) });
    let solved =
        if is_seen == [true; N_MOUNT] { first } else { solve(turns, planes, before, prior)? };
    let axes: [Found; N_MOUNT] = std::array::from_fn(|axis| Found {
        change: if is_seen[axis] { solved.x[axis] } else { 0.0 },
        sigma: if is_seen[axis] { solved.sigma[axis] } else { usual(axis) },
        is_seen: is_seen[axis],
        halves_z: solved.halves_z[axis],
    });
    let part = |from: usize| Vector3::from_fn(|k, _| axes[from + k].change);
    Ok(MountCalibration {
        body_from_lidar: before.lidar.body_from_lidar.perturbed(&part(0), &part(3)),
        axes,
        range_bias_m: (solved.x[BIAS], solved.sigma[BIAS]),
        clock_offset_s: Found {
            change: solved.x[CLOCK],
            sigma: solved.sigma[CLOCK],
            is_seen: solved.sigma[CLOCK] <= limits.clock_sigma_s,
            halves_z: solved.halves_z[CLOCK],
        },
        faces: solved.faces,
    })
}

struct Solved {
    x: DVector<f64>,
    sigma: Vec<f64>,
    halves_z: Vec<f64>,
    faces: Vec<FaceReport>,
}

fn solve(
    turns: &[PlacedTurn],
    planes: &[Plane],
    before: &Before,
    mount_sigma: [f64; N_MOUNT],
) -> Result<Solved, CalibrationError> {
    let mut prior_sigma = mount_sigma.to_vec();
    prior_sigma.extend([before.range_bias_sigma_m, before.clock_sigma_s]);
    prior_sigma.extend(planes.iter().map(|plane| plane.sigma_m));
    let mut x = DVector::zeros(prior_sigma.len());
    let mut last = None;
    for gate_m in GATES_M {
        let gate_m = gate_m.max(GATE_SIGMAS * before.lidar.range_sigma_m);
        let (blocks, faces) = linearise(turns, planes, before, &x, gate_m);
        let n_beams = faces.iter().map(|face| face.n_beams).sum();
        if n_beams < LEAST_BEAMS {
            return Err(CalibrationError::TooFew { n_beams });
        }
        x = blocks.solve(&prior_sigma).ok_or(CalibrationError::NoSolution)?;
        last = Some((blocks, faces));
    }
    let (blocks, faces) = last.ok_or(CalibrationError::NoSolution)?;
    let sigma = blocks.sigma(&prior_sigma, &x).ok_or(CalibrationError::NoSolution)?;
    let halves_z = blocks.halves_z(&prior_sigma, &x, FACES).ok_or(CalibrationError::NoSolution)?;
    Ok(Solved { x, sigma, halves_z, faces })
}

/// The normal equations about `x`, block by block, and how the faces are met there.
fn linearise(
    turns: &[PlacedTurn],
    planes: &[Plane],
    before: &Before,
    x: &DVector<f64>,
    gate_m: f64,
) -> (Blocks, Vec<FaceReport>) {
    let mut blocks = Blocks::new(x.len(), turns.len());
    let mut sums = vec![(0, 0.0); planes.len()];
    for (turn_idx, turn) in turns.iter().enumerate() {
        let looks = turn.looks(planes, before, x, gate_m);
        let mut n_on_face = vec![0.0_f64; planes.len()];
        looks.iter().for_each(|look| n_on_face[look.face] += 1.0);
        let normal = blocks.of_turn(turn_idx);
        for look in &looks {
            let pose_var_m2 = look.by_pose.dot(&(turn.pose_cov * look.by_pose));
            let weight = 1.0 / (look.var_m2 + n_on_face[look.face] * pose_var_m2);
            normal.add(&look.row(x.len()), look.target_m(x), weight);
            sums[look.face].0 += 1;
            sums[look.face].1 += look.distance_m * look.distance_m;
        }
    }
    #[expect(clippy::cast_precision_loss, reason = "counts of beams")]
    let report = |(plane, (n_beams, sum)): (&Plane, (usize, f64))| FaceReport {
        name: plane.name.clone(),
        n_beams,
        rms_m: (sum / (n_beams as f64).max(1.0)).sqrt(),
    };
    (blocks, std::iter::zip(planes, sums).map(report).collect())
}

/// A beam on a face.
struct Look {
    face: usize,
    /// How far it seems to be in front of the face, m.
    distance_m: f64,
    /// Derivative of that by the mounting, the ranges' constant error, and the stamps' offset.
    by_own: [f64; FACES],
    /// Derivative by the pose.
    by_pose: Vector6<f64>,
    /// Variance by range and angle, m².
    var_m2: f64,
}

impl PlacedTurn {
    fn looks(&self, planes: &[Plane], before: &Before, x: &DVector<f64>, gate_m: f64) -> Vec<Look> {
        let lidar = &before.lidar;
        let part = |from: usize| Vector3::new(x[from], x[from + 1], x[from + 2]);
        let mounted = lidar.body_from_lidar.perturbed(&part(0), &part(3));
        let R_l = mounted.rotation.matrix();
        let of = |beam: &PlacedBeam| {
            if lidar.is_blind(beam.angle_rad)
                || !(lidar.min_range_m..=lidar.max_range_m).contains(&beam.range_m)
            {
                return None;
            }
            let (sin, cos) = beam.angle_rad.sin_cos();
            let u = Vector3::new(cos, sin, 0.0);
            let range_m = beam.range_m + x[BIAS];
            let R = beam.hall_from_body.rotation.matrix();
            let p_body = mounted.origin.coords + R_l * u * range_m;
            let moves_mps = self.velocity_mps + R * self.rate_radps.cross(&p_body);
            let place_m = beam.hall_from_body.origin.coords + R * p_body - moves_mps * x[CLOCK];
            let face = face_of(planes, &place_m, gate_m)?;
            let n = planes[face].normal;
            let n_body = R.transpose() * n;
            let n_lidar = R_l.transpose() * n_body;
            let by_turn = (u * range_m).cross(&n_lidar);
            let along = n_lidar.dot(&u);
            let across = n_lidar.dot(&Vector3::new(-sin, cos, 0.0)) * range_m;
            let attitude = skew(&p_body) * n_body;
            Some(Look {
                face,
                distance_m: planes[face].distance_m(&place_m) - x[FACES + face],
                by_own: [
                    n_body.x,
                    n_body.y,
                    n_body.z,
                    by_turn.x,
                    by_turn.y,
                    by_turn.z,
                    along,
                    -n.dot(&moves_mps),
                ],
                by_pose: Vector6::new(n.x, n.y, n.z, attitude.x, attitude.y, attitude.z),
                var_m2: (lidar.range_sigma_m * along).powi(2)
                    + (lidar.angle_sigma_rad * across).powi(2),
            })
        };
        self.beams.iter().filter_map(of).collect()
    }
}

impl Look {
    /// The row of the linear equation row·x = target.
    fn row(&self, n: usize) -> DVector<f64> {
        let mut row = DVector::zeros(n);
        row.as_mut_slice()[..FACES].copy_from_slice(&self.by_own);
        row[FACES + self.face] = -1.0;
        row
    }

    /// What the row has to give so that the beam ends on its face, m.
    fn target_m(&self, x: &DVector<f64>) -> f64 {
        let at = self.by_own.iter().zip(x.iter()).map(|(a, x)| a * x).sum::<f64>();
        at - x[FACES + self.face] - self.distance_m
    }
}
