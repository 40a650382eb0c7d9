//! Where the tags hang, from many frames of a carried vehicle: bundle adjustment.
//!
//! ```text
//! min over T_t, X_f, s   Σ ρ(‖u_ftk − π(X_f⁻¹ T_t e^s c_k)‖/σ) + known tags + tapes + s²/(2 σ_s²)
//! ```
//! - `T_t`: pose of tag t in the hall, `hall_from_tag`; `X_f`: pose of the body at frame f, `hall_from_body`
//! - `c_k`: corner k of the tag in its own axes, m; `u_ftk`: where it was seen, px; `π`: mounting and lens
//! - `s`: one common scale of all edges: sheets come from one printer, which may shrink them
//! - `ρ`: Huber's loss, later the square over what kept within [`GATE_SIGMAS`]
//!
//! Known tags hold the hall's axes; tapes and known tags hold the scale. The poses of the frames are
//! eliminated (Schur), what remains is a dense system in tags and scale, and its inverse is their covariance.
//! Only what the input does not determine stays as uncertain as it is: with known tags in one corner the far
//! wall swings, and the covariance says so.
//!
//! Source: Triggs, `McLauchlan`, Hartley, Fitzgibbon 2000, sections 4 and 6; Huber 1964 for the loss.
//! Checked: `adjustment_jacobian_matches_central_difference`,
//! `every_tag_is_found_within_what_is_claimed`,
//! `wrong_names_swapped_corners_and_mirrored_tags_change_nothing`.

mod flip;
mod gate;
mod normal;
mod start;
mod tag_start;

#[cfg(test)]
mod tests;

use super::camera_model::CameraModel;
use crate::geometry::{Body, Hall, Point, Tag, Transform};
use nalgebra::{DMatrix, Matrix3, Matrix6, Vector3};
use normal::{Normal, Problem};

/// Corners farther off than this are left out of the final sum, in σ of a corner.
pub const GATE_SIGMAS: f64 = 4.0;
const MAX_ITERATIONS: usize = 40;
/// So often frames and tags are added that did not fit before.
const MAX_EXTENSIONS: usize = 6;
/// Between extensions the minimum need not be met well; at the end a step of this share of χ²
/// moves nothing by more than some hundredths of its σ.
const ROUGH_GAIN: f64 = 1e-3;
const FINE_GAIN: f64 = 1e-8;

/// A tag in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Its place among the tags.
    pub tag: usize,
    /// Its corners as detectors give them, px.
    pub corners_px: [[f64; 2]; 4],
}

/// All tags in one frame of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Which of the cameras.
    pub camera: usize,
    /// The tags.
    pub sightings: Vec<Sighting>,
}

/// A tag whose pose is known beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownTag {
    /// Which.
    pub tag: usize,
    /// Its pose in the hall.
    pub hall_from_tag: Transform<Hall, Tag>,
    /// σ of each corner, each axis, m.
    pub corner_sigma_m: f64,
}

/// A distance between the middles of two tags.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tape {
    /// Which two.
    pub tags: [usize; 2],
    /// Measured, m.
    pub distance_m: f64,
    /// Its σ, m.
    pub sigma_m: f64,
}

/// What is adjusted.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// The cameras.
    pub cameras: Vec<CameraModel>,
    /// Edge of each tag's black square, m.
    pub edges_m: Vec<f64>,
    /// The frames.
    pub views: Vec<View>,
    /// What holds the axes; at least one.
    pub known: Vec<KnownTag>,
    /// What holds the scale.
    pub tapes: Vec<Tape>,
    /// σ of a corner, px.
    pub corner_sigma_px: f64,
    /// σ of the common scale of all edges, relative.
    pub scale_sigma: f64,
}

/// Why there is no map.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AdjustError {
    /// Nothing holds the axes.
    #[error("no known tag: the hall's axes are held by nothing")]
    NothingKnown,
    /// No frame shows a known tag well enough to begin.
    #[error(
        "no frame fixes its pose by the known tags: carry the camera nearer to them, so that two are in view"
    )]
    NoStart,
    /// The equations have no solution.
    #[error("the frames leave some direction of the map free")]
    Singular,
}

/// The map that explains all frames best.
#[derive(Debug, Clone, PartialEq)]
pub struct AdjustedMap {
    /// Pose of each tag; `None` for those that no chain of frames ties to the known ones.
    pub tags: Vec<Option<Transform<Hall, Tag>>>,
    /// Pose of the body at each view; `None` for those that were not used.
    pub bodies: Vec<Option<Transform<Hall, Body>>>,
    /// The common factor of all edges.
    pub edge_factor: f64,
    /// Its σ.
    pub edge_factor_sigma: f64,
    /// Corners in the final sum, and those left out by the gate.
    pub n_corners: usize,
    /// Left out by the gate.
    pub n_outliers: usize,
    /// Root mean square of the residuals in the sum, each coordinate, px.
    pub residual_rms_px: f64,
    /// χ² over its degrees of freedom; about 1 if the σ of a corner is right.
    pub variance_factor: f64,
    /// Frames that each tag was seen in and counted.
    pub n_views: Vec<usize>,
    /// Covariance of all tags (position, attitude) and the scale; rows by [`Self::row`].
    cov: DMatrix<f64>,
    rows: Vec<Option<usize>>,
}

impl AdjustedMap {
    /// Where a tag's six rows begin.
    fn row(&self, tag: usize) -> Option<usize> {
        self.rows.get(tag).copied().flatten()
    }

    /// Covariance of a tag's pose: position in hall axes (m), then attitude in its own (rad), 6×6.
    #[must_use]
    pub fn pose_cov(&self, tag: usize) -> Option<Matrix6<f64>> {
        let row = self.row(tag)?;
        Some(self.cov.fixed_view::<6, 6>(row, row).into_owned())
    }

    /// The distance of two tags' middles and its σ, m.
    #[must_use]
    pub fn distance(&self, tags: [usize; 2]) -> Option<(f64, f64)> {
        let [a, b] = tags.map(|tag| self.tags.get(tag).copied().flatten());
        let line = (a?.origin - b?.origin).coords;
        let direction = line.normalize();
        let [i, j] = tags.map(|tag| self.row(tag));
        let (i, j) = (i?, j?);
        let block =
            |r: usize, c: usize| -> Matrix3<f64> { self.cov.fixed_view::<3, 3>(r, c).into() };
        let cov = block(i, i) + block(j, j) - block(i, j) - block(j, i);
        Some((line.norm(), direction.dot(&(cov * direction)).max(0.0).sqrt()))
    }

    /// Corners of a tag in the hall, its edge corrected by the common factor.
    #[must_use]
    pub fn corners(&self, tag: usize, edge_m: f64) -> Option<[Point<Hall>; 4]> {
        let pose = self.tags.get(tag).copied().flatten()?;
        Some(corners_in_tag(edge_m * self.edge_factor).map(|corner| pose * corner))
    }
}

/// Corners in the tag's own axes, in the order of detectors.
#[must_use]
pub fn corners_in_tag(edge_m: f64) -> [Point<Tag>; 4] {
    let half_m = 0.5 * edge_m;
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y)| Point::new(x * half_m, y * half_m, 0.0))
}

/// The pose of a tag from its corners in the hall: the square nearest to them.
#[must_use]
pub fn pose_of_corners(corners: &[Point<Hall>; 4]) -> Transform<Hall, Tag> {
    let [low_left, low_right, up_right, up_left] = corners.map(|corner| corner.coords);
    let right = (low_right - low_left + up_right - up_left).normalize();
    let up = up_left - low_left + up_right - low_right;
    let up = (up - right * right.dot(&up)).normalize();
    let axes = Matrix3::from_columns(&[right, up, right.cross(&up)]);
    let middle: Vector3<f64> = (low_left + low_right + up_right + up_left) / 4.0;
    Transform::new(crate::geometry::Rotation::from_matrix(&axes), Point::from_coords(middle))
}

/// Adjusts a survey.
///
/// First places come from frame after frame and grow worse with each; the adjustment draws them
/// together, and then frames and tags fit that did not before, until nothing new fits.
///
/// # Errors
/// [`AdjustError`] says what is missing.
pub fn adjust(survey: &Survey) -> Result<AdjustedMap, AdjustError> {
    if survey.known.is_empty() {
        return Err(AdjustError::NothingKnown);
    }
    let mut located = start::located(survey)?;
    let mut problem = Problem::new(survey, located);
    for _ in 0..MAX_EXTENSIONS {
        problem.leave_out_undetermined();
        minimized(&mut problem, ROUGH_GAIN)?;
        located = problem.located();
        if start::extend(survey, &mut located) == 0 {
            break;
        }
        problem = Problem::new(survey, located);
    }
    problem.leave_out_undetermined();
    minimized(&mut problem, ROUGH_GAIN)?;
    problem.turn_flipped_tags();
    minimized(&mut problem, FINE_GAIN)?;
    // Huber's solution leans a little towards each outlier; without them it is searched again.
    let n_outliers = problem.gate(GATE_SIGMAS);
    let normal = minimized(&mut problem, FINE_GAIN)?;
    result(&problem, &normal, n_outliers)
}

/// Levenberg–Marquardt on the problem's own state, until a step gains less than this share of the
/// cost.
fn minimized(problem: &mut Problem<'_>, least_gain: f64) -> Result<Normal, AdjustError> {
    let mut normal = problem.normal();
    let mut damping = 1e-4;
    for _ in 0..MAX_ITERATIONS {
        let Some(step) = normal.step(damping) else { return Err(AdjustError::Singular) };
        let candidate = problem.moved(&step);
        let next = candidate.normal();
        if next.cost < normal.cost {
            let gained = normal.cost - next.cost;
            *problem = candidate;
            normal = next;
            damping = (damping * 0.2_f64).max(1e-12);
            if gained < least_gain * (1.0 + normal.cost) {
                break;
            }
        } else {
            damping *= 8.0;
            if damping > 1e8 {
                break;
            }
        }
    }
    Ok(normal)
}

#[expect(clippy::cast_precision_loss, reason = "counts of corners")]
fn result(
    problem: &Problem<'_>,
    normal: &Normal,
    n_outliers: usize,
) -> Result<AdjustedMap, AdjustError> {
    let cov = normal.reduced_covariance().ok_or(AdjustError::Singular)?;
    let (n_corners, squares) = problem.sum_of_squares();
    let n_rows = 2 * n_corners + problem.n_prior_rows();
    let dof = n_rows.saturating_sub(problem.n_unknowns()).max(1) as f64;
    let variance_factor = (2.0 * normal.cost / dof).max(0.0);
    // Corners that scatter more than was said make everything less sure, but never more.
    let cov = cov * variance_factor.max(1.0);
    let scale_row = cov.nrows() - 1;
    Ok(AdjustedMap {
        tags: problem.tags().to_vec(),
        bodies: problem.bodies().to_vec(),
        edge_factor: problem.edge_factor(),
        edge_factor_sigma: cov[(scale_row, scale_row)].sqrt() * problem.edge_factor(),
        n_corners,
        n_outliers,
        residual_rms_px: (squares / (2 * n_corners).max(1) as f64).sqrt()
            * problem.corner_sigma_px(),
        variance_factor,
        n_views: problem.n_views(),
        cov,
        rows: problem.rows().to_vec(),
    })
}
