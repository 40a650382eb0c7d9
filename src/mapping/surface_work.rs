//! The solve of a surface as a piece of work that anybody can run: what goes in, what comes out.

use super::bay::{BayOnGrid, WHOLE_REGION};
use super::field_map::{NewestField, SolveField};
use super::gaps::Gap;
use super::grid_map::SolveGrid;
use super::matern_field::FieldError;
use super::sparse_gp::GpError;
use super::volume::Base;
use crate::messages::{CellCoverage, DisturbedArea, GridGeometry, HeightMap, VolumeAccount};
use std::sync::Arc;

/// The work of turning what was seen into a surface and its volumes.
#[derive(Debug, Clone, PartialEq)]
pub enum SolveSurface {
    /// By the paper's grid.
    KalmanGrid(Box<SolveGrid>),
    /// By the field.
    MaternField(Box<SolveField>),
}

/// Why there is no surface.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SolveError {
    /// From the paper's grid.
    #[error(transparent)]
    Grid(#[from] GpError),
    /// From the field.
    #[error(transparent)]
    Field(#[from] FieldError),
}

/// What a [`SolveSurface`] found.
#[derive(Debug, Clone, PartialEq)]
pub struct SolvedSurface {
    /// The whole region first, then its bays.
    pub accounts: Vec<VolumeAccount>,
    /// The surface; its σ is the cells' own where the marginals were not asked for.
    pub surface: HeightMap,
    /// How each cell of the surface is known.
    pub coverage: Vec<CellCoverage>,
    /// Beams that hit something, but not the surface: dust, edges, machines.
    pub n_beams_refused: u64,
    /// Ground that something has covered or changed since it was last seen, the largest area first.
    pub disturbed: Vec<DisturbedArea>,
    /// Ground that was left out, the gap with the largest share of the variance first.
    pub gaps: Vec<Gap>,
    /// Where the next solve of a field starts.
    pub newest: Option<Arc<NewestField>>,
}

/// The heights of the cells as the newest surface has them.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownHeights {
    /// Where the cells are.
    pub grid: GridGeometry,
    /// Height of each cell, m; what is expected where nothing was seen.
    pub height_m: Vec<f64>,
    /// Cells that rest on data.
    pub is_known: Vec<bool>,
    /// Standard deviation of the height of each cell that does not, m.
    pub sigma_m: Vec<f64>,
    /// The height that each cell stays below, since rays have passed over it, m; infinite without any.
    pub ceiling_m: Vec<f64>,
    /// Height of the highest cell that is known, m.
    pub highest_m: f64,
    /// No ground is lower than this, m; minus infinity if nothing is known of that.
    pub floor_m: f64,
}

impl KnownHeights {
    /// Heights over which no ray has passed, with no floor; cells that are not known have this σ, m.
    #[must_use]
    pub fn new(
        grid: GridGeometry,
        height_m: Vec<f64>,
        is_known: Vec<bool>,
        unknown_sigma_m: f64,
    ) -> Self {
        let n_cells = height_m.len();
        let sigma_m = vec![unknown_sigma_m; n_cells];
        let ceiling_m = vec![f64::INFINITY; n_cells];
        let known_m = std::iter::zip(&height_m, &is_known).filter(|(_, is_known)| **is_known);
        let highest_m = known_m.map(|(h, _)| *h).fold(f64::NEG_INFINITY, f64::max);
        let floor_m = f64::NEG_INFINITY;
        Self { grid, height_m, is_known, sigma_m, ceiling_m, highest_m, floor_m }
    }
}

impl SolveSurface {
    /// The newest heights; `None` before there are any.
    #[must_use]
    pub fn known_heights(&self) -> Option<KnownHeights> {
        match self {
            Self::KalmanGrid(work) => Some(work.known_heights()),
            Self::MaternField(work) => work.known_heights(),
        }
    }

    /// The same work for one volume instead of those of the bays: what lies over the hall's zero on these
    /// areas of the cells, m², taken at the cells' centres. Its account knows of no base.
    #[must_use]
    pub fn over_cells(&self, cell_areas_m2: &[f64]) -> Self {
        let bays = |grid: &GridGeometry| {
            let counting = cell_areas_m2.iter().enumerate().filter(|(_, area)| **area > 0.0);
            Arc::new(vec![BayOnGrid {
                name: WHOLE_REGION.to_owned(),
                base: Base::level(0.0, cell_areas_m2.to_vec()),
                areas: counting.map(|(cell, area)| (grid.centre_m(cell), *area)).collect(),
                is_over_survey: true,
                density: None,
            }])
        };
        match self {
            Self::KalmanGrid(work) => Self::KalmanGrid(Box::new(work.over(bays(work.geometry())))),
            Self::MaternField(work) => Self::MaternField(Box::new(work.over(bays(work.grid())))),
        }
    }

    /// Solves.
    ///
    /// # Errors
    /// [`SolveError`] from the method.
    pub fn run(&self) -> Result<SolvedSurface, SolveError> {
        Ok(match self {
            Self::KalmanGrid(work) => work.run()?,
            Self::MaternField(work) => work.run()?,
        })
    }
}
