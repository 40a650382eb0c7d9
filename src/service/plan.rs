//! The free space before a flight: pictures of it, and where one more marker would open most.

use crate::config::{Config, ConfigError};
use crate::figure::{Figure, FigureError, HeatMap, Ink, Lattice, Overlay, Shape, Sheet};
use crate::geometry::{Hall, Point};
use crate::mapping::polygon::Polygon;
use crate::mapping::solid::Solid;
use crate::planning::free_space::FreeSpace;
use crate::planning::grid_axis::Axis;
use crate::planning::what_if::{Gain, Layout, WhatIf, candidates, distinct, rank};
use crate::planning::{Settings, Waypoint};
use serde::Serialize;
use std::path::Path;

/// The free space cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The configuration is refused.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A picture cannot be made or written.
    #[error(transparent)]
    Figure(#[from] FigureError),
    /// There is nothing to hang a marker on.
    #[error("hall.walls_m is not given: there is no wall to hang a marker on")]
    NoWalls,
}

/// The free space of a configuration, wholly evaluated.
#[derive(Debug)]
pub struct Plan {
    settings: Settings,
    space: FreeSpace,
}

/// How much is free.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Extent {
    /// Area that is free at the height and heading of the survey, m².
    pub survey_area_m2: f64,
    /// Area that is clear of everything at the height of the survey, m².
    pub survey_clear_area_m2: f64,
    /// Nodes of the grid that are free.
    pub n_free_nodes: usize,
    /// Nodes of the grid that are clear of everything.
    pub n_clear_nodes: usize,
    /// Nodes of the grid: places, heights and headings.
    pub n_nodes: usize,
}

/// Where one more marker might hang, and what it would open.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Suggestion {
    /// Its middle in the hall, m.
    pub place_m: [f64; 3],
    /// Where its front looks, from x towards y, deg.
    pub facing_deg: f64,
    /// Its corners as a `[[tags]]` section has them, m.
    pub corners_m: [[f64; 3]; 4],
    /// Area that becomes free at the height and heading of the survey, m².
    pub gain_m2: f64,
    /// Nodes of the grid that become free, at all heights and headings.
    pub gain_nodes: usize,
}

/// The answer of `--what-if`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Suggestions {
    /// What is free now.
    pub now: Extent,
    /// How many places were tried.
    pub n_candidates: usize,
    /// Length of a marker's sides, m.
    pub edge_m: f64,
    /// The best, the first before the others.
    pub best: Vec<Suggestion>,
}

/// Suggestions are not nearer to each other than this, m.
const APART_M: f64 = 3.0;
/// So many are given.
const N_BEST: usize = 5;
/// Markers do not hang lower than this, and so far below the ceiling, m.
const LOWEST_M: f64 = 1.0;
const BELOW_CEILING_M: f64 = 0.4;
/// Colours end at this many times the quality that is needed.
const QUALITY_SHOWN: f64 = 5.0;
/// Cells of a picture for each node of the grid.
const CELLS_PER_NODE: f64 = 4.0;

impl Plan {
    /// Evaluates the grid, on all cores.
    ///
    /// # Errors
    /// A configuration that is refused.
    pub fn new(config: &Config) -> Result<Self, PlanError> {
        let settings = config.pilot_settings()?;
        let localization = &settings.localization;
        let space = FreeSpace::evaluate(
            &settings.planning,
            &localization.cameras,
            &localization.marker_map,
            localization.vision.corner_sigma_px,
        );
        let n_threads = n_threads();
        std::thread::scope(|scope| {
            for part in 0..n_threads {
                let space = &space;
                scope.spawn(move || space.quality().fill(part, n_threads));
            }
        });
        Ok(Self { settings: settings.planning, space })
    }

    /// The free space.
    #[must_use]
    pub const fn space(&self) -> &FreeSpace {
        &self.space
    }

    /// How much is free, by the nodes of the grid.
    #[must_use]
    pub fn extent(&self) -> Extent {
        let axes = self.space.quality().axes();
        let (mut survey_free, mut survey_clear, mut n_free, mut n_clear) = (0.0, 0.0, 0, 0);
        for node in 0..axes.n_nodes() {
            let waypoint = axes.waypoint(node);
            if !self.space.clearance().is_clear(&waypoint.place.coords) {
                continue;
            }
            let is_free = self.space.quality().quality_at(node) > self.space.min_quality();
            n_clear += 1;
            n_free += usize::from(is_free);
            if axes.is_of_survey(node) {
                survey_clear += axes.x.step * axes.y.step;
                survey_free += if is_free { axes.x.step * axes.y.step } else { 0.0 };
            }
        }
        Extent {
            survey_area_m2: survey_free,
            survey_clear_area_m2: survey_clear,
            n_free_nodes: n_free,
            n_clear_nodes: n_clear,
            n_nodes: axes.n_nodes(),
        }
    }

    /// Where one more marker would open most; candidates are `spacing_m` apart.
    ///
    /// # Errors
    /// No walls in the configuration.
    pub fn what_if(&self, spacing_m: f64, edge_m: Option<f64>) -> Result<Suggestions, PlanError> {
        let walls = self.settings.space.walls.as_ref().ok_or(PlanError::NoWalls)?;
        let tags = &self.space.quality().sensing().tags;
        let edge_m = edge_m.or_else(|| median_edge_m(tags)).unwrap_or(0.5);
        let top_m = self.settings.space.ceiling_m.unwrap_or(self.settings.height_m);
        let half_m = 0.5 * edge_m;
        let rows_m = (LOWEST_M.max(half_m), top_m - BELOW_CEILING_M - half_m);
        let candidates = candidates(walls, &Layout { spacing_m, rows_m, edge_m }, tags);
        let what_if = WhatIf::new(&self.space);
        let part = candidates.len().div_ceil(n_threads()).max(1);
        let mut gains: Vec<Gain> = std::thread::scope(|scope| {
            let what_if = &what_if;
            let work = |part: &'_ [_]| part.iter().map(|c| what_if.gain(c)).collect::<Vec<_>>();
            let threads: Vec<_> =
                candidates.chunks(part).map(|part| scope.spawn(move || work(part))).collect();
            // A thread that failed has no gains to give.
            threads.into_iter().flat_map(|thread| thread.join().unwrap_or_default()).collect()
        });
        rank(&mut gains);
        let best = distinct(&gains, APART_M, N_BEST).iter().map(suggestion).collect();
        Ok(Suggestions { now: self.extent(), n_candidates: candidates.len(), edge_m, best })
    }

    /// Draws every height of the grid into a folder; gives the names of the pictures.
    ///
    /// `suggestions` are marked, if there are any.
    ///
    /// # Errors
    /// Pictures that cannot be made or written.
    pub fn draw(
        &self,
        folder: &Path,
        suggestions: Option<&Suggestions>,
    ) -> Result<Vec<String>, PlanError> {
        let z = self.space.quality().axes().z;
        let mut names = Vec::new();
        for height_m in (0..z.n).map(|k| z.at(k)) {
            let name = format!("free_space_{height_m:04.1}m").replace('.', "_");
            self.sheet(height_m, suggestions).write(folder, &name)?;
            names.push(name);
        }
        Ok(names)
    }

    fn sheet(&self, height_m: f64, suggestions: Option<&Suggestions>) -> Sheet<HeatMap> {
        let yaw_rad = self.settings.yaw_rad;
        let axes = self.space.quality().axes();
        let at =
            |x: f64, y: f64, yaw_rad: f64| Waypoint { place: Point::new(x, y, height_m), yaw_rad };
        let quality = self.lattice(|x, y| {
            let waypoint = at(x, y, yaw_rad);
            let is_clear = self.space.clearance().is_clear(&waypoint.place.coords);
            if is_clear { self.space.quality().quality(&waypoint) } else { f64::NAN }
        });
        let turn = Axis::turn(axes.n_headings);
        let headings = self.lattice(|x, y| {
            let free = (0..axes.n_headings)
                .filter(|k| self.space.is_free(&at(x, y, yaw_rad + turn.at(*k))));
            #[expect(clippy::cast_precision_loss, reason = "few headings")]
            let share = free.count() as f64 / axes.n_headings as f64;
            share
        });
        let is_free =
            self.lattice(|x, y| f64::from(u8::from(self.space.is_free(&at(x, y, yaw_rad)))));
        let map = |title: String, grid: Lattice, quantity: &str, range: Option<[f64; 2]>| HeatMap {
            title,
            grid,
            quantity: quantity.to_owned(),
            range,
            is_signed: false,
            overlays: self.overlays(height_m, suggestions),
        };
        let heading_deg = yaw_rad.to_degrees();
        let tau = self.space.min_quality();
        let figures = vec![
            (
                "quality".to_owned(),
                map(
                    format!(
                        "Quality of fix at {height_m:.1} m, heading {heading_deg:.0}° (needed: {tau:.1})"
                    ),
                    quality,
                    "q_pos (1/√(m² + rad²)); grey: something solid too near",
                    Some([0.0, QUALITY_SHOWN * tau.max(1.0)]),
                ),
            ),
            (
                "free".to_owned(),
                map(
                    format!("Free space at {height_m:.1} m, heading {heading_deg:.0}°"),
                    is_free,
                    "free (1) or not (0)",
                    Some([0.0, 1.0]),
                ),
            ),
            (
                "headings".to_owned(),
                map(
                    format!("Free headings at {height_m:.1} m"),
                    headings,
                    &format!("share of {} headings that are free", axes.n_headings),
                    Some([0.0, 1.0]),
                ),
            ),
        ];
        Sheet { figures, n_cols: 3 }
    }

    /// Values on cells finer than the grid, over all of it.
    fn lattice(&self, value: impl Fn(f64, f64) -> f64) -> Lattice {
        let axes = self.space.quality().axes();
        let cell_m = axes.x.step / CELLS_PER_NODE;
        let half_node_m = 0.5 * axes.x.step;
        let (x_min_m, y_min_m) = (axes.x.first - half_node_m, axes.y.first - half_node_m);
        let centres = |first_m: f64, last_m: f64| {
            std::iter::successors(Some(first_m + 0.5 * cell_m), move |at| Some(at + cell_m))
                .take_while(move |at| *at < last_m)
        };
        let xs: Vec<f64> = centres(x_min_m, axes.x.last() + half_node_m).collect();
        let values = centres(y_min_m, axes.y.last() + half_node_m)
            .flat_map(|y| xs.iter().map(move |x| (*x, y)))
            .map(|(x, y)| value(x, y))
            .collect();
        Lattice { x_min_m, y_min_m, cell_m, n_cols: xs.len(), values }
    }

    fn overlays(&self, height_m: f64, suggestions: Option<&Suggestions>) -> Vec<Overlay> {
        let space = &self.settings.space;
        let mut overlays = Vec::new();
        let outline = |label: &str, ink: Ink, polygon: &Polygon| {
            let corners = polygon.corners_m().iter().map(|(x, y)| [*x, *y]).collect();
            Overlay::new(label, Shape::Outline, ink, corners)
        };
        overlays.extend(space.walls.iter().map(|walls| outline("walls", Ink::Black, walls)));
        let fence = space.fence.as_ref().and_then(|fence| fence.outline.as_ref());
        overlays.extend(fence.map(|fence| outline("fence", Ink::Sky, fence)));
        for obstacle in &space.obstacles {
            let bounds = obstacle.bounds();
            if !(bounds.min_m.z..=bounds.max_m.z).contains(&height_m) {
                continue;
            }
            match obstacle {
                Solid::Prism(prism) => {
                    overlays.push(outline("obstacle", Ink::Red, prism.footprint()));
                }
                Solid::Mesh(_) => {
                    let (low, high) = (bounds.min_m, bounds.max_m);
                    let corners =
                        vec![[low.x, low.y], [high.x, low.y], [high.x, high.y], [low.x, high.y]];
                    overlays.push(Overlay::new("mesh, its box", Shape::Outline, Ink::Red, corners));
                }
            }
        }
        let tags = &self.space.quality().sensing().tags;
        let places = tags.iter().map(|tag| [mean(tag, 0), mean(tag, 1)]).collect();
        overlays.push(Overlay::new("marker", Shape::Triangles, Ink::Orange, places));
        if let Some(suggestions) = suggestions {
            let places = suggestions.best.iter().map(|s| [s.place_m[0], s.place_m[1]]).collect();
            overlays.push(Overlay::new("one more marker", Shape::Crosses, Ink::Purple, places));
        }
        overlays
    }
}

fn mean(tag: &[Point<Hall>; 4], axis: usize) -> f64 {
    tag.iter().map(|corner| corner.coords[axis]).sum::<f64>() / 4.0
}

fn median_edge_m(tags: &[[Point<Hall>; 4]]) -> Option<f64> {
    let mut edges_m: Vec<f64> = tags.iter().map(|tag| (tag[1] - tag[0]).coords.norm()).collect();
    edges_m.sort_by(f64::total_cmp);
    edges_m.get(edges_m.len() / 2).copied()
}

fn suggestion(gain: &Gain) -> Suggestion {
    let facing = gain.candidate.facing;
    Suggestion {
        place_m: gain.candidate.place().coords.into(),
        facing_deg: facing.y.atan2(facing.x).to_degrees(),
        corners_m: gain.candidate.corners.map(|corner| corner.coords.into()),
        gain_m2: gain.area_m2,
        gain_nodes: gain.n_nodes,
    }
}

fn n_threads() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}
