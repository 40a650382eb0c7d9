//! A machine of known heights and times over ground of a known shape.

use super::*;
use crate::geometry::{Point, Rotation, Transform};
use crate::messages::PoseError;
use crate::stats::SeedBook;
use crate::time::Stamp;
use nalgebra::{SMatrix, Vector3};
use std::time::Duration;

/// A box on the floor.
#[derive(Clone, Copy)]
struct Thing {
    x_m: (f64, f64),
    y_m: (f64, f64),
    height_m: f64,
}

const LOADER: Thing = Thing { x_m: (3.0, 6.0), y_m: (2.0, 4.0), height_m: 1.6 };

impl Thing {
    fn covers(&self, x: f64, y: f64) -> bool {
        (self.x_m.0..self.x_m.1).contains(&x) && (self.y_m.0..self.y_m.1).contains(&y)
    }

    fn area_m2(&self) -> f64 {
        (self.x_m.1 - self.x_m.0) * (self.y_m.1 - self.y_m.0)
    }
}

/// A slanted floor with a hump.
fn ground_m(x: f64, y: f64) -> f64 {
    0.3 + 0.05 * x + 0.6 * (-(x - 7.0).hypot(y - 5.0).powi(2) / 2.0).exp()
}

fn lattice() -> Lattice {
    let grid = GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 0.25, n_cols: 40, n_rows: 28 };
    Lattice::covering(&grid, 1.0, |_, _| false)
}

/// One leg over the whole ground, turn by turn of 0.2 m, 0.1 s each, beginning at `start_s`;
/// `height_m` is what stands there.
#[expect(clippy::cast_possible_truncation, reason = "single precision on purpose")]
fn leg(start_s: f64, height_m: impl Fn(f64, f64) -> f64) -> Vec<Arc<Footprint>> {
    let turn = |k: u32| {
        let at = Stamp::ZERO.plus(Duration::from_secs_f64(start_s + 0.1 * f64::from(k)));
        let x = 0.1 + 0.2 * f64::from(k);
        let patches = (0..68_u32).map(|j| {
            let y = 0.06 + 0.1 * f64::from(j);
            let place_m = [x, y, height_m(x, y)].map(|c| c as f32);
            Patch {
                place_m,
                arm_m: [0.0, (y - 3.5) as f32, place_m[2] - 7.0],
                n_beams: 1,
                level: Patch::NO_LEVEL,
            }
        });
        let error = PoseError {
            at,
            cov: SMatrix::identity() * 1e-5,
            from_previous: SMatrix::zeros(),
            velocity_mps: Vector3::zeros(),
            rate_radps: Vector3::zeros(),
            tags: Vec::new(),
        };
        let hall_from_body = Transform::new(Rotation::identity(), Point::new(x, 3.5, 7.0));
        Arc::new(Footprint {
            error,
            hall_from_body,
            lidar_idx: 0,
            patches: patches.collect(),
            passed_to_m: Vec::new(),
            silent: Vec::new(),
        })
    };
    (0..50).map(turn).collect()
}

fn calm(start_s: f64) -> Vec<Arc<Footprint>> {
    leg(start_s, ground_m)
}

fn with(thing: Thing, start_s: f64) -> Vec<Arc<Footprint>> {
    leg(start_s, move |x, y| if thing.covers(x, y) { thing.height_m } else { ground_m(x, y) })
}

fn judged(legs: &[Vec<Arc<Footprint>>]) -> Undisturbed {
    let lattice = lattice();
    let mut levels = Levels::new(lattice.grid(), 0.02, 0.6);
    let take = |turn: &Arc<Footprint>| {
        let mut turn = Footprint::clone(turn);
        levels.take(&lattice, &mut turn);
        Arc::new(turn)
    };
    let turns: Vec<_> = legs.iter().flatten().map(take).collect();
    levels.judge(&turns)
}

/// Beams that hit the thing and are still there, and beams that hit the ground and are not.
fn mistakes(judged: &Undisturbed, legs: &[Vec<Arc<Footprint>>]) -> (usize, usize) {
    let is_ground = |patch: &&Patch| {
        let p = patch.place();
        (p.z - ground_m(p.x, p.y)).abs() < 1e-3
    };
    let all = |turns: &[Arc<Footprint>]| -> (usize, usize) {
        let patches = || turns.iter().flat_map(|turn| &turn.patches);
        (patches().count(), patches().filter(is_ground).count())
    };
    let (n_before, n_ground_before) = all(&legs.concat());
    let (n_after, n_ground_after) = all(&judged.footprints);
    assert!(n_before >= n_after);
    (n_after - n_ground_after, n_ground_before - n_ground_after)
}

#[test]
fn undisturbed_ground_loses_nothing() {
    let legs = [calm(0.0), calm(20.0), calm(40.0)];
    let judged = judged(&legs);
    assert_eq!(mistakes(&judged, &legs), (0, 0));
    assert_eq!((judged.flagged.cells().count(), judged.n_beams_left_out), (0, 0));
}

#[test]
fn a_machine_that_came_and_went_leaves_no_trace() {
    for order in 0..3 {
        let legs: Vec<_> = (0..3_u32)
            .map(|k| {
                let start_s = 20.0 * f64::from(k);
                if k == order { with(LOADER, start_s) } else { calm(start_s) }
            })
            .collect();
        let judged = judged(&legs);
        let (n_machine, n_ground) = mistakes(&judged, &legs);
        assert_eq!((n_machine, n_ground), (0, 0), "machine in leg {order}");
        // In the last leg the ground is not seen again.
        let is_last = order == 2;
        assert_eq!(judged.flagged.cells().count() > 0, is_last, "machine in leg {order}");
        let n_left_out = judged.n_beams_left_out;
        assert!(n_left_out > 280 && n_left_out < 320, "{n_left_out} of 15 × 20 beams");
    }
}

#[test]
fn what_is_covered_last_is_frozen_and_flagged_until_the_ground_is_seen_again() {
    let mut legs = vec![calm(0.0), with(LOADER, 20.0)];
    let frozen = judged(&legs);
    let areas = frozen.flagged.areas(lattice().grid());
    assert_eq!(areas.len(), 1, "{areas:?}");
    let flagged_m2 = areas[0].area_m2;
    // Cells on the border may be flagged or not: half a cell on 10 m of it.
    assert!((flagged_m2 - LOADER.area_m2()).abs() < 1.3, "{areas:?}");
    assert!((areas[0].centre_m[0] - 4.5).abs() < 0.15 && (areas[0].centre_m[1] - 3.0).abs() < 0.15);
    let middle = lattice().grid().cell_at(4.5, 3.0).expect("a cell");
    assert!((1..=2).contains(&frozen.flagged.n_conflicts(middle)));

    // It stays: still nothing is believed of it, and the conflicts are counted.
    legs.push(with(LOADER, 40.0));
    let stays = judged(&legs);
    assert_eq!(mistakes(&stays, &legs), (0, 0));
    assert!(stays.flagged.n_conflicts(middle) > frozen.flagged.n_conflicts(middle));

    // It has gone: every cell recovers.
    legs.push(calm(60.0));
    let gone = judged(&legs);
    assert_eq!(mistakes(&gone, &legs), (0, 0));
    assert_eq!(gone.flagged.cells().count(), 0);
}

#[test]
fn a_machine_that_drives_is_left_out_wherever_it_stands() {
    // It drives in y while the legs run in x; every leg meets it at another place.
    let at = |k: u32| Thing { y_m: (0.3 + f64::from(k), 2.3 + f64::from(k)), ..LOADER };
    let legs: Vec<_> = (0..5_u32).map(|k| with(at(k), 8.0 * f64::from(k))).collect();
    let judged = judged(&legs);
    let (n_machine, n_ground) = mistakes(&judged, &legs);
    assert_eq!(n_ground, 0);
    assert_eq!(n_machine, 0);
    // Only where it stood in the last leg.
    let areas = judged.flagged.areas(lattice().grid());
    assert_eq!(areas.len(), 1);
    assert!((areas[0].centre_m[1] - 5.3).abs() < 0.2, "{areas:?}");
}

#[test]
fn ground_that_only_the_machine_s_leg_saw_is_flagged_and_has_no_data() {
    // The first leg sees all but a strip under the machine.
    let mut first = calm(0.0);
    for turn in &mut first {
        let mut seen = Footprint::clone(turn);
        seen.patches.retain(|patch| !(4.0..4.5).contains(&patch.place().x));
        *turn = Arc::new(seen);
    }
    let legs = [first, with(LOADER, 20.0), calm(40.0)];
    let strip = lattice().grid().cell_at(4.3, 3.0).expect("a cell");
    let before = judged(&legs[..2]);
    assert!(before.flagged.contains(strip));
    assert_eq!(mistakes(&before, &legs[..2]).0, 0, "nothing of the machine is left");
    assert!(!judged(&legs).flagged.contains(strip));
}

#[test]
fn dust_is_left_out_and_flags_nothing() {
    let mut noise = SeedBook::new(3).stream("dust");
    let mut legs = vec![calm(0.0), calm(20.0), calm(40.0)];
    let mut n_dust = 0;
    for turn in legs.iter_mut().flatten() {
        let mut dusty = Footprint::clone(turn);
        for patch in &mut dusty.patches {
            if noise.uniform() < 0.01 {
                #[expect(clippy::cast_possible_truncation, reason = "single precision on purpose")]
                let height_m = noise.between(2.0, 4.5) as f32;
                patch.place_m[2] = height_m;
                n_dust += 1;
            }
        }
        *turn = Arc::new(dusty);
    }
    let judged = judged(&legs);
    let (n_left, n_ground) = mistakes(&judged, &legs);
    assert_eq!(judged.flagged.cells().count(), 0);
    assert_eq!(n_ground, 0);
    // Those just over the hump may be of its flank; the gate of the solve is narrower.
    assert!(n_dust > 80 && n_left * 20 < n_dust, "{n_left} of {n_dust}");
}

#[test]
fn a_step_that_stands_still_is_ground() {
    // A concrete block, never excluded: both its top and the floor are seen in every leg.
    let block = Thing { height_m: 2.5, ..LOADER };
    let legs: Vec<_> = (0..4_u32).map(|k| with(block, 20.0 * f64::from(k))).collect();
    let judged = judged(&legs);
    assert_eq!((judged.n_beams_left_out, judged.flagged.cells().count()), (0, 0));
}

#[test]
fn material_taken_away_counts_as_it_is_and_material_added_is_flagged() {
    let heap = Thing { height_m: 1.4, ..LOADER };
    let taken = judged(&[with(heap, 0.0), calm(20.0)]);
    assert_eq!(taken.flagged.cells().count(), 0);
    assert_eq!(mistakes(&taken, &[with(heap, 0.0), calm(20.0)]), (0, 0));
    let added = judged(&[calm(0.0), with(heap, 20.0)]);
    assert!(added.flagged.cells().count() > 80);
}
