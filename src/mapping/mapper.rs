//! The face of the mapping: scans and poses in, surface and volume out.

use super::base::BaseSurface;
use super::kalman_grid::{self, KalmanGrid};
use super::projection::{Hit, LidarMount, project};
use super::region::Region;
use super::sparse_gp::{self, GpError, Posterior};
use super::volume::Base;
use crate::geometry::{Body, Hall, Transform};
use crate::messages::{Beam, GridGeometry, HeightMap, HitCounts, Scan, VolumeEstimate};
use crate::time::{Mono, Stamp};
use nalgebra::Matrix6;

/// How the variances of the cells become the variance of the volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum VolumeVariance {
    /// A² Σ Σ*_ij: the marginal variances added, as printed.
    Printed,
    /// 1ᵀ Σ* 1: the variance of the sum.
    #[default]
    Full,
}

/// What the mapping must know before a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// What is measured.
    pub region: Region,
    /// Edge of a cell, m.
    pub cell_m: f64,
    /// Height of the floor under the material where no bay says otherwise, m.
    pub base_height_m: f64,
    /// Hits below the base by more than this, or above `max_height_m`, are not surface, m.
    pub below_base_m: f64,
    /// No pile is higher than this, m over the hall floor.
    pub max_height_m: f64,
    /// The LiDAR.
    pub lidar: LidarMount,
    /// How hits update the cells.
    pub kalman_grid: kalman_grid::Settings,
    /// The prior of the Gaussian process over the cells.
    pub gp: sparse_gp::Settings,
    /// The prior height is the mean of the measured cells instead of the configured one, so that
    /// ground that nothing saw counts as average ground.
    pub estimates_prior_height: bool,
    /// How σ^V is added up.
    pub volume_variance: VolumeVariance,
    /// Beams are not used while the largest position σ exceeds this, m.
    pub max_position_sigma_m: f64,
}

/// The growing map of one flight.
#[derive(Debug, Clone)]
pub struct Mapper {
    settings: Settings,
    grid: KalmanGrid,
    base: Base,
    /// Hits below this are not surface, m.
    lowest_m: f64,
    /// Cells whose hits may reach over an exclusion.
    is_near_exclusion: Vec<bool>,
    counts: HitCounts,
}

/// A pose with the covariance of its error.
pub type PoseWithCov = (Transform<Hall, Body>, Matrix6<f64>);

impl Mapper {
    /// A map at its prior.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        let geometry = settings.region.grid(settings.cell_m);
        let hall_base = BaseSurface::level(settings.base_height_m);
        let bays = settings.region.bays_on(&geometry, &hall_base);
        let base = Base::total(bays.iter().map(|bay| &bay.base), geometry.n_cells());
        let lowest_m = base.lowest_m().unwrap_or(settings.base_height_m) - settings.below_base_m;
        let kalman = settings.kalman_grid;
        // Half a cell's diagonal: the hit may be anywhere in its cell.
        let reach_m = kalman.reach * kalman.length_scale_m + geometry.cell_m;
        let is_near_exclusion = settings.region.cells_near_exclusions(&geometry, reach_m);
        let grid = KalmanGrid::new(geometry, kalman);
        Self { settings, grid, base, lowest_m, is_near_exclusion, counts: HitCounts::default() }
    }

    /// Takes in a scan; `pose_at` gives the pose at a beam's own time.
    pub fn insert(&mut self, scan: &Scan, pose_at: impl Fn(Stamp<Mono>) -> Option<PoseWithCov>) {
        for beam in &scan.beams {
            self.counts.received += 1;
            let outcome = self.insert_beam(beam, || pose_at(scan.beam_at(beam)));
            *match outcome {
                BeamFate::Used => &mut self.counts.used,
                BeamFate::NoReturn => &mut self.counts.no_return,
                BeamFate::OwnBody => &mut self.counts.own_body,
                BeamFate::Outside => &mut self.counts.outside,
                BeamFate::NoPose => &mut self.counts.no_pose,
                BeamFate::PoorPose => &mut self.counts.poor_pose,
            } += 1;
        }
    }

    /// Begins a new map; the counts go on.
    pub fn restart(&mut self) {
        self.grid = KalmanGrid::new(*self.grid.geometry(), self.settings.kalman_grid);
    }

    /// The volume of the cells as they are, their variances added: what is left when the field
    /// between them cannot be solved.
    #[must_use]
    pub fn cell_volume(&self, at: Stamp<Mono>) -> VolumeEstimate {
        let areas_m2 = &self.base.cell_areas_m2;
        let var_m6: f64 =
            std::iter::zip(areas_m2, self.grid.var_m2()).map(|(a, v)| a * a * v).sum();
        VolumeEstimate {
            at,
            volume_m3: self.base.volume_m3(self.grid.mean_m()),
            sigma_m3: var_m6.sqrt(),
            coverage_ratio: self.coverage_ratio(),
        }
    }

    fn coverage_ratio(&self) -> f64 {
        self.base.area_share(|cell| self.grid.n_hits()[cell] > 0)
    }

    /// Counts a scan that was taken while nothing was measured.
    pub fn count_on_ground(&mut self, scan: &Scan) {
        let n_beams = scan.beams.len() as u64;
        self.counts.received += n_beams;
        self.counts.on_ground += n_beams;
    }

    /// Counts a scan that cannot be placed in time.
    pub fn refuse(&mut self, scan: &Scan) {
        let n_beams = scan.beams.len() as u64;
        self.counts.received += n_beams;
        self.counts.no_pose += n_beams;
    }

    fn insert_beam(
        &mut self,
        beam: &Beam,
        pose_at: impl FnOnce() -> Option<PoseWithCov>,
    ) -> BeamFate {
        let mount = &self.settings.lidar;
        let range_m = f64::from(beam.range_m);
        if !(mount.min_range_m..=mount.max_range_m).contains(&range_m) {
            return BeamFate::NoReturn;
        }
        if mount.is_blind(f64::from(beam.angle_rad)) {
            return BeamFate::OwnBody;
        }
        let Some((hall_from_body, pose_cov)) = pose_at() else { return BeamFate::NoPose };
        let worst_var_m2 = (0..3).map(|axis| pose_cov[(axis, axis)]).fold(0.0, f64::max);
        if worst_var_m2 > self.settings.max_position_sigma_m.powi(2) {
            return BeamFate::PoorPose;
        }
        let hit = project(mount, beam, &hall_from_body, &pose_cov);
        let p = hit.place.coords;
        let is_surface = (self.lowest_m..=self.settings.max_height_m).contains(&p.z);
        if !is_surface || !self.settings.region.accepts(p.x, p.y) {
            return BeamFate::Outside;
        }
        self.insert_hit(&hit);
        BeamFate::Used
    }

    fn insert_hit(&mut self, hit: &Hit) {
        let place = (hit.place.coords.x, hit.place.coords.y);
        let cell = self.grid.geometry().cell_at(place.0, place.1);
        // Looking for walls in between costs more than the update, and most cells have none near.
        if cell.is_some_and(|cell| self.is_near_exclusion[cell]) {
            let region = &self.settings.region;
            self.grid.insert(hit, |centre| !region.separates(place, centre));
        } else {
            self.grid.insert(hit, |_| true);
        }
    }

    /// Where the beams went so far.
    #[must_use]
    pub const fn counts(&self) -> HitCounts {
        self.counts
    }

    /// The cells.
    #[must_use]
    pub const fn grid(&self) -> &KalmanGrid {
        &self.grid
    }

    /// Which area counts.
    #[must_use]
    pub const fn base(&self) -> &Base {
        &self.base
    }

    /// h0: configured, or the mean height of the cells that a beam has hit.
    fn prior_height_m(&self) -> f64 {
        let configured_m = self.settings.kalman_grid.prior_height_m;
        if !self.settings.estimates_prior_height {
            return configured_m;
        }
        let areas_m2 = self.base.cell_areas_m2.iter().zip(self.grid.n_hits());
        let (area_m2, volume_m3) = std::iter::zip(areas_m2, self.grid.mean_m())
            .filter(|((_, n_hits), _)| **n_hits > 0)
            .fold((0.0, 0.0), |(area, volume), ((a, _), mean)| (area + a, volume + a * mean));
        if area_m2 > 0.0 { volume_m3 / area_m2 } else { configured_m }
    }

    /// Everything a solve of the surface needs, as it is now.
    #[must_use]
    pub fn snapshot(&self, at: Stamp<Mono>, wants_marginals: bool) -> SolveSurface {
        let prior_height_m = self.prior_height_m();
        SolveSurface {
            at,
            geometry: *self.grid.geometry(),
            cell_mean_m: self.grid.mean_on_prior_m(prior_height_m),
            cell_var_m2: self.grid.var_m2().to_vec(),
            coverage_ratio: self.coverage_ratio(),
            base: self.base.clone(),
            gp: sparse_gp::Settings { mean_m: prior_height_m, ..self.settings.gp },
            volume_variance: self.settings.volume_variance,
            wants_marginals,
        }
    }
}

enum BeamFate {
    Used,
    NoReturn,
    OwnBody,
    Outside,
    NoPose,
    PoorPose,
}

/// The work of turning cells into a surface and a volume; a pure function of its fields.
#[derive(Debug, Clone, PartialEq)]
pub struct SolveSurface {
    at: Stamp<Mono>,
    geometry: GridGeometry,
    cell_mean_m: Vec<f64>,
    cell_var_m2: Vec<f64>,
    coverage_ratio: f64,
    base: Base,
    gp: sparse_gp::Settings,
    volume_variance: VolumeVariance,
    wants_marginals: bool,
}

/// What a [`SolveSurface`] found.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedSurface {
    /// How much there is.
    pub volume: VolumeEstimate,
    /// The surface; its σ is the cells' own where the marginals were not asked for.
    pub surface: HeightMap,
}

impl SolveSurface {
    /// Solves.
    ///
    /// # Errors
    /// [`GpError`] from the Gaussian process.
    pub fn run(&self) -> Result<SolvedSurface, GpError> {
        let posterior =
            Posterior::new(&self.geometry, &self.cell_mean_m, &self.cell_var_m2, &self.gp)?;
        let needs_marginals =
            self.wants_marginals || self.volume_variance == VolumeVariance::Printed;
        let var_m2 =
            if needs_marginals { posterior.marginal_var_m2() } else { self.cell_var_m2.clone() };
        let areas_m2 = &self.base.cell_areas_m2;
        let volume_var = match self.volume_variance {
            VolumeVariance::Full => posterior.sum_var(areas_m2),
            VolumeVariance::Printed => {
                std::iter::zip(areas_m2, &var_m2).map(|(area, var)| area * area * var).sum()
            }
        };
        let volume = VolumeEstimate {
            at: self.at,
            volume_m3: self.base.volume_m3(posterior.mean_m()),
            sigma_m3: volume_var.sqrt(),
            coverage_ratio: self.coverage_ratio,
        };
        let surface = HeightMap {
            at: self.at,
            grid: self.geometry,
            mean_m: posterior.mean_m().to_vec(),
            sigma_m: var_m2.iter().map(|var| var.sqrt()).collect(),
        };
        Ok(SolvedSurface { volume, surface })
    }
}

#[cfg(test)]
mod tests {
    use super::super::region::Rect;
    use super::*;
    use crate::geometry::{Point, Rotation};

    fn settings() -> Settings {
        let kalman_grid = kalman_grid::Settings::default();
        Settings {
            region: Region {
                bounds: Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 6.0, y_max_m: 6.0 },
                exclusions: Vec::new(),
                exclusion_margin_m: 0.0,
                bays: Vec::new(),
            },
            cell_m: 0.25,
            base_height_m: 0.0,
            below_base_m: 0.5,
            max_height_m: 4.0,
            lidar: LidarMount {
                body_from_lidar: Transform::new(
                    Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0),
                    Point::origin(),
                ),
                range_sigma_m: 0.01,
                angle_sigma_rad: 0.002,
                min_range_m: 0.1,
                max_range_m: 12.0,
                blind_sectors_rad: vec![(2.6, 3.2)],
            },
            kalman_grid,
            gp: sparse_gp::Settings {
                smoothness_nu: 1.5,
                length_scale_m: 0.5,
                reach: 1.5,
                sigma_m: 1.5,
                mean_m: 1.5,
                cut: sparse_gp::Cut::Taper,
            },
            estimates_prior_height: true,
            volume_variance: VolumeVariance::Full,
            max_position_sigma_m: 0.2,
        }
    }

    /// A sweep over a level surface at 1.2 m, every beam exact.
    #[expect(clippy::cast_possible_truncation, reason = "test angles")]
    fn sweep(mapper: &mut Mapper) {
        for step in 0..60 {
            let x = 0.05 + f64::from(step) * 0.1;
            let pose = Transform::new(Rotation::identity(), Point::new(x, 3.0, 5.2));
            let beams = (-60..=60)
                .map(|k| {
                    let angle = f64::from(k) * 0.0125;
                    let range_m = (4.0 / angle.cos()) as f32;
                    Beam { offset_ns: 0, angle_rad: angle as f32, range_m, intensity: 1 }
                })
                .collect();
            let scan = Scan { start: Stamp::ZERO, beams };
            mapper.insert(&scan, |_| Some((pose, Matrix6::identity() * 1e-6)));
        }
    }

    #[test]
    fn a_level_surface_has_the_volume_of_its_box() {
        let mut mapper = Mapper::new(settings());
        sweep(&mut mapper);
        let solved = mapper.snapshot(Stamp::ZERO, true).run().expect("solved");
        // 6 × 6 × 1.2 = 43.2 m³; the prior pulls each cell by less than 1 %.
        assert!((solved.volume.volume_m3 - 43.2).abs() < 0.43, "{:?}", solved.volume);
        assert!(solved.volume.coverage_ratio > 0.95);
    }

    #[test]
    fn every_beam_is_counted_once() {
        let mut mapper = Mapper::new(settings());
        let beam = |angle_rad, range_m| Beam { offset_ns: 0, angle_rad, range_m, intensity: 0 };
        let scan = Scan {
            start: Stamp::ZERO,
            beams: vec![
                beam(0.0, 4.0),
                beam(0.0, 0.0),
                beam(0.0, 13.0),
                beam(3.0, 1.0),
                beam(1.2, 11.0),
            ],
        };
        let pose = Transform::new(Rotation::identity(), Point::new(3.0, 3.0, 5.0));
        mapper.insert(&scan, |_| Some((pose, Matrix6::zeros())));
        mapper.insert(&Scan { start: Stamp::ZERO, beams: vec![beam(0.0, 4.0)] }, |_| None);
        mapper.insert(&Scan { start: Stamp::ZERO, beams: vec![beam(0.0, 4.0)] }, |_| {
            Some((pose, Matrix6::identity()))
        });
        let expected = HitCounts {
            received: 7,
            used: 1,
            no_return: 2,
            own_body: 1,
            outside: 1,
            no_pose: 1,
            poor_pose: 1,
            on_ground: 0,
        };
        assert_eq!(mapper.counts(), expected);
    }
}
