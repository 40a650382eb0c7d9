//! Bays: parts of the region that are measured for themselves.

use super::base::BaseSurface;
use super::clip::part_of;
use super::density::Density;
use super::polygon::{Place, Polygon};
use super::rect::Rect;
use super::region::Region;
use super::shares::SeenCells;
use super::volume::Base;
use crate::messages::{GridGeometry, VolumeAccount, VolumeBudget, VolumeEstimate};
use crate::time::{Mono, Stamp};

/// A part of the region with a base and a material of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Bay {
    /// Its name, unique in the hall.
    pub name: String,
    /// Its outline on the floor.
    pub outline: Polygon,
    /// What the material lies on.
    pub base: BaseSurface,
    /// The material's bulk density, if tonnes are wanted.
    pub density: Option<Density>,
}

/// The name of the bay that is the whole region, where none is given.
pub const WHOLE_REGION: &str = "hall";

/// A bay on the cells of a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct BayOnGrid {
    /// Its name.
    pub name: String,
    /// The area of the bay in each cell without the exclusions, the base under it, and its errors.
    pub base: Base,
    /// Where the base was taken, and the area of the bay there, m²: one entry per cell that counts.
    pub areas: Vec<(Place, f64)>,
    /// The base is an earlier survey's, one height per cell.
    pub is_over_survey: bool,
    /// The material's bulk density, if tonnes are wanted.
    pub density: Option<Density>,
}

/// Why bays cannot be measured.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BayError {
    /// Two bays have the same name, or one of several that of the whole hall.
    #[error("two bays are called {name:?}, or a bay and the hall")]
    SameName {
        /// The name.
        name: String,
    },
    /// Two bays share ground.
    #[error("bays {first:?} and {second:?} overlap by {overlap_m2:.3} m²")]
    Overlap {
        /// The one.
        first: String,
        /// The other.
        second: String,
        /// The area that both claim, m².
        overlap_m2: f64,
    },
    /// A bay reaches out of the region.
    #[error("bay {name:?} reaches out of the region by {outside_m2:.3} m²")]
    OutsideRegion {
        /// Which bay.
        name: String,
        /// The area beyond the region, m².
        outside_m2: f64,
    },
    /// Nothing is left of a bay.
    #[error("bay {name:?} lies in exclusions altogether")]
    Empty {
        /// Which bay.
        name: String,
    },
    /// The earlier survey has no height under a bay.
    #[error("the base of bay {name:?} has no height at x = {x_m:.2} m, y = {y_m:.2} m")]
    BaseMissing {
        /// Which bay.
        name: String,
        /// Where, m.
        x_m: f64,
        /// Where, m.
        y_m: f64,
    },
}

/// Less than this between two borders is rounding of their corners, m²: 10 m of 0.1 mm.
const SLIVER_M2: f64 = 1e-3;

/// Checks that names are unique, and that bays lie in the region and do not overlap.
///
/// # Errors
/// The first bay that does not fit, with the area in question.
pub fn check_outlines(bays: &[Bay], bounds: &Rect) -> Result<(), BayError> {
    for (i, bay) in bays.iter().enumerate() {
        // The hall's own total stands beside several bays.
        if bays.len() > 1 && bay.name == WHOLE_REGION {
            return Err(BayError::SameName { name: bay.name.clone() });
        }
        let outside_m2 =
            part_of(bay.outline.bounds(), &[&bay.outline], &[&Polygon::from(*bounds)]).area_m2;
        if outside_m2 > SLIVER_M2 {
            return Err(BayError::OutsideRegion { name: bay.name.clone(), outside_m2 });
        }
        for other in &bays[..i] {
            if other.name == bay.name {
                return Err(BayError::SameName { name: bay.name.clone() });
            }
            let both = [&other.outline, &bay.outline];
            let overlap_m2 = part_of(bay.outline.bounds(), &both, &[]).area_m2;
            if overlap_m2 > SLIVER_M2 {
                let (first, second) = (other.name.clone(), bay.name.clone());
                return Err(BayError::Overlap { first, second, overlap_m2 });
            }
        }
    }
    Ok(())
}

impl Bay {
    /// The bay on a grid, without what stands in the region and without ground that has no base.
    #[must_use]
    pub fn on_grid(&self, region: &Region, grid: &GridGeometry) -> BayOnGrid {
        let mut base = Base::level(0.0, vec![0.0; grid.n_cells()]);
        let mut areas = Vec::new();
        for (cell, part) in region.parts_of(&self.outline, grid) {
            let place = self.base.place_m(grid.centre_m(cell), &part);
            if self.base.has_height(place.0, place.1) {
                base.cell_areas_m2[cell] = part.area_m2;
                base.cell_base_m[cell] = self.base.height_m(place.0, place.1);
                areas.push((place, part.area_m2));
            }
        }
        base.errors = self.base.errors(&areas);
        let is_over_survey = matches!(self.base, BaseSurface::Survey(_));
        BayOnGrid { name: self.name.clone(), base, areas, is_over_survey, density: self.density }
    }

    /// Checks that something is left of the bay and that its base is known everywhere.
    ///
    /// # Errors
    /// [`BayError::Empty`] or [`BayError::BaseMissing`].
    pub fn check_ground(&self, region: &Region, grid: &GridGeometry) -> Result<(), BayError> {
        let parts = region.parts_of(&self.outline, grid);
        if parts.is_empty() {
            return Err(BayError::Empty { name: self.name.clone() });
        }
        let places = parts.iter().map(|(cell, part)| self.base.place_m(grid.centre_m(*cell), part));
        let missing = places.into_iter().find(|(x_m, y_m)| !self.base.has_height(*x_m, *y_m));
        missing.map_or(Ok(()), |(x_m, y_m)| {
            Err(BayError::BaseMissing { name: self.name.clone(), x_m, y_m })
        })
    }
}

impl BayOnGrid {
    /// The account of this bay's volume, m³, under a surface of one height per cell, m; `budget`
    /// itemises its variance, and the density's row is added here.
    ///
    /// `range_m` is how far a seen cell speaks for its neighbours.
    #[must_use]
    pub fn account(
        &self,
        at: Stamp<Mono>,
        (volume_m3, surface_m): (f64, &[f64]),
        mut budget: VolumeBudget,
        seen: &SeenCells,
        range_m: f64,
    ) -> VolumeAccount {
        let base = &self.base;
        let sigma_m3 = budget.var_m6().max(0.0).sqrt();
        if let Some(density) = &self.density {
            budget.rows.push(density.budget_row(volume_m3, sigma_m3));
        }
        let thickness_m = base.thickness_m(surface_m);
        VolumeAccount {
            name: self.name.clone(),
            estimate: VolumeEstimate {
                at,
                volume_m3,
                sigma_m3,
                coverage_ratio: base.area_share(|cell| seen.is_hit(cell)),
            },
            mass: self.density.map(|density| density.mass(volume_m3, sigma_m3)),
            budget,
            shares: seen.shares(&base.cell_areas_m2, &thickness_m, range_m),
        }
    }
}

#[cfg(test)]
mod tests;
