//! Corners where a tag's four edges meet, each edge fitted to all pixels near it.
//!
//! The library looks for an edge at some places of it and reads single pixels there, so a part of its first
//! guess stays, which it made on the shrunk picture: a shift to the upper left that grows with
//! [`Settings::decimation`](super::Settings::decimation), and errors of a tenth of a pixel that come again in every
//! picture from the same place. No filter averages those away. Here each pixel counts once, at its centre:
//!
//! ```text
//! I(p) = d + (b − d) Φ(δ(p)/σ)        δ(p) = n·(p − m) − o − τ t·(p − m)/h
//! ```
//! - `I`: brightness of a pixel, 0 to 255; `p`: its centre, px
//! - `m, t, n`: middle of the edge, its direction and its outward normal as the library has them
//! - `h`: half the part that is looked at, px
//! - `o, τ`: offset of the edge and tilt at `h`, px; `d, b`: dark and bright side; `σ`: blur, px. These five are fitted
//!   by Gauss and Newton's method
//!
//! A blur that is alike on both sides moves nothing, whatever its shape. The lens may bend an edge: over
//! 50 px by some hundredths of a pixel. An edge that does not fit, as one that something hides in part, stays as the
//! library has it.

use crate::camera::picture::GreyPicture;
use nalgebra::{Matrix5, Vector2, Vector5};
use std::f64::consts::{SQRT_2, TAU};

/// Pixels up to this far from an edge tell where it is: beyond begin the next cells. They count across the edge: of a
/// tag that is seen aslant they are much shorter there than along it.
const BAND_CELLS: f64 = 0.6;
/// The same is at least and at most this, px.
const BAND_PX: (f64, f64) = (1.0, 2.5);
/// The ends of an edge, where the next one is near, are left out: cells, and at least px.
const END_CELLS: f64 = 0.5;
const END_PX: f64 = 1.5;
/// Blur of an ordinary lens in focus, the pixel's own square included, px; the fit begins with it.
const USUAL_BLUR_PX: f64 = 0.7;
const BLUR_PX: (f64, f64) = (0.3, 2.0);
/// No more rows or columns of pixels than this are looked at along an edge, evenly spread: what a near tag has more of them
/// costs time and tells no more.
const MOST_LINES: f64 = 200.0;
/// Fewer pixels tell nothing about five numbers.
const LEAST_PIXELS: usize = 12;
/// Sides that differ by less are no edge of a tag.
const LEAST_CONTRAST: f64 = 12.0;
/// The library is not off by more, px.
const FARTHEST_PX: f64 = 1.5;
/// Root mean square of what is left over, as a share of the contrast, where the model does not hold.
const WORST_MISFIT: f64 = 0.12;
/// The pixels are chosen anew so often, and so many steps are made with each choice.
const ROUNDS: usize = 3;
const STEPS: usize = 5;
/// A round has ended when the edge moves by less, px.
const STILL_PX: f64 = 1e-3;
/// A fit that still moves by more at the end has found nothing, px.
const SETTLED_PX: f64 = 0.02;

/// The corners of a tag, better; `n_cells` along its edge.
pub(super) fn refined(
    picture: &GreyPicture,
    corners_px: [[f64; 2]; 4],
    n_cells: u8,
) -> [[f64; 2]; 4] {
    let corners = corners_px.map(Vector2::from);
    let centre = corners.iter().sum::<Vector2<f64>>() / 4.0;
    let edges: [Edge; 4] = std::array::from_fn(|i| {
        Edge::new(corners[i], corners[(i + 1) % 4], centre, f64::from(n_cells))
    });
    let lines = edges.map(|edge| {
        edge.fitted(picture).unwrap_or(Line { through: edge.middle, along: edge.along })
    });
    std::array::from_fn(|i| {
        let meeting = lines[(i + 3) % 4].meets(&lines[i]).unwrap_or(corners[i]);
        if (meeting - corners[i]).norm() < 2.0 * FARTHEST_PX {
            meeting.into()
        } else {
            corners_px[i]
        }
    })
}

#[derive(Debug, Clone, Copy)]
struct Line {
    through: Vector2<f64>,
    along: Vector2<f64>,
}

impl Line {
    /// Where two lines meet; `None` if they hardly do.
    fn meets(&self, other: &Self) -> Option<Vector2<f64>> {
        const LEAST_SINE: f64 = 0.1;
        let sine = self.along.perp(&other.along);
        let at = (other.through - self.through).perp(&other.along) / sine;
        (sine.abs() > LEAST_SINE).then(|| self.through + self.along * at)
    }
}

/// An edge as the library has it, and how far around it is looked.
#[derive(Debug, Clone, Copy)]
struct Edge {
    middle: Vector2<f64>,
    along: Vector2<f64>,
    outward: Vector2<f64>,
    half_px: f64,
    band_px: f64,
}

/// A pixel near an edge: its place along it, −1 to 1, its distance outward from where the library has the edge,
/// px, and its brightness.
#[derive(Debug, Clone, Copy)]
struct Near {
    along: f64,
    across_px: f64,
    grey: f64,
}

impl Near {
    /// Distance outward from the fitted edge, as a multiple of the blur, and the share of the bright side.
    fn place(&self, fit: &Vector5<f64>) -> (f64, f64) {
        let z = (self.across_px - fit[0] - fit[1] * self.along) / fit[4];
        (z, 0.5 * (1.0 + libm::erf(z / SQRT_2)))
    }

    /// What the fit leaves over.
    fn residual(&self, fit: &Vector5<f64>) -> f64 {
        let (_, share) = self.place(fit);
        self.grey - (fit[2] + (fit[3] - fit[2]) * share)
    }
}

impl Edge {
    fn new(from: Vector2<f64>, to: Vector2<f64>, centre: Vector2<f64>, n_cells: f64) -> Self {
        let length_px = (to - from).norm();
        let along = (to - from) / length_px;
        let middle = 0.5 * (from + to);
        let normal = Vector2::new(along.y, -along.x);
        let outward = if normal.dot(&(middle - centre)) < 0.0 { -normal } else { normal };
        let half_px = 0.5 * length_px - (END_CELLS * length_px / n_cells).max(END_PX);
        let across_px = 2.0 * outward.dot(&(middle - centre)) / n_cells;
        let band_px = (BAND_CELLS * across_px).clamp(BAND_PX.0, BAND_PX.1);
        Self { middle, along, outward, half_px, band_px }
    }

    /// The line through the fitted edge; `None` if it does not fit.
    fn fitted(&self, picture: &GreyPicture) -> Option<Line> {
        let first = self.first_guess(picture)?;
        let mut fit = first;
        let mut left_px = f64::INFINITY;
        for _ in 0..ROUNDS {
            // Within a round the pixels stay the same: one that comes and goes would keep the fit from settling.
            let near: Vec<Near> = self.pixels(picture, fit[0], fit[1]).collect();
            for _ in 0..STEPS {
                let step = least_squares_step(&near, &fit, &first)?;
                fit += step;
                fit[4] = fit[4].clamp(BLUR_PX.0, BLUR_PX.1);
                let is_possible =
                    fit[0].abs() + fit[1].abs() < FARTHEST_PX && fit[3] - fit[2] > LEAST_CONTRAST;
                if !is_possible {
                    return None;
                }
                left_px = step[0].abs() + step[1].abs();
                if left_px < STILL_PX {
                    break;
                }
            }
        }
        let near: Vec<Near> = self.pixels(picture, fit[0], fit[1]).collect();
        let is_good =
            left_px < SETTLED_PX && misfit(&near, &fit) < WORST_MISFIT * (fit[3] - fit[2]);
        is_good.then(|| self.moved(fit[0], fit[1]))
    }

    fn moved(&self, offset_px: f64, tilt_px: f64) -> Line {
        let along = self.along + self.outward * (tilt_px / self.half_px);
        Line { through: self.middle + self.outward * offset_px, along: along.normalize() }
    }

    /// Offset, tilt, dark, bright and blur, the levels from the rims of the band.
    fn first_guess(&self, picture: &GreyPicture) -> Option<Vector5<f64>> {
        let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
        for near in self.pixels(picture, 0.0, 0.0) {
            if near.across_px.abs() > 0.5 * self.band_px {
                let side = usize::from(near.across_px > 0.0);
                sums[side] += near.grey;
                counts[side] += 1.0;
            }
        }
        let (dark, bright) = (sums[0] / counts[0], sums[1] / counts[1]);
        (bright - dark > LEAST_CONTRAST)
            .then(|| Vector5::new(0.0, 0.0, dark, bright, USUAL_BLUR_PX))
    }

    /// The pixels near the edge once it is moved so, line by line of pixels across it.
    fn pixels<'a>(
        &'a self,
        picture: &'a GreyPicture,
        offset_px: f64,
        tilt_px: f64,
    ) -> impl Iterator<Item = Near> + 'a {
        let size = [picture.width_px(), picture.height_px()];
        // Columns of an edge that lies rather than stands, otherwise rows.
        let (major, minor) = if self.along.x.abs() < self.along.y.abs() { (1, 0) } else { (0, 1) };
        let reach_px = self.band_px + offset_px.abs() + tilt_px.abs();
        let extent_px =
            self.along[major].abs() * self.half_px + self.outward[major].abs() * reach_px;
        let at = self.middle[major];
        let lines = whole_px(at - extent_px, at + extent_px, size[major]);
        let step = lines_apart(2.0 * extent_px);
        let slope = self.along[minor] / self.along[major];
        let across_px = reach_px / self.along[major].abs();
        let places = lines.step_by(step).flat_map(move |line| {
            let at = self.middle[minor] + slope * (f64::from(line) + 0.5 - self.middle[major]);
            let others = whole_px(at - across_px - 0.5, at + across_px + 0.5, size[minor]);
            others.map(move |other| if major == 0 { (line, other) } else { (other, line) })
        });
        let width = picture.width_px() as usize;
        places.filter_map(move |(col, row)| {
            let centre = Vector2::new(f64::from(col) + 0.5, f64::from(row) + 0.5) - self.middle;
            let along = centre.dot(&self.along) / self.half_px;
            let across_px = centre.dot(&self.outward);
            let distance_px = across_px - offset_px - tilt_px * along;
            let grey = picture.pixels()[row as usize * width + col as usize];
            let is_near = along.abs() <= 1.0 && distance_px.abs() <= self.band_px;
            is_near.then(|| Near { along, across_px, grey: f64::from(grey) })
        })
    }
}

/// Every how many rows or columns of so many are looked at.
fn lines_apart(n_lines: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
    let apart = (n_lines / MOST_LINES).ceil() as usize;
    // Also for an edge without a length, whose number is none.
    apart.max(1)
}

/// One step of Gauss and Newton towards the least squares; `first` holds what pixels do not tell.
fn least_squares_step(
    near: &[Near],
    fit: &Vector5<f64>,
    first: &Vector5<f64>,
) -> Option<Vector5<f64>> {
    /// Weight of the first guess: of the levels, pixels; of the blur, (grey/px)².
    const FIRST_INFO: [f64; 5] = [0.0, 0.0, 1.0, 1.0, 400.0];
    if near.len() < LEAST_PIXELS {
        return None;
    }
    let first_info = Vector5::from(FIRST_INFO);
    let mut info = Matrix5::from_diagonal(&first_info);
    let mut gain = first_info.component_mul(&(first - fit));
    for pixel in near {
        let (z, share) = pixel.place(fit);
        let slope = (fit[3] - fit[2]) * (-0.5 * z * z).exp() / (TAU.sqrt() * fit[4]);
        let by = Vector5::new(-slope, -slope * pixel.along, 1.0 - share, share, -slope * z);
        info += by * by.transpose();
        gain += by * pixel.residual(fit);
    }
    Some(info.cholesky()?.solve(&gain))
}

/// Root mean square of what a fit leaves over.
fn misfit(near: &[Near], fit: &Vector5<f64>) -> f64 {
    let squares: f64 = near.iter().map(|pixel| pixel.residual(fit).powi(2)).sum();
    #[expect(clippy::cast_precision_loss, reason = "some hundred pixels")]
    let n_pixels = near.len() as f64;
    (squares / n_pixels).sqrt()
}

/// Pixels between two places, within the picture.
fn whole_px(low: f64, high: f64, size: u32) -> std::ops::Range<u32> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    let whole = |at: f64| at.clamp(0.0, f64::from(size)) as u32;
    whole(low.floor())..whole(high.ceil())
}

#[cfg(test)]
mod tests;
