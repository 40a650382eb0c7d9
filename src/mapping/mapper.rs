//! The face of the mapping: scans and poses in, surface and volumes out.

use super::base::BaseSurface;
use super::bay::WHOLE_REGION;
use super::belief::CoarseField;
use super::field_map::{self, FieldMap, Setup};
use super::footprint::{Footprint, LineHit, gather, passing};
use super::grid_map::{self, Bays, GridMap};
use super::kalman_grid::KalmanGrid;
use super::matern_field::{FieldError, Lattice};
use super::projection::{Hit, LidarMount, project};
use super::region::Region;
use super::silence::{SilentRay, gather_silent, silent_beams};
use super::solid::{self, Solid};
use super::surface_work::{SolveSurface, SolvedSurface};
use super::volume::Base;
use crate::geometry::{Body, Hall, Point, Transform};
use crate::messages::{Beam, GridGeometry, HitCounts, PoseError, Scan, VolumeAccount};
use crate::time::{Mono, Stamp};
use nalgebra::{Matrix6, Vector3};
use std::sync::Arc;
use std::time::Duration;

/// How the surface is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// The paper's height grid with its sparse Gaussian process.
    KalmanGrid,
    /// A Gauss–Markov field with the budget of all error sources.
    #[default]
    MaternField,
}

/// What the mapping must know before a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// How the surface is kept.
    pub method: Method,
    /// What is measured.
    pub region: Region,
    /// Edge of a cell, m.
    pub cell_m: f64,
    /// Height of the floor under the material where no bay says otherwise, m.
    pub base_height_m: f64,
    /// What stands or hangs in the hall: hits within the region's `exclusion_margin_m` of it are
    /// no material.
    pub obstacles: Vec<Solid>,
    /// Hits below the base by more than this, or above `max_height_m`, are not surface, m.
    pub below_base_m: f64,
    /// No pile is higher than this, m over the hall floor.
    pub max_height_m: f64,
    /// The LiDAR.
    pub lidar: LidarMount,
    /// The paper's grid; kept with either method, for the paper's planner reads it.
    pub grid: grid_map::Settings,
    /// The field.
    pub field: field_map::Settings,
    /// Beams are not used while the largest position σ exceeds this, m.
    pub max_position_sigma_m: f64,
}

/// The growing map of one flight.
#[derive(Debug, Clone)]
pub struct Mapper {
    settings: Settings,
    grid: GridMap,
    field: Option<FieldMap>,
    bays: Bays,
    /// The lowest base, m over the hall floor.
    floor_m: f64,
    counts: HitCounts,
    on_grid: OnGrid,
    /// Every hit, if somebody wants them: not in flight.
    kept: Option<Vec<KeptHit>>,
}

/// A hit that changed the map, for those who want each of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeptHit {
    /// When its beam was measured.
    pub at: Stamp<Mono>,
    /// Where it is in the hall, m.
    pub place_m: [f64; 3],
    /// Standard deviation of its height, m, the pose's share included.
    pub height_sigma_m: f64,
    /// Strength of the return, in the sensor's own scale.
    pub intensity: u8,
}

/// What the paper's grid holds, which cannot give back a single hit.
#[derive(Debug, Clone, Copy, Default)]
struct OnGrid {
    n_beams: u64,
    newest_at: Option<Stamp<Mono>>,
}

/// A pose with the covariance of its error.
pub type PoseWithCov = (Transform<Hall, Body>, Matrix6<f64>);

/// The error of the pose at the middle of a turn, and that pose.
type SharedByTurn = (PoseError, Transform<Hall, Body>);

/// Padding of the field around the region, in practical ranges.
const PADDING_RANGES: f64 = 1.0;
/// Level σ that a hit must be inside the region's border.
const BORDER_SIGMAS: f64 = 3.0;

impl Mapper {
    /// A map at its prior.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        let geometry = settings.region.grid(settings.cell_m);
        let hall_base = BaseSurface::level(settings.base_height_m);
        let bays: Bays = Arc::new(settings.region.whole_and_bays_on(&geometry, &hall_base));
        let floor_m = bays[0].base.lowest_m().unwrap_or(settings.base_height_m);
        let grid = GridMap::new(settings.grid, &settings.region, geometry, Arc::clone(&bays));
        let field = (settings.method == Method::MaternField)
            .then(|| FieldMap::new(field_setup(&settings, &geometry, &bays)));
        Self {
            floor_m,
            settings,
            grid,
            field,
            bays,
            counts: HitCounts::default(),
            on_grid: OnGrid::default(),
            kept: None,
        }
    }

    /// Keeps every hit from now on; a flight has some hundred thousand of 48 bytes.
    pub fn keep_hits(&mut self) {
        self.kept.get_or_insert_default();
    }

    /// The hits that changed the map as it is now, in their order; none unless they are kept.
    #[must_use]
    pub fn kept_hits(&self) -> &[KeptHit] {
        self.kept.as_deref().unwrap_or(&[])
    }

    /// Takes in a turn of the scanner; `pose_at` gives the pose at a beam's own time, `error_at` the
    /// pose's error at an instant, chained to the error at an earlier one.
    pub fn insert(
        &mut self,
        scan: &Scan,
        pose_at: impl Fn(Stamp<Mono>) -> Option<PoseWithCov>,
        error_at: impl Fn(Stamp<Mono>, Option<Stamp<Mono>>) -> Option<PoseError>,
    ) {
        let middle = middle_of(scan);
        let shared = self.shared(middle, &pose_at, &error_at);
        let (mut hits, mut ends_elsewhere) = (Vec::new(), Vec::new());
        for beam in &scan.beams {
            self.counts.received += 1;
            let seen = self.hit(beam, || pose_at(scan.beam_at(beam)));
            let fate = match seen.and_then(|seen| Ok((seen, shared.as_ref().map_err(|f| *f)?))) {
                Ok((seen, shared)) if self.is_material(&seen.hit) => {
                    self.grid.insert(&seen.hit, &self.settings.region);
                    self.on_grid.n_beams += 1;
                    self.on_grid.newest_at = self.on_grid.newest_at.max(Some(middle));
                    if let Some(kept) = &mut self.kept {
                        kept.push(kept_hit(&seen.hit, beam, scan.beam_at(beam)));
                    }
                    if shared.is_some() {
                        hits.push(self.line_hit(&seen.hit, &seen.hall_from_body));
                    }
                    Fate::Used
                }
                Ok((seen, _)) => {
                    ends_elsewhere.push(seen.hit.place);
                    Fate::Outside
                }
                Err(fate) => fate,
            };
            *self.count_of(fate) += 1;
        }
        let patches = gather(&hits, self.settings.cell_m);
        let Ok(Some((error, hall_from_body))) = shared else { return };
        if patches.is_empty() {
            return;
        }
        let passed_to_m = passing(&ends_elsewhere, self.settings.cell_m);
        let silent = self.silent_rays(scan, pose_at);
        if let Some(field) = &mut self.field {
            let lidar_idx = 0;
            field.push(Footprint {
                error,
                hall_from_body,
                lidar_idx,
                patches,
                passed_to_m,
                silent,
            });
        }
    }

    /// Beams without an echo, of those that came down to where ground can be.
    fn silent_rays(
        &self,
        scan: &Scan,
        pose_at: impl Fn(Stamp<Mono>) -> Option<PoseWithCov>,
    ) -> Vec<SilentRay> {
        let (width_m, depth_m) = self.settings.region.bounds.size_m();
        let across_m = width_m.hypot(depth_m).hypot(self.settings.max_height_m);
        // A hair less than what is trusted, in single precision too.
        let length_m = self.settings.lidar.max_range_m.min(across_m) * (1.0 - 1e-6);
        #[expect(clippy::cast_possible_truncation, reason = "as precise as beams are")]
        let so_long = |beam: &Beam| Beam { range_m: length_m as f32, ..*beam };
        let ends: Vec<Point<Hall>> = silent_beams(scan)
            .filter_map(|beam| self.hit(&so_long(beam), || pose_at(scan.beam_at(beam))).ok())
            .map(|seen| seen.hit.place)
            .filter(|end| end.coords.z < self.settings.max_height_m)
            .collect();
        gather_silent(&ends, length_m)
    }

    /// What the beams of a turn share in the field: the pose at its middle and its error. Without
    /// them none of the beams is of use; the paper's grid does not need them.
    fn shared(
        &self,
        middle: Stamp<Mono>,
        pose_at: impl Fn(Stamp<Mono>) -> Option<PoseWithCov>,
        error_at: impl Fn(Stamp<Mono>, Option<Stamp<Mono>>) -> Option<PoseError>,
    ) -> Result<Option<SharedByTurn>, Fate> {
        let Some(field) = &self.field else { return Ok(None) };
        let error = error_at(middle, field.newest_turn_at()).ok_or(Fate::NoPose)?;
        let (hall_from_body, _) = pose_at(middle).ok_or(Fate::NoPose)?;
        if !error.is_finite() {
            return Err(Fate::PoorPose);
        }
        Ok(Some((error, hall_from_body)))
    }

    fn line_hit(&self, hit: &Hit, hall_from_body: &Transform<Hall, Body>) -> LineHit {
        let grid = self.grid.grid().geometry();
        let node = |place_m: f64, min_m: f64| (place_m - min_m) / grid.cell_m - 0.5;
        let p = hit.place.coords;
        LineHit {
            place: hit.place,
            arm_m: (hall_from_body.inverse() * hit.place).coords,
            at_node: (node(p.x, grid.x_min_m), node(p.y, grid.y_min_m)),
        }
    }

    const fn count_of(&mut self, fate: Fate) -> &mut u64 {
        let counts = &mut self.counts;
        match fate {
            Fate::Used => &mut counts.used,
            Fate::NoReturn => &mut counts.no_return,
            Fate::OwnBody => &mut counts.own_body,
            Fate::Outside => &mut counts.outside,
            Fate::NoPose => &mut counts.no_pose,
            Fate::PoorPose => &mut counts.poor_pose,
        }
    }

    /// The turns of the scanner that the field holds, in their order; none with the paper's grid.
    #[must_use]
    pub fn turns(&self) -> &[Arc<Footprint>] {
        self.field.as_ref().map_or(&[], FieldMap::turns)
    }

    /// The field, where it is kept.
    pub(super) const fn field_mut(&mut self) -> Option<&mut FieldMap> {
        self.field.as_mut()
    }

    /// Drops what was measured after `since`, because the poses since then were wrong; the number of
    /// beams.
    ///
    /// The field gives back its turns. The paper's grid cannot give back single hits: where it is
    /// the map, it begins anew; beside a field, where only the paper's planner reads it, it stays.
    pub fn forget_since(&mut self, since: Stamp<Mono>) -> u64 {
        if let Some(kept) = &mut self.kept {
            kept.retain(|hit| hit.at <= since);
        }
        let n_beams = match &mut self.field {
            Some(field) => field.forget_since(since),
            None if self.on_grid.newest_at > Some(since) => {
                self.grid.restart();
                std::mem::take(&mut self.on_grid).n_beams
            }
            None => 0,
        };
        self.counts.used = self.counts.used.saturating_sub(n_beams);
        self.counts.forgotten += n_beams;
        n_beams
    }

    /// Begins a new map; the counts go on.
    pub fn restart(&mut self) {
        self.grid.restart();
        self.on_grid = OnGrid::default();
        self.kept.iter_mut().for_each(Vec::clear);
        if let Some(field) = &mut self.field {
            field.restart();
        }
    }

    /// The volumes of the cells as they are: what is left when the surface cannot be solved.
    #[must_use]
    pub fn cell_volumes(&self, at: Stamp<Mono>) -> Vec<VolumeAccount> {
        self.grid.cell_volumes(at)
    }

    /// Counts a scan that was taken while nothing was measured.
    pub fn count_on_ground(&mut self, scan: &Scan) {
        let n_beams = scan.beams.len() as u64;
        self.counts.received += n_beams;
        self.counts.on_ground += n_beams;
    }

    /// When a scan last measured something: a distance in reach, past the own body.
    #[must_use]
    pub fn measured_at(&self, scan: &Scan) -> Option<Stamp<Mono>> {
        let mount = &self.settings.lidar;
        let is_of_use = |beam: &&Beam| {
            (mount.min_range_m..=mount.max_range_m).contains(&f64::from(beam.range_m))
                && !mount.is_blind(f64::from(beam.angle_rad))
        };
        scan.beams.iter().rev().find(is_of_use).map(|beam| scan.beam_at(beam))
    }

    /// Counts a scan that cannot be placed in time.
    pub fn refuse(&mut self, scan: &Scan) {
        let n_beams = scan.beams.len() as u64;
        self.counts.received += n_beams;
        self.counts.no_pose += n_beams;
    }

    /// Where a beam ended and from which pose, or why nothing can be said of that.
    fn hit(
        &self,
        beam: &Beam,
        pose_at: impl FnOnce() -> Option<PoseWithCov>,
    ) -> Result<Seen, Fate> {
        let mount = &self.settings.lidar;
        let range_m = f64::from(beam.range_m);
        if !(mount.min_range_m..=mount.max_range_m).contains(&range_m) {
            return Err(Fate::NoReturn);
        }
        if mount.is_blind(f64::from(beam.angle_rad)) {
            return Err(Fate::OwnBody);
        }
        let (hall_from_body, pose_cov) = pose_at().ok_or(Fate::NoPose)?;
        let most_var_m2 = self.settings.max_position_sigma_m.powi(2);
        let is_sure = pose_cov.iter().all(|c| c.is_finite())
            && (0..3).all(|axis| pose_cov[(axis, axis)] <= most_var_m2);
        if !is_sure {
            return Err(Fate::PoorPose);
        }
        Ok(Seen { hit: project(mount, beam, &hall_from_body, &pose_cov), hall_from_body })
    }

    /// True if a hit can be of what is measured.
    fn is_material(&self, hit: &Hit) -> bool {
        let p = hit.place.coords;
        let lowest_m = self.floor_m - self.settings.below_base_m;
        let is_surface = (lowest_m..=self.settings.max_height_m).contains(&p.z);
        is_surface
            && self.settings.region.accepts(p.x, p.y, self.border_m(hit))
            && !self.is_obstacle(&p)
    }

    /// How far inside the region a hit must be so that it is not of the wall at the border, m: noise
    /// brings hits of the wall's face into the region, and they lie at any height. At most half a
    /// cell, for else the nodes at the border could have no hits of their own; none for the paper's
    /// grid, which takes all hits in D.
    fn border_m(&self, hit: &Hit) -> f64 {
        if self.field.is_none() {
            return 0.0;
        }
        let level_var_m2 = hit.cov_m2[(0, 0)].max(hit.cov_m2[(1, 1)]);
        (BORDER_SIGMAS * level_var_m2.sqrt()).min(0.5 * self.settings.cell_m)
    }

    /// True if a hit belongs to something that stands or hangs in the hall.
    fn is_obstacle(&self, place: &Vector3<f64>) -> bool {
        let margin_m = self.settings.region.exclusion_margin_m;
        let obstacles = &self.settings.obstacles;
        // A hair more than the margin, so that one exactly there counts.
        solid::distance_m(obstacles, place, margin_m + 1e-9) <= margin_m
    }

    /// Where the beams went so far.
    #[must_use]
    pub const fn counts(&self) -> HitCounts {
        self.counts
    }

    /// The paper's cells.
    #[must_use]
    pub const fn grid(&self) -> &KalmanGrid {
        self.grid.grid()
    }

    /// The name of the bay at a place, if the region has bays of their own names.
    #[must_use]
    pub fn bay_at(&self, x_m: f64, y_m: f64) -> Option<&str> {
        let bays = &self.settings.region.bays;
        let bay = bays.iter().find(|bay| bay.outline.contains(x_m, y_m))?;
        (bay.name != WHOLE_REGION).then_some(bay.name.as_str())
    }

    /// What it was made with.
    #[must_use]
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Which area counts.
    #[must_use]
    pub fn base(&self) -> &Base {
        &self.bays[0].base
    }

    /// The coarse lattice on which planners weigh flights.
    ///
    /// # Errors
    /// [`FieldError`] for a prior that is none.
    pub fn coarse_field(&self) -> Result<CoarseField, FieldError> {
        let settings = &self.settings;
        let areas_m2 = &self.base().cell_areas_m2;
        let fine = *self.grid().geometry();
        let field = CoarseField::new(&settings.region, fine, areas_m2, settings.field.prior())?;
        Ok(if self.field.is_some() { field } else { field.without_patches() })
    }

    /// Everything a solve of the surface needs, as it is now.
    #[must_use]
    pub fn snapshot(&self, at: Stamp<Mono>, is_final: bool) -> SolveSurface {
        self.field.as_ref().map_or_else(
            || SolveSurface::KalmanGrid(Box::new(self.grid.snapshot(at, is_final))),
            |field| SolveSurface::MaternField(Box::new(field.snapshot(at, is_final))),
        )
    }

    /// Learns from a solved surface: slopes, and what the next solve starts from.
    pub fn absorb(&mut self, solved: &SolvedSurface) {
        self.counts.refused = solved.n_beams_refused;
        if let (Some(field), Some(newest)) = (&mut self.field, &solved.newest) {
            field.absorb(Arc::clone(newest));
        }
    }
}

fn kept_hit(hit: &Hit, beam: &Beam, at: Stamp<Mono>) -> KeptHit {
    KeptHit {
        at,
        place_m: hit.place.coords.into(),
        height_sigma_m: hit.cov_m2[(2, 2)].max(0.0).sqrt(),
        intensity: beam.intensity,
    }
}

/// When half of a scan's time is over.
fn middle_of(scan: &Scan) -> Stamp<Mono> {
    scan.start
        .plus(Duration::from_nanos(scan.beams.last().map_or(0, |b| u64::from(b.offset_ns) / 2)))
}

fn field_setup(settings: &Settings, geometry: &GridGeometry, bays: &Bays) -> Arc<Setup> {
    let padding_m = PADDING_RANGES * settings.field.range_m;
    Arc::new(Setup {
        settings: settings.field,
        lattice: Arc::new(Lattice::covering_beside_walls(
            geometry,
            padding_m,
            |place| settings.region.beside_exclusions(place, settings.cell_m),
            |a, b| settings.region.separates(a, b),
        )),
        lidars: vec![settings.lidar.clone()],
        bays: Arc::clone(bays),
    })
}

/// Where a beam ended, and the pose that it started from.
#[derive(Debug, Clone, Copy)]
struct Seen {
    hit: Hit,
    hall_from_body: Transform<Hall, Body>,
}

#[derive(Debug, Clone, Copy)]
enum Fate {
    Used,
    NoReturn,
    OwnBody,
    Outside,
    NoPose,
    PoorPose,
}

#[cfg(test)]
pub(super) mod tests;
