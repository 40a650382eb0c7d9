//! The map of a flight as a Matérn field: turns of the scanner in, volumes with their budgets out.
//!
//! The map is the list of its turns ([`Footprint`]). A solve reads all of them anew with the slopes
//! of the newest surface, so nothing of an early, coarse linearisation remains in the result, and
//! maps of several flights add up by joining their lists.
//!
//! ```text
//! turns ─▶ datum (row a, height z, variance R) ─▶ Σ aaᵀ/R, Σ a z/R ─▶ Q h = … ─▶ h, q ─▶ V, budget
//!            ▲ slopes, outliers                                           │
//!            └────────────────────────────────────────────────────────────┘
//! ```

mod learn;
mod setup;
mod solve;

#[cfg(test)]
mod tests;

pub use solve::SolveField;

use super::budget::CalibrationSigmas;
#[cfg(test)]
use super::datum::Linearization;
use super::disturbance::Levels;
use super::footprint::Footprint;
use super::grid_map::Bays;
use super::hidden_ground::HiddenGround;
use super::matern_field::{Lattice, Prior};
use super::projection::LidarMount;
use super::ray_ceiling::RayCeiling;
use super::roughness::OCCLUSION_SHARE;
use crate::time::{Mono, Stamp};
use std::sync::Arc;

/// What the field must know before a flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Practical range ρ of the material's heights, m.
    pub range_m: f64,
    /// Standard deviation `σ_f` of the heights about their mean level, m.
    pub sigma_m: f64,
    /// Roughness below the cell size `σ_ε`, m, until the data show it.
    pub nugget_m: f64,
    /// Expected mean level, m, and its standard deviation, m.
    pub mean_level_m: (f64, f64),
    /// Standard deviation `σ_t` of the slope before anything is known.
    pub slope_sigma: f64,
    /// Share of what may hide in hollows that is taken off, [`OCCLUSION_SHARE`] but for tests of its row.
    pub occlusion_share: f64,
    /// Errors that last the whole flight.
    pub calibration: CalibrationSigmas,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            range_m: 5.0,
            sigma_m: 1.0,
            nugget_m: 0.007,
            mean_level_m: (1.5, 1.5),
            slope_sigma: 0.6,
            occlusion_share: OCCLUSION_SHARE.0,
            calibration: CalibrationSigmas::default(),
        }
    }
}

/// What stays the same for all solves of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// What the field must know.
    pub settings: Settings,
    /// Nodes of the field.
    pub lattice: Arc<Lattice>,
    /// The LiDAR of each vehicle; one, unless maps of several vehicles are merged.
    pub lidars: Vec<LidarMount>,
    /// What is measured: the whole region, then its bays.
    pub bays: Bays,
}

/// The newest surface, which the next solve starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct NewestField {
    /// Height of every node, m.
    pub heights_m: Vec<f64>,
    /// Nodes that rest on data.
    pub is_known: Vec<bool>,
    /// Variance of the height of every node, m²; where exact ones cost too much, those that the distance to
    /// seen ground gives.
    pub var_m2: Vec<f64>,
    /// How far the patches of a square scatter about each other, m; `None` before enough is seen.
    pub scatter_m: Option<f64>,
    /// What is known of ground that no beam reached.
    pub hidden: HiddenGround,
    /// The adjoint of each volume, m²: where the next iterative solve of them starts in flight.
    pub adjoints_m2: Vec<Vec<f64>>,
}

impl NewestField {
    /// The roughness that the data show, m; `None` before they do.
    fn shown_roughness_m(&self) -> Option<f64> {
        self.scatter_m.map(|scatter_m| scatter_m.max(LEAST_ROUGHNESS_M))
    }
}

/// No ground is smoother than this below the cell size, m: a grain of sand.
const LEAST_ROUGHNESS_M: f64 = 0.001;

/// The turns of a flight, and the newest surface.
#[derive(Debug, Clone)]
pub struct FieldMap {
    setup: Arc<Setup>,
    footprints: Vec<Arc<Footprint>>,
    levels: Arc<Levels>,
    ceiling: Arc<RayCeiling>,
    newest: Option<Arc<NewestField>>,
}

impl FieldMap {
    /// A map without a turn.
    #[must_use]
    pub fn new(setup: Arc<Setup>) -> Self {
        let (levels, ceiling) = (setup.levels(), setup.ceiling());
        Self { setup, footprints: Vec::new(), levels, ceiling, newest: None }
    }

    /// Takes in a turn.
    pub fn push(&mut self, mut footprint: Footprint) {
        Arc::make_mut(&mut self.levels).take(&self.setup.lattice, &mut footprint);
        if let Some(lidar) = self.setup.lidars.get(footprint.lidar_idx) {
            let turn_idx = self.footprints.len();
            Arc::make_mut(&mut self.ceiling).take(&self.setup.lattice, lidar, turn_idx, &footprint);
        }
        // Thousands of turns stay: what the lists have grown into and do not use would double them.
        footprint.patches.shrink_to_fit();
        footprint.passed_to_m.shrink_to_fit();
        footprint.silent.shrink_to_fit();
        self.footprints.push(Arc::new(footprint));
    }

    /// The turns so far, in their order.
    #[must_use]
    pub fn turns(&self) -> &[Arc<Footprint>] {
        &self.footprints
    }

    /// The same map with the LiDAR of each of several vehicles.
    pub(super) fn set_lidars(&mut self, lidars: Vec<LidarMount>) {
        Arc::make_mut(&mut self.setup).lidars = lidars;
    }

    /// Forgets all turns and surfaces.
    pub fn restart(&mut self) {
        self.footprints.clear();
        self.levels = self.setup.levels();
        self.ceiling = self.setup.ceiling();
        self.newest = None;
    }

    /// Drops the turns after `since`, and the surface if it may rest on them; the number of their
    /// beams.
    pub fn forget_since(&mut self, since: Stamp<Mono>) -> u64 {
        let is_kept = |footprint: &Arc<Footprint>| footprint.error.at <= since;
        let dropped = self.footprints.iter().filter(|footprint| !is_kept(footprint));
        let patches = dropped.flat_map(|footprint| &footprint.patches);
        let n_beams = patches.map(|patch| u64::from(patch.n_beams)).sum();
        let kept = std::mem::take(&mut self.footprints).into_iter().filter(is_kept);
        // Levels are sorted turn by turn: those of wrong poses must not judge the later ones.
        self.levels = self.setup.levels();
        self.ceiling = self.setup.ceiling();
        for footprint in kept.collect::<Vec<_>>() {
            self.push(Arc::unwrap_or_clone(footprint));
        }
        if n_beams > 0 {
            self.newest = None;
        }
        n_beams
    }

    /// Starts the next solve from this surface.
    pub fn absorb(&mut self, newest: Arc<NewestField>) {
        self.newest = Some(newest);
    }

    /// The nodes.
    #[cfg(test)]
    pub(super) fn lattice(&self) -> &Lattice {
        &self.setup.lattice
    }

    /// The linearisation at these heights, with the configured roughness.
    #[cfg(test)]
    pub(super) fn linearization<'a>(&'a self, heights_m: &'a [f64]) -> Linearization<'a> {
        let at = self.setup.linearization(&[], None);
        Linearization { heights_m: Some(heights_m), ..at }
    }

    /// When the newest turn was taken.
    #[must_use]
    pub fn newest_turn_at(&self) -> Option<Stamp<Mono>> {
        self.footprints.last().map(|footprint| footprint.error.at)
    }

    /// Everything a solve needs, as it is now.
    #[must_use]
    pub fn snapshot(&self, at: Stamp<Mono>, is_final: bool) -> SolveField {
        SolveField {
            at,
            setup: Arc::clone(&self.setup),
            footprints: self.footprints.clone(),
            levels: Arc::clone(&self.levels),
            ceiling: Arc::clone(&self.ceiling),
            newest: self.newest.clone(),
            is_final,
        }
    }
}

impl Settings {
    /// The field before any beam.
    #[must_use]
    pub const fn prior(&self) -> Prior {
        Prior {
            range_m: self.range_m,
            sigma_m: self.sigma_m,
            mean_m: self.mean_level_m.0,
            mean_sigma_m: self.mean_level_m.1,
        }
    }
}
