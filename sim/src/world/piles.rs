//! Heaps of bulk material, three of them in bays of concrete.

use super::fractal::RidgedFractal;
use super::{Bay, Cuboid, HeightField, Region, WorldError};
use stockpilot::stats::{Noise, SeedBook};

const REGION: Region = Region::new(0.0, 0.0, 20.0, 20.0);
const PITCH_M: f64 = 0.1;
const WALL_HEIGHT_M: f64 = 2.0;
const WALL_THICKNESS_M: f64 = 0.3;
/// Middle lines of the walls between the bays, x, m.
const DIVIDERS_X_M: [f64; 4] = [0.55, 6.85, 13.15, 19.45];
/// Middle line of the wall at the back of all bays, y, m.
const BACK_Y_M: f64 = 19.45;
/// Where the dividers end and the bays are open, y, m.
const MOUTH_Y_M: f64 = 12.0;

/// A cone with a rounded top.
#[derive(Debug, Clone, Copy)]
struct Heap {
    x_m: f64,
    y_m: f64,
    peak_m: f64,
    /// tan of the angle of repose.
    slope: f64,
    /// Material stays inside: the bay, by the middle lines of its walls.
    within: Region,
}

impl Heap {
    /// Height of the smooth heap at (x, y), m.
    fn height_m(&self, x_m: f64, y_m: f64) -> f64 {
        if !self.within.contains(x_m, y_m) {
            return 0.0;
        }
        let away_m = (x_m - self.x_m).hypot(y_m - self.y_m);
        (self.peak_m - fall_m(self.slope, away_m)).max(0.0)
    }
}

/// How far a heap falls within `away_m` of its peak, m: a cone rounded to a hyperboloid.
fn fall_m(slope: f64, away_m: f64) -> f64 {
    const ROUNDING_M: f64 = 0.4;
    slope * (away_m.hypot(ROUNDING_M) - ROUNDING_M)
}

/// Three-sided bays, open towards low y; the walls touch but do not overlap.
pub(super) fn bay_walls() -> Vec<Cuboid> {
    let half_m = 0.5 * WALL_THICKNESS_M;
    let back_front_m = BACK_Y_M - half_m;
    let mut footprints: Vec<Region> = DIVIDERS_X_M
        .iter()
        .map(|x_m| Region::new(x_m - half_m, MOUTH_Y_M, x_m + half_m, back_front_m))
        .collect();
    let (first_m, last_m) = (DIVIDERS_X_M[0] - half_m, DIVIDERS_X_M[3] + half_m);
    footprints.push(Region::new(first_m, back_front_m, last_m, BACK_Y_M + half_m));
    footprints.iter().map(|footprint| Cuboid::over(footprint, 0.0, WALL_HEIGHT_M)).collect()
}

/// The bays between the walls, from left to right, and the open floor before them.
pub(super) fn bays() -> Vec<Bay> {
    let half_m = 0.5 * WALL_THICKNESS_M;
    let mut bays: Vec<Bay> = std::iter::zip(["bay 1", "bay 2", "bay 3"], DIVIDERS_X_M.windows(2))
        .map(|(name, walls)| {
            let (left_m, right_m) = (walls[0] + half_m, walls[1] - half_m);
            Bay::rectangle(name, &Region::new(left_m, MOUTH_Y_M, right_m, BACK_Y_M - half_m))
        })
        .collect();
    let floor = Region::new(REGION.x_min_m, REGION.y_min_m, REGION.x_max_m, MOUTH_Y_M);
    bays.push(Bay::rectangle("floor", &floor));
    bays
}

/// The heaps with slightly ridged flanks; `steepness` multiplies every slope.
pub(super) fn terrain(seeds: SeedBook, steepness: f64) -> Result<HeightField, WorldError> {
    const RIDGE_M: f64 = 0.08;
    if steepness <= 0.0 {
        return Err(WorldError::BadField);
    }
    let mut noise = seeds.stream("world.piles");
    let heaps: Vec<Heap> = heaps(&mut noise, steepness);
    let ridges = RidgedFractal::new(&mut noise, 4, 1.3 / steepness);
    HeightField::from_fn(&REGION, PITCH_M, |x_m, y_m| {
        let smooth_m = heaps.iter().map(|heap| heap.height_m(x_m, y_m)).fold(0.0, f64::max);
        // Ridges fade out at the toe, so the floor stays flat.
        smooth_m + RIDGE_M * (ridges.at(x_m, y_m) - 0.5) * (smooth_m / 0.3).min(1.0)
    })
}

/// Three heaps in the bays, and two to five in the open, the first two of which touch.
fn heaps(noise: &mut Noise, steepness: f64) -> Vec<Heap> {
    const OPEN_PLACES_M: [(f64, f64); 5] =
        [(3.8, 4.6), (7.6, 5.4), (13.6, 4.8), (17.0, 7.6), (11.2, 9.3)];
    let in_bays = DIVIDERS_X_M.windows(2).map(|walls| (walls[0], walls[1]));
    let mut heaps: Vec<Heap> = in_bays.map(|bay| bay_heap(bay, noise, steepness)).collect();
    let n_open = (2.0 + 4.0 * noise.uniform()).floor();
    let chosen = OPEN_PLACES_M.iter().enumerate().filter(|(i, _)| (*i as f64) < n_open);
    heaps.extend(chosen.map(|(_, place)| open_heap(*place, noise, steepness)));
    heaps
}

/// A heap against the back of a bay, below the top of the walls where it touches them.
fn bay_heap((left_m, right_m): (f64, f64), noise: &mut Noise, steepness: f64) -> Heap {
    let half_width_m = 0.5 * (right_m - left_m);
    let x_m = left_m + half_width_m + noise.between(-0.4, 0.4);
    let y_m = BACK_Y_M - half_width_m + noise.between(-0.5, 0.2);
    let slope = steepness * repose_slope(noise);
    let touch_m = noise.between(0.5, 1.4);
    let peak_m = (touch_m + fall_m(slope, half_width_m - 0.6)).min(3.6);
    Heap { x_m, y_m, peak_m, slope, within: Region::new(left_m, 0.0, right_m, BACK_Y_M) }
}

/// A heap on open floor, whole inside the region.
fn open_heap((x_m, y_m): (f64, f64), noise: &mut Noise, steepness: f64) -> Heap {
    let (x_m, y_m) = (x_m + noise.between(-0.3, 0.3), y_m + noise.between(-0.3, 0.3));
    let slope = steepness * repose_slope(noise);
    let room_m = (x_m - REGION.x_min_m)
        .min(REGION.x_max_m - x_m)
        .min(y_m - REGION.y_min_m)
        .min(MOUTH_Y_M - y_m)
        - 0.3;
    let peak_m = noise.between(1.5, 2.6).min(fall_m(slope, room_m));
    let within = Region::new(REGION.x_min_m, REGION.y_min_m, REGION.x_max_m, MOUTH_Y_M);
    Heap { x_m, y_m, peak_m, slope, within }
}

/// tan of an angle of repose between 32° and 38°.
fn repose_slope(noise: &mut Noise) -> f64 {
    noise.between(32.0, 38.0).to_radians().tan()
}
