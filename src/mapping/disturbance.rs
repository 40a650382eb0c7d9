//! What moved through the hall while it was measured: a wheel loader, a person, a door.
//!
//! Material stands still during a flight, so a cell whose hits contradict each other *over time*
//! saw something else. One contradiction says nothing (dust, an edge); many neighbouring cells that
//! contradict at the same time by the same height were covered by one thing.
//!
//! ```text
//! height ▲   cell's hits, turn by turn
//!        │        xxxx         x  a thing on the ground, left out
//!        │  ooo        oo      o  ground
//!        └───────────────────▶ turn
//! ```
//!
//! The rules, for each cell:
//!
//! 1. Hits within `max(6σ, 1.5 cells) + 2 σ_t · distance` of each other are one *level*. The lowest is
//!    the ground, for what comes or goes stands on it: the lowest of those that at least half as many
//!    turns saw as any other, so that a few wrong poses do not dig holes.
//! 2. A higher level is *foreign* if no turn saw it together with the ground, and at least
//!    twelve neighbours (cells within two cells, or 0.5 m) have such a level within 2 s and two cells, or
//!    0.5 m, of height. So are, within 1 m and 2 s of it, higher levels at its rim, and equally high ones over ground that no
//!    turn saw.
//! 3. Foreign hits are no data, and do not move the surface: the ground keeps what was measured of
//!    it before or after.
//! 4. The cell *recovers* as soon as its ground is seen again after the last foreign hit. Until then
//!    it is *frozen* and flagged: its ground may have changed since, and it counts as disturbed, not
//!    as measured. A cell without any ground is flagged too.
//!
//! 5. A hit far from its cell's ground, or alone in it, that no ground around confirms, is a *stray*
//!    one (dust, a mixed pixel) and left out from the start: two hits and one from far above have a
//!    mean that refuses all three.
//!
//! A map that is shifted down for a while, by a wrong pose, counts as ground too: nothing here knows
//! better. Material that is added in flight is thus left out and flagged; material that is taken away counts
//! as it is at the end. What stands still for most of the flight cannot be told from material: that is
//! what exclusions are for.
//!
//! Checked: `tests`, with a machine of known heights and times.

use super::footprint::{Footprint, Patch};
use super::matern_field::Lattice;
use crate::messages::{DisturbedArea, GridGeometry};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Two hits of one level differ by less than this many σ …
const GATE_SIGMAS: f64 = 6.0;
/// … or this many cells, for the ground is not level within one.
const GATE_CELLS: f64 = 1.5;
/// Slopes up to this many `σ_t` are expected between two hits of a cell.
const SLOPE_SIGMAS: f64 = 2.0;
/// Contradictions belong together within this time, s, …
const TOGETHER_S: f64 = 2.0;
/// … and this difference of height, in cells, or at least in m.
const TOGETHER_CELLS: f64 = 2.0;
const TOGETHER_M: f64 = 0.5;
/// Neighbours are looked for this far, in cells, or at least in m: beams and turns are that far apart
/// whatever the cells, …
const NEIGHBOUR_CELLS: f64 = 2.0;
const NEIGHBOUR_M: f64 = 0.5;
/// … and so many must agree: a thing is broad, a ridge that only some turns look over is a line.
const LEAST_NEIGHBOURS: usize = 12;
/// The rim of a thing reaches this far from where it was recognised, m.
const RIM_M: f64 = 1.0;
/// Of a level's turns so many may have seen the ground too: those when a thing came or left.
const MIXED_RATIO: f64 = 0.25;
/// The ground has at least this share of the turns of the level that most turns saw.
const GROUND_RATIO: f64 = 0.5;
/// Turns farther apart, or against time, belong to different flights.
const FLIGHT_GAP_S: f64 = 60.0;
/// More levels than this a cell does not get; later hits are left to the gates of the solve.
const MOST_LEVELS: usize = 6;
/// A hit that fewer of its neighbours confirm is a stray one.
const LEAST_CONFIRMED: usize = 2;

/// The turns of a map without what moved through them.
#[derive(Debug, Clone)]
pub struct Undisturbed {
    /// The turns; those that saw something foreign are without its hits.
    pub footprints: Vec<Arc<Footprint>>,
    /// Cells that are frozen or have no ground.
    pub flagged: Flagged,
    /// Beams that hit something foreign, and stray ones.
    pub n_beams_left_out: u64,
}

/// Cells whose newest hits contradict what was known of their ground.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Flagged {
    /// By cell: how many turns have contradicted since the ground was last seen.
    cells: BTreeMap<usize, u32>,
}

/// The levels of all cells, kept turn by turn.
#[derive(Debug, Clone, PartialEq)]
pub struct Levels {
    grid: GridGeometry,
    nugget_m: f64,
    slope_sigma: f64,
    /// The first level of each cell; without beams where there is none.
    first: Vec<Level>,
    /// The second and later levels of the few cells that have them.
    more: BTreeMap<usize, Vec<Level>>,
    n_turns: u32,
    /// Time of the newest turn since the first, with a pause between flights, s, …
    now_s: f64,
    /// … and by its own clock.
    previous_s: Option<f64>,
}

/// Hits of one cell at about one height. Single precision holds a millimetre of height and of hours.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Level {
    height_m: f32,
    place_m: [f32; 2],
    n_beams: f32,
    first_s: f32,
    last_s: f32,
    n_turns: u32,
    last_turn: u32,
    /// Turns that saw a lower level of the cell too.
    n_mixed: u32,
}

type LevelKey = (usize, usize);

/// A level that may be of a thing.
#[derive(Debug, Clone, Copy)]
struct Span {
    height_m: f64,
    first_s: f64,
    last_s: f64,
}

impl Flagged {
    /// True if the cell is frozen, or has no ground at all.
    #[must_use]
    pub fn contains(&self, cell: usize) -> bool {
        self.cells.contains_key(&cell)
    }

    /// The cells in their order.
    pub fn cells(&self) -> impl Iterator<Item = usize> {
        self.cells.keys().copied()
    }

    /// How many turns have contradicted the cell's ground since it was last seen.
    #[must_use]
    pub fn n_conflicts(&self, cell: usize) -> u32 {
        self.cells.get(&cell).copied().unwrap_or(0)
    }

    /// Cells that touch, also by a corner, as areas; the largest first.
    #[must_use]
    pub fn areas(&self, grid: &GridGeometry) -> Vec<DisturbedArea> {
        let mut left: BTreeSet<usize> = self.cells().collect();
        let mut areas = Vec::new();
        while let Some(first) = left.pop_first() {
            let (mut open, mut n, mut sum_m) = (vec![first], 0.0, [0.0; 2]);
            while let Some(cell) = open.pop() {
                let (x, y) = grid.centre_m(cell);
                n += 1.0;
                sum_m = [sum_m[0] + x, sum_m[1] + y];
                open.extend(around(grid, cell, 1).filter(|next| left.remove(next)));
            }
            let centre_m = sum_m.map(|sum| sum / n);
            areas.push(DisturbedArea { area_m2: n * grid.cell_area_m2(), centre_m });
        }
        areas.sort_by(|a, b| b.area_m2.total_cmp(&a.area_m2));
        areas
    }
}

/// The cells within `reach` columns and rows of a cell, without itself.
fn around(grid: &GridGeometry, cell: usize, reach: usize) -> impl Iterator<Item = usize> {
    let (col, row, n_cols) = (cell % grid.n_cols, cell / grid.n_cols, grid.n_cols);
    let rows = row.saturating_sub(reach)..(row + reach + 1).min(grid.n_rows);
    let cols = col.saturating_sub(reach)..(col + reach + 1).min(grid.n_cols);
    rows.flat_map(move |row| cols.clone().map(move |col| row * n_cols + col))
        .filter(move |other| *other != cell)
}

impl Levels {
    /// No turn yet. `nugget_m` is the roughness below the cell size, m, `slope_sigma` the standard
    /// deviation `σ_t` of the slope.
    #[must_use]
    pub fn new(grid: &GridGeometry, nugget_m: f64, slope_sigma: f64) -> Self {
        Self {
            grid: *grid,
            nugget_m,
            slope_sigma,
            first: vec![Level::default(); grid.n_cells()],
            more: BTreeMap::new(),
            n_turns: 0,
            now_s: 0.0,
            previous_s: None,
        }
    }

    /// Takes in the next turn, flight by flight in the order of time, and notes the level of each of
    /// its patches in it. Walls in the lattice separate.
    pub fn take(&mut self, lattice: &Lattice, turn: &mut Footprint) {
        let at_s = turn.error.at.seconds();
        let since_s = self.previous_s.map_or(0.0, |previous_s| at_s - previous_s);
        self.previous_s = Some(at_s);
        let is_same_flight = (0.0..=FLIGHT_GAP_S).contains(&since_s);
        self.now_s += if is_same_flight { since_s } else { FLIGHT_GAP_S };
        self.n_turns += 1;
        let cov = &turn.error.cov;
        let flat_var_m2 = self.nugget_m.powi(2)
            + cov[(2, 2)]
            + self.slope_sigma.powi(2) * (cov[(0, 0)] + cov[(1, 1)]);
        let attitude_var = cov[(3, 3)] + cov[(4, 4)] + cov[(5, 5)];
        let mut mixable = BTreeSet::new();
        for patch in &mut turn.patches {
            patch.level = Patch::NO_LEVEL;
            let Some(cell) = cell_of(lattice, patch) else { continue };
            let var_m2 = flat_var_m2 + attitude_var * patch.arm().norm_squared();
            // Two hits, each with this variance.
            let least_m =
                (GATE_SIGMAS * (2.0 * var_m2).max(0.0).sqrt()).max(GATE_CELLS * self.grid.cell_m);
            let Some(level) = self.sort(cell, patch, least_m) else { continue };
            patch.level = level;
            if self.more.contains_key(&cell) {
                mixable.insert((cell, usize::from(level)));
            }
        }
        self.note_mixed(&mixable);
    }

    /// Leaves out what moved through these turns, which are those that were taken in.
    #[must_use]
    pub fn judge(&self, footprints: &[Arc<Footprint>]) -> Undisturbed {
        let foreign = self.foreign();
        let flagged = self.flagged(&foreign);
        let left_out: BTreeSet<LevelKey> = foreign.into_iter().chain(self.strays()).collect();
        let mut is_affected = vec![false; self.grid.n_cells()];
        left_out.iter().for_each(|(cell, _)| is_affected[*cell] = true);
        let is_left_out = |patch: &&Patch| {
            let place = patch.place();
            patch.level != Patch::NO_LEVEL
                && self.grid.cell_at(place.x, place.y).is_some_and(|cell| {
                    is_affected[cell] && left_out.contains(&(cell, usize::from(patch.level)))
                })
        };
        let mut n_beams_left_out = 0;
        let mut without = |footprint: &Arc<Footprint>| {
            let (out, kept): (Vec<&Patch>, Vec<&Patch>) =
                footprint.patches.iter().partition(is_left_out);
            if out.is_empty() {
                return Arc::clone(footprint);
            }
            n_beams_left_out += out.iter().map(|patch| u64::from(patch.n_beams)).sum::<u64>();
            Arc::new(Footprint {
                error: footprint.error.clone(),
                hall_from_body: footprint.hall_from_body,
                lidar_idx: footprint.lidar_idx,
                patches: kept.into_iter().copied().collect(),
                passed_to_m: footprint.passed_to_m.clone(),
                silent: footprint.silent.clone(),
            })
        };
        let footprints = footprints.iter().map(&mut without).collect();
        Undisturbed { footprints, flagged, n_beams_left_out }
    }

    fn levels(&self, cell: usize) -> impl Iterator<Item = (usize, &Level)> {
        let first = Some(&self.first[cell]).filter(|level| level.n_beams > 0.0);
        first.into_iter().chain(self.more.get(&cell).into_iter().flatten()).enumerate()
    }

    fn level_mut(&mut self, (cell, level): LevelKey) -> Option<&mut Level> {
        match level.checked_sub(1) {
            None => self.first.get_mut(cell),
            Some(later) => self.more.get_mut(&cell)?.get_mut(later),
        }
    }

    /// Puts a patch into the level of its cell that it fits best, or into a new one; which.
    #[expect(clippy::cast_possible_truncation, reason = "at most six levels")]
    fn sort(&mut self, cell: usize, patch: &Patch, least_m: f64) -> Option<u8> {
        let [x, y, z] = patch.place_m;
        let off_m = |level: &Level| f64::from((level.height_m - z).abs());
        let slope = SLOPE_SIGMAS * self.slope_sigma;
        let fits = |level: &Level| {
            let way_m = f64::from((level.place_m[0] - x).hypot(level.place_m[1] - y));
            off_m(level) <= least_m + slope * way_m
        };
        let best = self
            .levels(cell)
            .filter(|(_, level)| fits(level))
            .min_by(|(_, a), (_, b)| off_m(a).total_cmp(&off_m(b)))
            .map(|(index, _)| index);
        let (turn, now_s) = (self.n_turns, self.now_s as f32);
        if let Some(index) = best {
            self.level_mut((cell, index))?.add(patch, turn, now_s);
            return Some(index as u8);
        }
        let index = self.levels(cell).count();
        let mut fresh = Level { first_s: now_s, ..Level::default() };
        fresh.add(patch, turn, now_s);
        match index {
            0 => self.first[cell] = fresh,
            MOST_LEVELS.. => return None,
            _ => self.more.entry(cell).or_default().push(fresh),
        }
        Some(index as u8)
    }

    /// Counts, among what one turn saw of cells with several levels, those over a lower one.
    fn note_mixed(&mut self, seen: &BTreeSet<LevelKey>) {
        for &(cell, level) in seen {
            let height_m = |level: usize| {
                self.levels(cell).nth(level).map_or(f32::INFINITY, |(_, level)| level.height_m)
            };
            let own_m = height_m(level);
            let of_cell = (cell, 0)..=(cell, MOST_LEVELS);
            let is_mixed = seen.range(of_cell).any(|(_, other)| height_m(*other) < own_m);
            if is_mixed && let Some(level) = self.level_mut((cell, level)) {
                level.n_mixed += 1;
            }
        }
    }

    /// The lowest level of a cell among those that many turns saw.
    fn ground(&self, cell: usize, is_foreign: impl Fn(usize) -> bool) -> Option<(usize, &Level)> {
        let levels = || self.levels(cell).filter(|(index, _)| !is_foreign(*index));
        let most = levels().map(|(_, level)| level.n_turns).max()?;
        levels()
            .filter(|(_, level)| f64::from(level.n_turns) >= GROUND_RATIO * f64::from(most))
            .min_by(|(_, a), (_, b)| a.height_m.total_cmp(&b.height_m))
    }

    /// Height of the cell's ground, m; infinite without one.
    fn ground_m(&self, cell: usize) -> f32 {
        self.ground(cell, |_| false).map_or(f32::INFINITY, |(_, level)| level.height_m)
    }

    /// The levels that are of things.
    fn foreign(&self) -> BTreeSet<LevelKey> {
        let recognised = self.recognised();
        let mut foreign: BTreeSet<LevelKey> = recognised.iter().map(|(key, _)| *key).collect();
        let mut at_rim: BTreeMap<usize, Vec<Span>> = BTreeMap::new();
        for ((cell, _), span) in recognised {
            for neighbour in around(&self.grid, cell, self.rim_cells()) {
                at_rim.entry(neighbour).or_default().push(span);
            }
        }
        for (cell, things) in &at_rim {
            foreign.extend(self.at_rim(*cell, things).map(|level| (*cell, level)));
        }
        foreign
    }

    /// Levels that many neighbours have at the same time.
    fn recognised(&self) -> Vec<(LevelKey, Span)> {
        let candidates = self.candidates();
        let together_m = self.together_m();
        let agrees = |cell: usize, span: &Span| {
            let others = candidates.get(&cell).into_iter().flatten();
            others.map(|(_, other)| other).any(|other| {
                other.is_near(span) && (other.height_m - span.height_m).abs() <= together_m
            })
        };
        let is_recognised = |cell: usize, span: &Span| {
            let cells = around(&self.grid, cell, self.neighbour_cells());
            let agreeing = cells.filter(|neighbour| agrees(*neighbour, span));
            agreeing.take(LEAST_NEIGHBOURS).count() == LEAST_NEIGHBOURS
        };
        let of_cell = |(cell, levels): (&usize, &Vec<(usize, Span)>)| {
            let found = levels.iter().filter(|(_, span)| is_recognised(*cell, span));
            found.map(|(level, span)| ((*cell, *level), *span)).collect::<Vec<_>>()
        };
        candidates.iter().flat_map(of_cell).collect()
    }

    fn together_m(&self) -> f64 {
        (TOGETHER_CELLS * self.grid.cell_m).max(TOGETHER_M)
    }

    fn rim_cells(&self) -> usize {
        self.whole_cells(RIM_M)
    }

    fn neighbour_cells(&self) -> usize {
        self.whole_cells((NEIGHBOUR_CELLS * self.grid.cell_m).max(NEIGHBOUR_M))
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a few cells, and positive"
    )]
    fn whole_cells(&self, way_m: f64) -> usize {
        (way_m / self.grid.cell_m - 1e-9).ceil() as usize
    }

    /// The levels of a cell that were seen only while recognised things were near.
    fn at_rim(&self, cell: usize, things: &[Span]) -> impl Iterator<Item = usize> {
        let together_m = self.together_m();
        let (ground, ground_m) =
            (self.ground(cell, |_| false).map(|(index, _)| index), self.ground_m(cell));
        let all = things.iter().copied().reduce(|a, b| Span {
            first_s: a.first_s.min(b.first_s),
            last_s: a.last_s.max(b.last_s),
            ..a
        });
        self.levels(cell).filter_map(move |(index, level)| {
            let span = level.span();
            let is_thing = if level.height_m <= ground_m {
                Some(index) == ground
                    && things.iter().any(|thing| {
                        span.is_within(thing)
                            && (span.height_m - thing.height_m).abs() <= together_m
                    })
            } else {
                all.is_some_and(|all| span.is_within(&all))
            };
            is_thing.then_some(index)
        })
    }

    /// Levels off the ground, or of a single turn, that hardly a ground around confirms.
    fn strays(&self) -> BTreeSet<LevelKey> {
        let (least_m, slope) = (self.together_m(), SLOPE_SIGMAS * self.slope_sigma);
        let confirms = |neighbour: usize, level: &Level| {
            self.ground(neighbour, |_| false).is_some_and(|(_, other)| {
                let [dx, dy] = [0, 1].map(|k| level.place_m[k] - other.place_m[k]);
                let off_m = f64::from((level.height_m - other.height_m).abs());
                off_m <= least_m + slope * f64::from(dx.hypot(dy))
            })
        };
        let is_confirmed = |cell: usize, level: &Level| {
            let cells = around(&self.grid, cell, self.neighbour_cells());
            let confirming = cells.filter(|neighbour| confirms(*neighbour, level));
            confirming.take(LEAST_CONFIRMED).count() == LEAST_CONFIRMED
        };
        let mut strays = BTreeSet::new();
        for cell in 0..self.grid.n_cells() {
            let ground = self.ground(cell, |_| false).map(|(index, _)| index);
            for (index, level) in self.levels(cell) {
                let is_doubtful = Some(index) != ground || level.n_turns == 1;
                if is_doubtful && !is_confirmed(cell, level) {
                    strays.insert((cell, index));
                }
            }
        }
        strays
    }

    /// Levels over a ground that no turn saw together with it, by cell.
    fn candidates(&self) -> BTreeMap<usize, Vec<(usize, Span)>> {
        let of_cell = |cell: usize| {
            let ground_m = self.ground_m(cell);
            self.levels(cell)
                .filter(|(_, level)| level.height_m > ground_m && level.is_clean())
                .map(|(index, level)| (index, level.span()))
                .collect::<Vec<_>>()
        };
        self.more.keys().map(|cell| (*cell, of_cell(*cell))).collect()
    }

    /// Cells whose ground was not seen after the last foreign hit.
    fn flagged(&self, foreign: &BTreeSet<LevelKey>) -> Flagged {
        let mut cells = BTreeMap::new();
        for &(cell, _) in foreign {
            let is_foreign = |level: usize| foreign.contains(&(cell, level));
            let ground = self.ground(cell, is_foreign);
            let since = ground.map(|(_, level)| level.last_turn);
            let later = self.levels(cell).filter(|(index, level)| {
                is_foreign(*index) && since.is_none_or(|since| level.last_turn > since)
            });
            let n_conflicts = later.map(|(_, level)| level.n_turns).sum();
            if n_conflicts > 0 {
                cells.insert(cell, n_conflicts);
            }
        }
        Flagged { cells }
    }
}

/// The cell that a patch says something of; none behind a wall from the cell's own node.
fn cell_of(lattice: &Lattice, patch: &Patch) -> Option<usize> {
    let place = patch.place();
    let cell = lattice.grid().cell_at(place.x, place.y)?;
    let row = lattice.row_at(place.x, place.y)?;
    let node = lattice.node_of_cell(cell);
    let sees = |(of_row, weight): (u32, f64)| of_row as usize == node && weight > 0.0;
    std::iter::zip(row.nodes, row.weights).any(sees).then_some(cell)
}

impl Level {
    fn add(&mut self, patch: &Patch, turn: u32, now_s: f32) {
        let [x, y, z] = patch.place_m;
        let n = f32::from(patch.n_beams);
        let share = n / (self.n_beams + n);
        self.height_m += share * (z - self.height_m);
        self.place_m[0] += share * (x - self.place_m[0]);
        self.place_m[1] += share * (y - self.place_m[1]);
        self.n_beams += n;
        self.last_s = now_s;
        self.n_turns += u32::from(self.last_turn != turn);
        self.last_turn = turn;
    }

    fn is_clean(&self) -> bool {
        f64::from(self.n_mixed) <= MIXED_RATIO * f64::from(self.n_turns)
    }

    fn span(&self) -> Span {
        Span {
            height_m: self.height_m.into(),
            first_s: self.first_s.into(),
            last_s: self.last_s.into(),
        }
    }
}

impl Span {
    fn is_near(&self, other: &Self) -> bool {
        self.first_s <= other.last_s + TOGETHER_S && other.first_s <= self.last_s + TOGETHER_S
    }

    fn is_within(&self, other: &Self) -> bool {
        self.first_s >= other.first_s - TOGETHER_S && self.last_s <= other.last_s + TOGETHER_S
    }
}

#[cfg(test)]
mod tests;
