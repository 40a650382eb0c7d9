//! What a camera's sensor makes of the hall: a grey picture of tags on plain walls.
//!
//! ```text
//! I(pixel) = mean over m of L(ray(pixel + o_m), t_m)
//! ```
//! - `o_m`: offsets spread like the blur, a pixel's square convolved with a Gaussian, px, m = 1…[`N_SAMPLES`]
//! - `t_m`: instants spread over the exposure, so that motion blurs
//!
//! Every offset at an instant has its opposite at the opposite instant, and all three are spread evenly together, so
//! neither blur nor motion moves an edge from where it is in the middle of the exposure. A kernel that leans to one
//! side would: where offsets went with instants, edges that moved by 190 px/s were seen 0.03 px too early.
//!
//! - `L`: brightness where the ray meets a tag, or of the wall
//!
//! The ray of a pixel is found by inverting [`Lens::project`]; within a few pixels it is linear. Edges come
//! from areas, not from lines that are drawn, so a corner lies where the world's corner is projected.
//!
//! Left out: shading, texture of walls, reflections, edges of what hides a tag are not smoothed, all
//! rows are exposed at the same time.

mod shades;

use super::picture::PictureModel;
use super::{CameraModel, Lens};
use crate::raycast;
use crate::world::{PlacedTag, World};
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use shades::{Local, Shades};
use stockpilot::geometry::{Camera, Direction, Hall, Transform};
use stockpilot::messages::TagPattern;
use stockpilot::stats::Noise;

/// Rays for a pixel that an edge may cross.
pub(super) const N_SAMPLES: usize = 48;
/// Instants of the exposure.
pub(super) const N_INSTANTS: usize = 4;
/// Normal numbers that noise is taken from, over and over from other places.
const N_NOISE: usize = 65_537;
/// The white margin around a tag, cells.
const MARGIN_CELLS: f64 = 1.0;

/// Draws pictures of one camera.
#[derive(Clone)]
pub struct Renderer {
    lens: Lens,
    model: PictureModel,
    /// (X/Z, Y/Z) of each pixel's centre by rows; NaN where the lens means nothing.
    rays: Vec<Vector2<f64>>,
    /// How dark a pixel is against the middle of the picture, by rows.
    fall_off: Vec<f32>,
    samples: Vec<Sample>,
    /// The farthest offset along u or v.
    reach_px: f64,
    noise: Vec<f32>,
}

impl std::fmt::Debug for Renderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Renderer").field("lens", &self.lens).field("model", &self.model).finish()
    }
}

/// One ray of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    /// From the pixel's centre, px right and down.
    offset_px: [f32; 2],
    /// When it looks, by number.
    instant: usize,
}

/// A tag before a camera.
struct SeenTag {
    shades: Shades,
    /// At each instant: takes a ray (x, y, 1) to cells right and down from the upper left corner, and 1/depth.
    cells_from_ray: [Matrix3<f64>; N_INSTANTS],
    /// Columns and rows that it may touch.
    cols: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
    distance_m: f64,
    is_partly_hidden: bool,
}

impl Renderer {
    /// A renderer for this lens; it needs some tenths of a second for the table of rays.
    #[must_use]
    pub fn new(camera: &CameraModel, model: PictureModel, mut noise: Noise) -> Self {
        let lens = camera.lens;
        let rays: Vec<Vector2<f64>> = (0..lens.height_px)
            .flat_map(|row| (0..lens.width_px).map(move |col| (col, row)))
            .map(|(col, row)| {
                let pixel = Vector2::new(f64::from(col) + 0.5, f64::from(row) + 0.5);
                lens.ray(&pixel).unwrap_or_else(|| Vector2::repeat(f64::NAN))
            })
            .collect();
        let fall_off = fall_off(&rays, model.vignetting);
        let samples = samples(model.blur_sigma_px);
        let farthest_px = samples.iter().flat_map(|sample| sample.offset_px);
        let reach_px = f64::from(farthest_px.map(f32::abs).fold(0.0, f32::max));
        #[expect(clippy::cast_possible_truncation, reason = "noise needs no more digits")]
        let noise = (0..N_NOISE).map(|_| noise.normal() as f32).collect();
        Self { lens, model, rays, fall_off, samples, reach_px, noise }
    }

    /// The picture of an exposure, by rows; `poses` are the camera's at instants spread over it.
    pub fn render(
        &self,
        world: &World,
        poses: &[Transform<Hall, Camera>; N_INSTANTS],
        noise: &mut Noise,
    ) -> Vec<u8> {
        let mut light = vec![self.model.wall; self.rays.len()];
        let mut tags: Vec<SeenTag> =
            world.tags.iter().filter_map(|tag| self.seen(world, poses, tag)).collect();
        // The nearer ones cover the others.
        tags.sort_by(|a, b| b.distance_m.total_cmp(&a.distance_m));
        for tag in &tags {
            self.paint(&mut light, world, &poses[N_INSTANTS / 2], tag);
        }
        self.developed(&light, noise)
    }

    fn seen(
        &self,
        world: &World,
        poses: &[Transform<Hall, Camera>; N_INSTANTS],
        tag: &PlacedTag,
    ) -> Option<SeenTag> {
        let pattern = TagPattern::new(tag.family, tag.id)?;
        let n_cells = f64::from(pattern.n_cells());
        let [low_left, _, up_right, up_left] = tag.corners.map(|corner| corner.coords);
        let (right, down) = ((up_right - up_left) / n_cells, (low_left - up_left) / n_cells);
        if (poses[0].origin.coords - up_left).dot(&tag.normal.coords) <= 0.0 {
            return None;
        }
        let (mut low, mut high) =
            (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
        let mut cells_from_ray = [Matrix3::zeros(); N_INSTANTS];
        for (pose, cells_from_ray) in poses.iter().zip(&mut cells_from_ray) {
            let camera_from_hall = pose.inverse();
            let turned =
                |v: Vector3<f64>| (camera_from_hall.rotation * Direction::from_coords(v)).coords;
            let origin =
                (camera_from_hall * stockpilot::geometry::Point::from_coords(up_left)).coords;
            let (right, down) = (turned(right), turned(down));
            *cells_from_ray = Matrix3::from_columns(&[right, down, origin]).try_inverse()?;
            let (near, far) = (-MARGIN_CELLS, n_cells + MARGIN_CELLS);
            for (col, row) in [(near, near), (far, near), (near, far), (far, far)] {
                let pixel = Vector2::from(self.lens.project(&(origin + right * col + down * row))?);
                (low, high) = (low.inf(&pixel), high.sup(&pixel));
            }
        }
        // A bent edge leaves the box of its corners by a few pixels at most.
        let rim = Vector2::repeat(self.reach_px + 4.0);
        let range =
            |axis: usize, size: u32| clipped(low[axis] - rim[axis], high[axis] + rim[axis], size);
        let (cols, rows) = (range(0, self.lens.width_px), range(1, self.lens.height_px));
        if cols.is_empty() || rows.is_empty() {
            return None;
        }
        let eye = &poses[N_INSTANTS / 2];
        let distance_m = (eye.origin.coords - tag.centre().coords).norm();
        let is_partly_hidden = match n_hidden(world, eye, tag) {
            0 => false,
            N_PROBES => return None,
            _ => true,
        };
        let shades = Shades::of(&pattern, self.model.white, self.model.black);
        Some(SeenTag { shades, cells_from_ray, cols, rows, distance_m, is_partly_hidden })
    }

    fn paint(
        &self,
        light: &mut [f32],
        world: &World,
        eye: &Transform<Hall, Camera>,
        tag: &SeenTag,
    ) {
        let width = self.lens.width_px as usize;
        for row in tag.rows.clone() {
            for col in tag.cols.clone() {
                let Some((ray, by_pixel)) = self.ray(col, row) else { continue };
                if tag.is_partly_hidden && is_hidden(world, eye, &ray, tag.distance_m) {
                    continue;
                }
                let before = light[row * width + col];
                light[row * width + col] = self.mixed(tag, &ray, &by_pixel, before);
            }
        }
    }

    /// A pixel's ray and how it changes by u and v.
    fn ray(&self, col: usize, row: usize) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        let (width, height) = (self.lens.width_px as usize, self.lens.height_px as usize);
        let at = |col: usize, row: usize| self.rays[row * width + col];
        let (left, right) = (col.saturating_sub(1), (col + 1).min(width - 1));
        let (above, below) = (row.saturating_sub(1), (row + 1).min(height - 1));
        let span = |from: usize, to: usize| (to - from) as f64;
        let by_u = (at(right, row) - at(left, row)) / span(left, right);
        let by_v = (at(col, below) - at(col, above)) / span(above, below);
        let ray = at(col, row);
        let is_known = ray.x.is_finite() && by_u.x.is_finite() && by_v.x.is_finite();
        is_known.then(|| (ray, Matrix2::from_columns(&[by_u, by_v])))
    }

    /// The mean over all samples of a pixel.
    #[expect(clippy::cast_possible_truncation, reason = "offsets need no more digits")]
    fn mixed(
        &self,
        tag: &SeenTag,
        ray: &Vector2<f64>,
        by_pixel: &Matrix2<f64>,
        before: f32,
    ) -> f32 {
        let locals = tag.cells_from_ray.each_ref().map(|m| Local::of(m, ray, by_pixel));
        let reach = self.reach_px as f32;
        let first = tag.shades.cell(&locals[0], [0.0, 0.0]);
        let is_plain = [&locals[0], &locals[N_INSTANTS - 1]].into_iter().all(|local| {
            [[-reach, -reach], [reach, -reach], [-reach, reach], [reach, reach]]
                .into_iter()
                .all(|offset| tag.shades.is_same(first, tag.shades.cell(local, offset)))
        });
        if is_plain {
            return tag.shades.light(first, before);
        }
        let lights = self.samples.iter().map(|sample| {
            tag.shades.light(tag.shades.cell(&locals[sample.instant], sample.offset_px), before)
        });
        #[expect(clippy::cast_precision_loss, reason = "48")]
        let n_samples = N_SAMPLES as f32;
        lights.sum::<f32>() / n_samples
    }

    /// Light to grey: falls off towards the border, is noisy, and ends at black and white.
    fn developed(&self, light: &[f32], noise: &mut Noise) -> Vec<u8> {
        let width = self.lens.width_px as usize;
        let mut grey = Vec::with_capacity(light.len());
        let read_var = self.model.read_noise.powi(2);
        let rows = light.chunks_exact(width).zip(self.fall_off.chunks_exact(width));
        for (lights, fall_off) in rows {
            let at = usize::try_from(noise.bits() % (N_NOISE - width) as u64).unwrap_or(0);
            let pixels = lights.iter().zip(fall_off).zip(&self.noise[at..at + width]);
            grey.extend(pixels.map(|((light, fall_off), noise)| {
                let signal = 255.0 * self.model.gain * light * fall_off;
                let sigma = (read_var + self.model.shot_noise * signal).sqrt();
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "a float-to-integer cast saturates, as the sensor does"
                )]
                let value = (signal + sigma * noise + 0.5) as u8;
                value
            }));
        }
        grey
    }
}

/// How dark each pixel is: the loss grows with the square of the tangent to the axis.
fn fall_off(rays: &[Vector2<f64>], vignetting: f32) -> Vec<f32> {
    let known = rays.iter().filter(|ray| ray.x.is_finite());
    let largest = known.map(Vector2::norm_squared).fold(1e-9, f64::max);
    let of = |ray: &Vector2<f64>| {
        #[expect(clippy::cast_possible_truncation, reason = "brightness")]
        let off_axis = (ray.norm_squared() / largest).min(1.0) as f32;
        1.0 - vignetting * off_axis
    };
    rays.iter().map(of).collect()
}

/// Whole pixels between two places, within the picture.
fn clipped(low: f64, high: f64, size: u32) -> std::ops::Range<usize> {
    let whole = |at: f64| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let px = at.clamp(0.0, f64::from(size)) as usize;
        px
    };
    whole(low.floor())..whole(high.ceil())
}

/// Places on a tag that are looked at to see whether something hides it.
const N_PROBES: usize = 81;

fn n_hidden(world: &World, eye: &Transform<Hall, Camera>, tag: &PlacedTag) -> usize {
    let [low_left, low_right, _, up_left] = tag.corners.map(|corner| corner.coords);
    let probes = (0..N_PROBES).map(|i| {
        let (right, up) = ((i % 9) as f64 / 8.0, (i / 9) as f64 / 8.0);
        low_left + (low_right - low_left) * right + (up_left - low_left) * up
    });
    probes.filter(|probe| is_behind(world, eye, probe)).count()
}

/// True if something stands between an eye and a place on a wall.
fn is_behind(world: &World, eye: &Transform<Hall, Camera>, place: &Vector3<f64>) -> bool {
    /// The place lies on the wall that the ray meets.
    const NEARLY_M: f64 = 0.02;
    let line = place - eye.origin.coords;
    let distance_m = line.norm();
    let hit = raycast::cast(
        world,
        &eye.origin,
        &Direction::from_coords(line / distance_m),
        distance_m + 1.0,
    );
    hit.is_none_or(|hit| hit.distance_m < distance_m - NEARLY_M)
}

/// True if a ray ends well before a tag this far away.
fn is_hidden(
    world: &World,
    eye: &Transform<Hall, Camera>,
    ray: &Vector2<f64>,
    distance_m: f64,
) -> bool {
    let in_camera = Vector3::new(ray.x, ray.y, 1.0).normalize();
    let direction = eye.rotation * Direction::from_coords(in_camera);
    let hit = raycast::cast(world, &eye.origin, &direction, 2.0 * distance_m + 1.0);
    // A slanted tag's places are nearer and farther than its middle by half its edge.
    hit.is_none_or(|hit| hit.distance_m < distance_m - 0.5)
}

/// Rays with offsets that are spread like a unit square convolved with a Gaussian, at instants that are
/// spread evenly; each has its opposite in all three.
fn samples(blur_sigma_px: f64) -> Vec<Sample> {
    /// Roberts' sequence in three dimensions: steps by powers of 1/1.220744, whose fourth power is one more.
    const STEPS: [f64; 3] =
        [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_4];
    let at = |axis: usize| -> Vec<f64> {
        (1..=N_SAMPLES / 2).map(|m| (0.5 + STEPS[axis] * m as f64).fract()).collect()
    };
    let offsets_px = [0, 1].map(|axis| {
        #[expect(clippy::cast_possible_truncation, reason = "a millionth of a pixel is enough")]
        let px = |share: f64| quantile(share, blur_sigma_px) as f32;
        even(&at(axis)).into_iter().map(px).collect::<Vec<f32>>()
    });
    let pairs = at(2).into_iter().enumerate().flat_map(|(m, share)| {
        let offset_px = [offsets_px[0][m], offsets_px[1][m]];
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 3")]
        let instant = (share * N_INSTANTS as f64) as usize;
        let opposite =
            Sample { offset_px: offset_px.map(|px| -px), instant: N_INSTANTS - 1 - instant };
        [Sample { offset_px, instant }, opposite]
    });
    pairs.collect()
}

/// Shares between 0 and 1, moved a little so that they and their opposites have equal steps.
fn even(shares: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..shares.len()).collect();
    order.sort_by(|a, b| (shares[*a] - 0.5).abs().total_cmp(&(shares[*b] - 0.5).abs()));
    let mut evened = shares.to_vec();
    for (rank, m) in order.into_iter().enumerate() {
        let from_middle = (rank as f64 + 0.5) / (2 * shares.len()) as f64;
        evened[m] = 0.5 + from_middle.copysign(shares[m] - 0.5);
    }
    evened
}

/// Where a unit square convolved with a Gaussian has this share of its weight on the left, px.
fn quantile(share: f64, sigma_px: f64) -> f64 {
    let (mut low, mut high) = (-0.5 - 5.0 * sigma_px, 0.5 + 5.0 * sigma_px);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if weight_left_of(middle, sigma_px) < share { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// ∫ Φ((x − s)/σ) over s from −½ to ½, by the midpoint rule.
fn weight_left_of(x: f64, sigma_px: f64) -> f64 {
    const N: u32 = 64;
    let phi = |z: f64| 1.0 / (1.0 + (-1.595_769 * z - 0.070_565 * z.powi(3)).exp());
    let part = |k: u32| {
        let s = (f64::from(k) + 0.5) / f64::from(N) - 0.5;
        if sigma_px > 0.0 { phi((x - s) / sigma_px) } else { f64::from(u8::from(x > s)) }
    };
    (0..N).map(part).sum::<f64>() / f64::from(N)
}

#[cfg(test)]
mod tests;
