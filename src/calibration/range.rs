//! How far off the LiDAR's ranges are, how much they scatter and where it sees the vehicle itself,
//! from scans taken before a flat wall at taped distances.
//!
//! ```text
//! r(a) = d/cos(a − φ)·(1 + s) + b + noise
//! ```
//! - `d`: taped distance from the axis of the head to the wall, square on, m; `φ`: where the wall is
//! - `b`: bias, m; `s`: scale; the same at all distances, found by weighted least squares over them
//!
//! What cannot be seen is not claimed: without distances far apart the scale stays as configured and
//! its σ makes the bias less sure; distances that contradict each other are refused by name.
//! Not done here: reading the sensor (the program does), writing the configuration (`config`).
//! Checked: `bias_scale_and_noise_come_back_within_their_sigma`.

mod body;
mod wall;

#[cfg(test)]
mod tests;

use crate::messages::Scan;
pub use body::Sector;
use nalgebra::{Matrix2, Vector2};
use wall::Wall;

/// Distances must span this before a scale is told from a bias, m.
pub const SCALE_SPAN_M: f64 = 1.0;
/// … and so many are needed, so that one of them can contradict the others.
pub const SCALE_POSITIONS: usize = 3;
/// One wall is not every surface: no bias is known better than this, m.
const LEAST_BIAS_SIGMA_M: f64 = 0.001;
/// Distances that scatter by more than this many times what was said contradict each other.
const MAX_SCATTER: f64 = 3.0;

/// Scans at one taped distance.
#[derive(Debug, Clone, PartialEq)]
pub struct Position {
    /// From the axis of the head to the wall, square on, m.
    pub taped_m: f64,
    /// As the sensor gave them, uncorrected.
    pub scans: Vec<Scan>,
}

/// How well the tape is read, and what holds where the scans do not tell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Request {
    /// σ of each taped distance, m.
    pub tape_sigma_m: f64,
    /// σ of where the axis of the head is, the same at all distances, m.
    pub axis_sigma_m: f64,
    /// Distances that the maker vouches for, m.
    pub range_m: (f64, f64),
    /// Step of the transmitted distance, m.
    pub range_step_m: f64,
    /// The scale in use and its σ, for the case that it cannot be seen.
    pub scale: (f64, f64),
}

/// A number and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    /// The number.
    pub value: f64,
    /// Its σ.
    pub sigma: f64,
}

/// What one distance says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Taped, m.
    pub taped_m: f64,
    /// The wall in the sensor's own ranges, m.
    pub measured_m: f64,
    /// What bias and scale leave of the difference, m.
    pub left_m: f64,
    /// Standard deviation of one range, m.
    pub noise_m: f64,
    /// Where the wall is, from x of the LiDAR towards y, rad.
    pub direction_rad: f64,
    /// Beams on the wall.
    pub n_beams: usize,
    /// Share of the beams towards it that came back from it.
    pub share: f64,
}

/// The answer.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeCheck {
    /// Ranges come out longer by this, m …
    pub bias_m: Known,
    /// … and by this share; `None` if the distances do not tell.
    pub scale: Option<Known>,
    /// Standard deviation of one range where it scatters most, m.
    pub noise_m: Known,
    /// Each distance.
    pub lines: Vec<Line>,
    /// Where the sensor sees the vehicle; `None` if it was not moved enough to tell.
    pub body: Option<Vec<Sector>>,
}

/// Why nothing can be said, with the cure.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// No distance was given.
    #[error(
        "no distance: tape some from the axis of the head to a flat wall, near, middle and far"
    )]
    NoPosition,
    /// Outside what the sensor measures.
    #[error("{taped_m:.3} m is outside {from_m} to {to_m} m, which this sensor measures")]
    OutOfReach {
        /// Taped.
        taped_m: f64,
        /// Nearest.
        from_m: f64,
        /// Farthest.
        to_m: f64,
    },
    /// Too few beams.
    #[error(
        "at {taped_m:.3} m only {n_beams} beams came in, {least} are needed: record longer, and see `stockpilot doctor`"
    )]
    TooFew {
        /// Taped.
        taped_m: f64,
        /// How many came.
        n_beams: usize,
        /// How many are needed.
        least: usize,
    },
    /// Nothing like a wall is there.
    #[error(
        "at {taped_m:.3} m no flat wall within {tolerance_m:.2} m of the tape{}: stand square before a bare wall two metres wide, not glass, not black, and measure from the axis of the head",
        .nearest_m.map_or_else(String::new, |m| format!(", the nearest is at {m:.2} m"))
    )]
    NoWall {
        /// Taped.
        taped_m: f64,
        /// How far off it may be.
        tolerance_m: f64,
        /// The straight thing nearest to it.
        nearest_m: Option<f64>,
    },
    /// Two of them.
    #[error(
        "at {taped_m:.3} m there are two walls at that distance, towards {first_deg:.0}° and {second_deg:.0}°: stand nearer to one of them, or name it by --towards-deg"
    )]
    TwoWalls {
        /// Taped.
        taped_m: f64,
        /// One of them.
        first_deg: f64,
        /// The other.
        second_deg: f64,
    },
    /// Not at rest.
    #[error(
        "at {taped_m:.3} m the wall moved by {moved_mm:.0} mm while it was recorded: put the vehicle down, do not hold it"
    )]
    Moved {
        /// Taped.
        taped_m: f64,
        /// By how much.
        moved_mm: f64,
    },
    /// One of the taped distances is wrong.
    #[error(
        "the distances contradict each other: {worst_m:.3} m is off by {off_mm:.0} mm from what the others say, {sigmas:.0} times what the tape allows: measure it again"
    )]
    Contradiction {
        /// The worst.
        worst_m: f64,
        /// By how much.
        off_mm: f64,
        /// The scatter in σ.
        sigmas: f64,
    },
}

/// Judges scans at taped distances; `towards_rad` names the wall where several are there.
///
/// # Errors
/// [`Refusal`] says what is missing and how to get it.
pub fn check(
    positions: &[Position],
    towards_rad: Option<f64>,
    request: &Request,
) -> Result<RangeCheck, Refusal> {
    if positions.is_empty() {
        return Err(Refusal::NoPosition);
    }
    let (from_m, to_m) = request.range_m;
    if let Some(off) = positions.iter().find(|p| !(from_m..=to_m).contains(&p.taped_m)) {
        return Err(Refusal::OutOfReach { taped_m: off.taped_m, from_m, to_m });
    }
    let body = body::sectors(positions);
    let seen = positions
        .iter()
        .map(|position| wall::find(position, body.as_deref().unwrap_or_default(), towards_rad));
    let walls = seen.collect::<Result<Vec<Wall>, _>>()?;
    let solved = solve(positions, &walls, request)?;
    let noisiest = walls.iter().max_by(|a, b| a.noise_m.total_cmp(&b.noise_m));
    let noise_m = noisiest.map_or(Known { value: 0.0, sigma: 0.0 }, |wall| Known {
        value: wall.noise_m.max(request.range_step_m / 12_f64.sqrt()),
        sigma: wall.noise_m / (2.0 * count(wall.n_beams)).sqrt(),
    });
    let lines = positions.iter().zip(&walls).zip(&solved.left_m);
    let lines = lines.map(|((position, wall), left_m)| Line {
        taped_m: position.taped_m,
        measured_m: wall.distance_m,
        left_m: *left_m,
        noise_m: wall.noise_m,
        direction_rad: wall.direction_rad,
        n_beams: wall.n_beams,
        share: wall.share,
    });
    Ok(RangeCheck {
        bias_m: solved.bias_m,
        scale: solved.scale,
        noise_m,
        lines: lines.collect(),
        body,
    })
}

struct Solved {
    bias_m: Known,
    scale: Option<Known>,
    left_m: Vec<f64>,
}

/// Bias and scale by weighted least squares over the distances.
///
/// ```text
/// D_j − d_j = b + s d_j,   weights 1/(σ_tape² + σ_Dj²)
/// ```
fn solve(positions: &[Position], walls: &[Wall], request: &Request) -> Result<Solved, Refusal> {
    let taped = || positions.iter().map(|position| position.taped_m);
    let span_m = taped().fold(f64::NEG_INFINITY, f64::max) - taped().fold(f64::INFINITY, f64::min);
    let is_scale_seen = positions.len() >= SCALE_POSITIONS && span_m >= SCALE_SPAN_M;
    let (mut information, mut right) = (Matrix2::zeros(), Vector2::zeros());
    if !is_scale_seen {
        // The scale in use holds, as well as it is known.
        let (scale, sigma) = (request.scale.0, request.scale.1.max(1e-9));
        information[(1, 1)] += sigma.powi(-2);
        right[1] += scale * sigma.powi(-2);
    }
    let sigmas_m = walls.iter().map(|wall| request.tape_sigma_m.hypot(wall.sigma_m));
    let sigmas_m: Vec<f64> = sigmas_m.collect();
    for ((d, wall), sigma_m) in taped().zip(walls).zip(&sigmas_m) {
        let row = Vector2::new(1.0, d);
        information += row * row.transpose() / (sigma_m * sigma_m);
        right += row * (wall.distance_m - d) / (sigma_m * sigma_m);
    }
    // With a weight on each row the two are always determined: one by the prior if not by the rows.
    let cov = information.try_inverse().unwrap_or_else(Matrix2::zeros);
    let found = cov * right;
    let left = |(d, wall): (f64, &Wall)| wall.distance_m - d - found[0] - found[1] * d;
    let left_m: Vec<f64> = taped().zip(walls).map(left).collect();
    let scatter = contradiction(positions, &left_m, &sigmas_m, if is_scale_seen { 2 } else { 1 })?;
    let sigma = |k: usize| cov[(k, k)].max(0.0).sqrt() * scatter;
    let bias_sigma_m = sigma(0).hypot(request.axis_sigma_m).max(LEAST_BIAS_SIGMA_M);
    Ok(Solved {
        bias_m: Known { value: found[0], sigma: bias_sigma_m },
        scale: is_scale_seen.then(|| Known { value: found[1], sigma: sigma(1) }),
        left_m,
    })
}

/// By how much the distances scatter more than said, 1 at least.
fn contradiction(
    positions: &[Position],
    left_m: &[f64],
    sigmas_m: &[f64],
    n_found: usize,
) -> Result<f64, Refusal> {
    if left_m.len() <= n_found {
        return Ok(1.0);
    }
    let squares: f64 =
        left_m.iter().zip(sigmas_m).map(|(left, sigma)| (left / sigma).powi(2)).sum();
    let scatter = (squares / count(left_m.len() - n_found)).sqrt();
    if scatter > MAX_SCATTER {
        let lines = positions.iter().zip(left_m);
        let worst = lines.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        if let Some((position, left_m)) = worst {
            let (worst_m, off_mm) = (position.taped_m, 1e3 * left_m.abs());
            return Err(Refusal::Contradiction { worst_m, off_mm, sigmas: scatter });
        }
    }
    Ok(scatter.max(1.0))
}

#[expect(clippy::cast_precision_loss, reason = "counts of beams")]
fn count(n: usize) -> f64 {
    n as f64
}
