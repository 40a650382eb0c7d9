//! A seeded mountain landscape.

use super::fractal::{GradientNoise, RidgedFractal};
use super::{HeightField, Region, WorldError};
use stockpilot::stats::SeedBook;

/// Nodes along each side, `PITCH_M` apart: 20 m.
const N_SIDE: usize = 251;
const PITCH_M: f64 = 0.08;
const REGION: Region = Region::new(0.0, 0.0, 20.0, 20.0);
/// Mean height over relief, so that valleys are as wide as crests.
const MEAN_RATIO: f64 = 0.47;
/// Slopes above this slide, tan of an angle: 55°.
const STEEPEST: f64 = 1.43;

/// Ridges, bent by a slow warp and worn by slides, from the floor up to the relief.
///
/// `steepness` narrows every wavelength and multiplies the slope above which material slides.
pub(super) fn terrain(seeds: SeedBook, steepness: f64) -> Result<HeightField, WorldError> {
    if steepness <= 0.0 {
        return Err(WorldError::BadField);
    }
    let mut noise = seeds.stream("world.alps");
    let relief_m = noise.between(3.3, 3.9);
    let ridges = RidgedFractal::new(&mut noise, 5, 10.0 / steepness);
    let warps = [GradientNoise::from_stream(&mut noise), GradientNoise::from_stream(&mut noise)];
    let raw = HeightField::from_fn(&REGION, PITCH_M, |x_m, y_m| {
        let (warp_m, per_m) = (1.6 / steepness, steepness / 5.0);
        let bend_m = |warp: &GradientNoise| warp_m * warp.at(x_m * per_m, y_m * per_m);
        ridges.at(x_m + bend_m(&warps[0]), y_m + bend_m(&warps[1])).max(0.0)
    })?;
    let mut heights_m = stretched(raw.heights_m());
    set_mean(&mut heights_m, MEAN_RATIO);
    heights_m.iter_mut().for_each(|h| *h *= relief_m);
    (0..30).for_each(|_| slide(&mut heights_m, STEEPEST * steepness));
    HeightField::new((REGION.x_min_m, REGION.y_min_m), PITCH_M, N_SIDE, heights_m)
}

/// The same shape from 0 to 1.
fn stretched(values: &[f64]) -> Vec<f64> {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    values.iter().map(|value| (value - low) / (high - low)).collect()
}

/// Bends values in 0 to 1 by a power so that their mean becomes `mean`.
fn set_mean(values: &mut [f64], mean: f64) {
    let mean_at =
        |power: f64| values.iter().map(|v| v.powf(power)).sum::<f64>() / values.len() as f64;
    let (mut low, mut high) = (0.1_f64, 6.0_f64);
    for _ in 0..30 {
        let middle = f64::midpoint(low, high);
        // A larger power lowers the mean.
        if mean_at(middle) > mean { low = middle } else { high = middle }
    }
    values.iter_mut().for_each(|v| *v = v.powf(low));
}

/// One pass of thermal erosion: where a slope is too steep, a part of it moves downhill.
///
/// Source: Musgrave, Kolb, Mace 1989, §3.
fn slide(heights_m: &mut [f64], steepest: f64) {
    for node in 0..heights_m.len() {
        let (col, row) = (node % N_SIDE, node / N_SIDE);
        if col + 1 < N_SIDE {
            settle(heights_m, (node, node + 1), steepest);
        }
        if row + 1 < N_SIDE {
            settle(heights_m, (node, node + N_SIDE), steepest);
        }
    }
}

fn settle(heights_m: &mut [f64], (a, b): (usize, usize), steepest: f64) {
    let drop_m = heights_m[a] - heights_m[b];
    let excess_m = (drop_m.abs() - steepest * PITCH_M).max(0.0);
    let moved_m = 0.25 * excess_m.copysign(drop_m);
    heights_m[a] -= moved_m;
    heights_m[b] += moved_m;
}
