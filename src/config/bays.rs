//! Bays, their bases and exclusions: the file's twin and the way to the region's settings.

use super::ascii_grid::{self, AsciiGrid};
use super::convert::{invalid, rect, within};
use super::error::ConfigError;
use super::file::{Config, RectSection};
use crate::mapping::base::{BaseSurface, Plane};
use crate::mapping::bay::{Bay, WHOLE_REGION};
use crate::mapping::density::Density;
use crate::mapping::polygon::{Place, Polygon};
use crate::mapping::region::{Footprint, Rect, Region};
use crate::mapping::surveyed_base::SurveyedBase;
use crate::mapping::triangulated_base::TriangulatedBase;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A part of the region that is measured for itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaySection {
    /// Its name, unique in the hall.
    pub name: String,
    /// Corners of its outline, x and y, in either direction, m. Bays may touch, not overlap.
    pub polygon_m: Vec<[f64; 2]>,
    /// What the material lies on; the hall's base if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base: Option<BaseSection>,
    /// Bulk density, t/m³; without it there are no tonnes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density_t_per_m3: Option<f64>,
    /// Its standard deviation, t/m³; exact if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density_sigma_t_per_m3: Option<f64>,
    /// How the density was found, in words for the report.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density_source: Option<String>,
    /// When, year-month-day.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub density_date: Option<String>,
    /// How moist the material was then, in words for the report.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moisture: Option<String>,
    /// What lies there; its id in reports and books is made from this.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<String>,
}

/// The base under a bay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum BaseSection {
    /// The same height everywhere.
    Level {
        /// Height over the hall's zero, m.
        height_m: f64,
        /// Its standard deviation, m.
        #[serde(default = "default_base_sigma_m")]
        sigma_m: f64,
    },
    /// A tilted plane.
    Plane {
        /// Where `height_m` holds, x and y, m.
        pivot_m: [f64; 2],
        /// Height there, m.
        height_m: f64,
        /// Slope along x and y, m/m.
        slope: [f64; 2],
        /// Standard deviation of the height, m.
        #[serde(default = "default_base_sigma_m")]
        sigma_m: f64,
        /// Standard deviation of either slope, m/m.
        #[serde(default)]
        slope_sigma: f64,
    },
    /// An earlier survey, as ASCII grids.
    Survey {
        /// The file with the heights, m; relative to the configuration file.
        height_file: PathBuf,
        /// The file with the standard deviation of each cell, m.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_file: Option<PathBuf>,
        /// Standard deviation of every cell if there is no such file, m.
        #[serde(default)]
        cell_sigma_m: f64,
        /// Standard deviation of an error common to all cells, m.
        #[serde(default = "default_base_sigma_m")]
        sigma_m: f64,
        /// What the height file holds. Filled in when the configuration is loaded, so that a log
        /// needs no other file.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_grid: Option<String>,
        /// What the file of standard deviations holds.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_grid: Option<String>,
    },
    /// Triangles between measured points, such as the outline on the bare floor.
    Triangulated {
        /// The points x, y, z, m; outside of their hull its nearest point counts.
        points_m: Vec<[f64; 3]>,
        /// Standard deviation of an error common to all points, m.
        #[serde(default = "default_base_sigma_m")]
        sigma_m: f64,
        /// Standard deviation of each point's own error, m.
        #[serde(default)]
        point_sigma_m: f64,
    },
}

/// 1 cm: a floor that nobody has levelled is not known better.
pub(super) const fn default_base_sigma_m() -> f64 {
    0.01
}

/// Something in the region that is not material: exactly one of a rectangle and a polygon.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExclusionSection {
    /// A rectangle along the hall's axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rect: Option<RectSection>,
    /// Corners of any simple polygon, x and y, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub polygon_m: Option<Vec<[f64; 2]>>,
}

impl Config {
    /// Reads the grids that bases and the meshes that obstacles name into the configuration; `folder` is where relative paths
    /// begin. What is there already stays.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn read_files(&mut self, folder: &Path) -> Result<(), ConfigError> {
        let bases = self.bays.iter_mut().filter_map(|bay| bay.base.as_mut());
        for base in bases.chain(&mut self.hall.base) {
            let BaseSection::Survey { height_file, sigma_file, height_grid, sigma_grid, .. } = base
            else {
                continue;
            };
            fill(height_grid, Some(height_file), folder)?;
            fill(sigma_grid, sigma_file.as_ref(), folder)?;
        }
        self.read_meshes(folder)
    }

    /// The region that a survey with this configuration measures: its bays, and what of it does not
    /// count, obstacles that stand on the floor included.
    ///
    /// # Errors
    /// Any part of it that is no ground.
    pub fn measured_region(&self) -> Result<Region, ConfigError> {
        self.region(within("surface.cell_m", self.surface.cell_m, (0.05, 5.0), "m")?)
    }

    /// The region with its bays and exclusions, checked against each other on cells of `cell_m`.
    pub(super) fn region(&self, cell_m: f64) -> Result<Region, ConfigError> {
        let hall = &self.hall;
        let bounds = rect("hall.region", &hall.region)?;
        let mut exclusions = Vec::new();
        for section in &hall.exclusions {
            exclusions.push(Footprint::Rect(rect("hall.exclusions", section)?));
        }
        for (index, section) in self.exclusions.iter().enumerate() {
            exclusions.push(footprint(&format!("exclusions[{index}]"), section)?);
        }
        exclusions.extend(self.standing_footprints()?);
        let margin_key = "hall.exclusion_margin_m";
        let region = Region {
            bounds,
            exclusions,
            exclusion_margin_m: within(margin_key, hall.exclusion_margin_m, (0.0, 2.0), "m")?,
            bays: self.bays(&bounds)?,
        };
        let grid = region.grid(cell_m);
        region.check_bays(&grid).map_err(|error| invalid("bays", error.to_string()))?;
        Ok(region)
    }

    fn bays(&self, bounds: &Rect) -> Result<Vec<Bay>, ConfigError> {
        let hall_base = self.hall_base()?;
        let of_hall = (self.hall.density_t_per_m3, self.hall.density_sigma_t_per_m3);
        let hall_density = density("hall", of_hall)?;
        if self.bays.is_empty() {
            let outline = Polygon::from(*bounds);
            let name = WHOLE_REGION.to_owned();
            return Ok(vec![Bay { name, outline, base: hall_base, density: hall_density }]);
        }
        if hall_density.is_some() {
            let message = "is for a hall without bays: give each of the bays its own";
            return Err(invalid("hall.density_t_per_m3", message));
        }
        let bay = |(index, section): (usize, &BaySection)| {
            let key = format!("bays[{index}]");
            check_words(&key, section)?;
            Ok(Bay {
                name: section.name.clone(),
                outline: polygon(&format!("{key}.polygon_m"), &section.polygon_m)?,
                base: match &section.base {
                    Some(base) => base_surface(&format!("{key}.base"), base)?,
                    None => hall_base.clone(),
                },
                density: density(&key, (section.density_t_per_m3, section.density_sigma_t_per_m3))?,
            })
        };
        self.bays.iter().enumerate().map(bay).collect()
    }

    fn hall_base(&self) -> Result<BaseSurface, ConfigError> {
        let hall = &self.hall;
        let range_m = (-100.0, hall.max_pile_height_m);
        let height_m = within("hall.base_height_m", hall.base_height_m, range_m, "m")?;
        let sigma_m = sigma("hall.base_sigma_m", hall.base_sigma_m)?;
        match &hall.base {
            None => Ok(BaseSurface::Level { height_m, sigma_m }),
            Some(_) if hall.base_height_m != 0.0 => {
                Err(invalid("hall.base", "stands beside hall.base_height_m: give one of them"))
            }
            Some(base) => base_surface("hall.base", base),
        }
    }
}

fn fill(
    grid: &mut Option<String>,
    file: Option<&PathBuf>,
    folder: &Path,
) -> Result<(), ConfigError> {
    if let (None, Some(file)) = (&grid, file) {
        let path = folder.join(file);
        let read = std::fs::read_to_string(&path);
        *grid = Some(read.map_err(|source| ConfigError::Unreadable { path, source })?);
    }
    Ok(())
}

/// A standard deviation of a height, m.
fn sigma(key: &str, value: f64) -> Result<f64, ConfigError> {
    within(key, value, (0.0, 10.0), "m")
}

pub(super) fn place(key: &str, [x_m, y_m]: [f64; 2]) -> Result<Place, ConfigError> {
    let coordinate = |value| within(key, value, (-10_000.0, 10_000.0), "m");
    Ok((coordinate(x_m)?, coordinate(y_m)?))
}

fn height(key: &str, value: f64) -> Result<f64, ConfigError> {
    within(key, value, (-100.0, 100.0), "m")
}

pub(super) fn polygon(key: &str, corners_m: &[[f64; 2]]) -> Result<Polygon, ConfigError> {
    let corners = corners_m.iter().map(|corner| place(key, *corner));
    let corners: Vec<Place> = corners.collect::<Result<_, _>>()?;
    Polygon::new(&corners).map_err(|error| invalid(key, error.to_string()))
}

fn footprint(key: &str, section: &ExclusionSection) -> Result<Footprint, ConfigError> {
    match (&section.rect, &section.polygon_m) {
        (Some(section), None) => rect(&format!("{key}.rect"), section).map(Footprint::Rect),
        (None, Some(corners)) => {
            polygon(&format!("{key}.polygon_m"), corners).map(Footprint::Polygon)
        }
        _ => Err(invalid(key, "give either rect or polygon_m")),
    }
}

/// Checks what is said of the density and its material.
fn check_words(key: &str, section: &BaySection) -> Result<(), ConfigError> {
    let of_density = [
        ("density_source", &section.density_source),
        ("density_date", &section.density_date),
        ("moisture", &section.moisture),
    ];
    for (name, value) in of_density.into_iter().chain([("material", &section.material)]) {
        let Some(value) = value else { continue };
        let of = format!("{key}.{name}");
        if value.trim().is_empty() || value.chars().any(char::is_control) {
            return Err(invalid(&of, "is empty or holds a control character"));
        }
        if name != "material" && section.density_t_per_m3.is_none() {
            return Err(invalid(&of, "there is no density_t_per_m3 that it belongs to"));
        }
    }
    match &section.density_date {
        Some(date) if date.parse::<jiff::civil::Date>().is_err() => {
            let key = format!("{key}.density_date");
            Err(invalid(&key, format!("{date:?} is no date such as 2026-03-01")))
        }
        _ => Ok(()),
    }
}

fn density(
    key: &str,
    (mean_t_per_m3, sigma_t_per_m3): (Option<f64>, Option<f64>),
) -> Result<Option<Density>, ConfigError> {
    let (mean_key, sigma_key) =
        (format!("{key}.density_t_per_m3"), format!("{key}.density_sigma_t_per_m3"));
    let Some(mean_t_per_m3) = mean_t_per_m3 else {
        let message = "there is no density_t_per_m3 that it belongs to";
        return sigma_t_per_m3.map_or(Ok(None), |_| Err(invalid(&sigma_key, message)));
    };
    let mean_t_per_m3 = within(&mean_key, mean_t_per_m3, (0.01, 25.0), "t/m³")?;
    let sigma = sigma_t_per_m3.unwrap_or(0.0);
    let sigma_t_per_m3 = within(&sigma_key, sigma, (0.0, mean_t_per_m3), "t/m³")?;
    Ok(Some(Density { mean_t_per_m3, sigma_t_per_m3 }))
}

fn base_surface(key: &str, base: &BaseSection) -> Result<BaseSurface, ConfigError> {
    let of = |name: &str| format!("{key}.{name}");
    match base {
        BaseSection::Level { height_m, sigma_m } => Ok(BaseSurface::Level {
            height_m: height(&of("height_m"), *height_m)?,
            sigma_m: sigma(&of("sigma_m"), *sigma_m)?,
        }),
        BaseSection::Plane { pivot_m, height_m, slope, sigma_m, slope_sigma } => {
            let steepness = |name, value| within(&of(name), value, (-2.0, 2.0), "");
            Ok(BaseSurface::Plane(Plane {
                pivot_m: place(&of("pivot_m"), *pivot_m)?,
                height_m: height(&of("height_m"), *height_m)?,
                slope: (steepness("slope", slope[0])?, steepness("slope", slope[1])?),
                sigma_m: sigma(&of("sigma_m"), *sigma_m)?,
                slope_sigma: within(&of("slope_sigma"), *slope_sigma, (0.0, 1.0), "")?,
            }))
        }
        BaseSection::Triangulated { points_m, sigma_m, point_sigma_m } => {
            for [x_m, y_m, z_m] in points_m {
                place(&of("points_m"), [*x_m, *y_m])?;
                height(&of("points_m"), *z_m)?;
            }
            let sigma_m = sigma(&of("sigma_m"), *sigma_m)?;
            let point_sigma_m = sigma(&of("point_sigma_m"), *point_sigma_m)?;
            TriangulatedBase::new(points_m.clone(), sigma_m, point_sigma_m)
                .map(BaseSurface::Triangulated)
                .map_err(|error| invalid(&of("points_m"), error.to_string()))
        }
        BaseSection::Survey { .. } => surveyed(key, base).map(BaseSurface::Survey),
    }
}

fn surveyed(key: &str, base: &BaseSection) -> Result<SurveyedBase, ConfigError> {
    let BaseSection::Survey { sigma_file, cell_sigma_m, sigma_m, height_grid, sigma_grid, .. } =
        base
    else {
        return Err(invalid(key, "is not a survey"));
    };
    let of = |name: &str| format!("{key}.{name}");
    let read = |name: &str, text: &Option<String>| -> Result<AsciiGrid, ConfigError> {
        let text = text.as_ref().ok_or_else(|| invalid(&of(name), "the file is not read yet"))?;
        ascii_grid::parse(text).map_err(|error| invalid(&of(name), error.to_string()))
    };
    let heights = read("height_file", height_grid)?;
    let cell_sigma_m = if sigma_file.is_some() || sigma_grid.is_some() {
        let sigmas = read("sigma_file", sigma_grid)?;
        if sigmas.grid != heights.grid {
            return Err(invalid(&of("sigma_file"), "its grid is not that of the heights"));
        }
        if *cell_sigma_m != 0.0 {
            return Err(invalid(&of("cell_sigma_m"), "stands beside sigma_file: give one of them"));
        }
        sigmas.values
    } else {
        vec![sigma(&of("cell_sigma_m"), *cell_sigma_m)?; heights.grid.n_cells()]
    };
    for height_m in heights.values.iter().filter(|height_m| height_m.is_finite()) {
        height(&of("height_file"), *height_m)?;
    }
    let sigma_m = sigma(&of("sigma_m"), *sigma_m)?;
    SurveyedBase::new(heights.grid, heights.values, cell_sigma_m, sigma_m)
        .map_err(|error| invalid(&of("sigma_file"), error.to_string()))
}

#[cfg(test)]
mod tests;
