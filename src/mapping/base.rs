//! What material lies on: the height of the base under a bay, and how sure it is.
//!
//! ```text
//! V = Σ_c w_c (h_c − b_c),     ∂V/∂e = −Σ_c w_c ∂b_c/∂e     for every error e of the base
//! ```
//! - `w_c`: area of the bay in cell c, m²; `h_c`: surface, m; `b_c`: base, m
//!
//! A surface below its base counts as it is, negative: cutting it off would turn the noise of an
//! empty floor into material.
//!
//! The errors of a base are constant: two surveys over the same base share them all, and they
//! cancel in the difference.
//! Checked: `bay::tests`, by closed forms and by moved bases.

use super::clip::Part;
use super::polygon::Place;
use super::surveyed_base::SurveyedBase;
use super::triangulated_base::TriangulatedBase;

/// A tilted plane z = height + slope · (place − pivot).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Where `height_m` holds, x and y, m.
    pub pivot_m: Place,
    /// Height at the pivot, m.
    pub height_m: f64,
    /// Slope along x and along y, m/m.
    pub slope: (f64, f64),
    /// Standard deviation of the height at the pivot, m.
    pub sigma_m: f64,
    /// Standard deviation of either slope, no unit.
    pub slope_sigma: f64,
}

/// The base under a bay.
#[derive(Debug, Clone, PartialEq)]
pub enum BaseSurface {
    /// The same height everywhere.
    Level {
        /// Height, m.
        height_m: f64,
        /// Its standard deviation, m.
        sigma_m: f64,
    },
    /// A tilted plane.
    Plane(Plane),
    /// The heights of an earlier survey.
    Survey(SurveyedBase),
    /// Triangles between measured points, such as the outline on a bare floor.
    Triangulated(TriangulatedBase),
}

/// One constant error of a base: ∂V/∂e and the standard deviation of e, in reciprocal units that
/// make their product m³. What [`push_shared`](crate::messages::VolumeBudget::push_shared) takes.
pub type BaseError = (f64, f64);

impl BaseSurface {
    /// A level known exactly.
    #[must_use]
    pub const fn level(height_m: f64) -> Self {
        Self::Level { height_m, sigma_m: 0.0 }
    }

    /// Its height at a place, m.
    #[must_use]
    pub fn height_m(&self, x_m: f64, y_m: f64) -> f64 {
        match self {
            Self::Level { height_m, .. } => *height_m,
            Self::Plane(plane) => {
                let (dx, dy) = (x_m - plane.pivot_m.0, y_m - plane.pivot_m.1);
                plane.height_m + plane.slope.0 * dx + plane.slope.1 * dy
            }
            Self::Survey(survey) => survey.height_m(x_m, y_m),
            Self::Triangulated(triangles) => triangles.height_m(x_m, y_m),
        }
    }

    /// True if the base is known at a place; only an earlier survey may have gaps.
    #[must_use]
    pub fn has_height(&self, x_m: f64, y_m: f64) -> bool {
        match self {
            Self::Survey(survey) => survey.has_height(x_m, y_m),
            Self::Level { .. } | Self::Plane(_) | Self::Triangulated(_) => true,
        }
    }

    /// Where the base of a cell is taken, of which only a part counts.
    ///
    /// The centroid of the part, so that planes are integrated exactly; of an earlier survey the
    /// centre of the cell, so that an unchanged surface has no volume over itself.
    #[must_use]
    pub const fn place_m(&self, cell_centre_m: Place, part: &Part) -> Place {
        match self {
            Self::Survey(_) => cell_centre_m,
            Self::Level { .. } | Self::Plane(_) | Self::Triangulated(_) => part.centroid_m,
        }
    }

    /// The constant errors of the volume over this base, for areas taken at places: first the
    /// level, which all kinds have, then those of the kind.
    ///
    /// - plane: the slopes along x and y
    /// - survey: its cells' own errors, which are independent, as one
    /// - triangles: every point's own error
    #[must_use]
    pub fn errors(&self, areas: &[(Place, f64)]) -> Vec<BaseError> {
        let area_m2: f64 = areas.iter().map(|(_, area)| area).sum();
        match self {
            Self::Level { sigma_m, .. } => vec![(-area_m2, *sigma_m)],
            Self::Plane(plane) => {
                let moment = |of: fn(&Place) -> f64| -> f64 {
                    areas.iter().map(|(p, area)| area * (of(p) - of(&plane.pivot_m))).sum()
                };
                vec![
                    (-area_m2, plane.sigma_m),
                    (-moment(|p| p.0), plane.slope_sigma),
                    (-moment(|p| p.1), plane.slope_sigma),
                ]
            }
            Self::Survey(survey) => {
                vec![(-area_m2, survey.sigma_m()), (-1.0, survey.cells_sigma_m3(areas))]
            }
            Self::Triangulated(triangles) => {
                let mut errors = vec![(-area_m2, triangles.sigma_m())];
                errors.extend(triangles.point_errors(areas));
                errors
            }
        }
    }

    /// The variance that each cell's base has of its own, beside what is common to all cells, m².
    #[must_use]
    pub fn own_var_m2(&self, x_m: f64, y_m: f64) -> f64 {
        match self {
            Self::Level { .. } | Self::Plane(_) => 0.0,
            Self::Survey(survey) => survey.own_var_m2(x_m, y_m),
            Self::Triangulated(triangles) => triangles.own_var_m2(x_m, y_m),
        }
    }
}
