//! What the vehicle keeps away from: obstacles, walls, ceiling and fence. The file's twin and the way
//! to the settings.

use super::bays::{place, polygon};
use super::convert::{invalid, within};
use super::error::ConfigError;
use super::file::Config;
use super::mesh_file::{self, MeshContent};
use crate::geometry::{Hall, Point, Rotation, Transform};
use crate::mapping::region::Footprint;
use crate::mapping::solid::{Mesh, Prism, Solid};
use crate::planning::space::{Fence, SpaceSettings};
use crate::units::rad_from_deg;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Something solid in the hall that the vehicle must not touch.
///
/// Its echoes are no material. One that stands on the floor also takes its footprint out of what is
/// measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ObstacleSection {
    /// A box.
    Box {
        /// Its middle in the hall, m.
        centre_m: [f64; 3],
        /// Its edges along its own x, y and z, m.
        size_m: [f64; 3],
        /// Turned by this about the vertical, from x towards y, deg.
        #[serde(default)]
        yaw_deg: f64,
    },
    /// An upright prism.
    Prism {
        /// Corners of its footprint, x and y, in either direction, m.
        polygon_m: Vec<[f64; 2]>,
        /// Its lowest and highest height over the hall's zero, m.
        heights_m: [f64; 2],
    },
    /// Triangles of a file.
    Mesh {
        /// STL (text or binary) or OBJ, by its ending; relative to the configuration file.
        file: PathBuf,
        /// Metres per unit of the file.
        #[serde(default = "default_scale")]
        scale: f64,
        /// Where the file's origin is in the hall, m.
        #[serde(default)]
        place_m: [f64; 3],
        /// Roll, pitch, yaw of the file's axes, applied as yaw, then pitch, then roll, deg.
        #[serde(default)]
        rotation_deg: [f64; 3],
        /// What the file holds. Filled in when the configuration is loaded, so that a log needs no
        /// other file.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        content: Option<MeshContent>,
    },
}

const fn default_scale() -> f64 {
    1.0
}

/// Where the vehicle may be at most.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FenceSection {
    /// Corners of its outline, x and y, in either direction, m; no limit sideways if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub polygon_m: Option<Vec<[f64; 2]>>,
    /// Lowest height of the flight over the hall's zero, m; take-off and landing are not judged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_height_m: Option<f64>,
    /// Highest height of the flight over the hall's zero, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_height_m: Option<f64>,
}

/// The grid of the free space and the room around the vehicle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SpaceSection {
    /// Distance of neighbouring places of the grid, along x and y, m.
    pub grid_m: f64,
    /// Distance of neighbouring heights of the grid, m.
    pub height_step_m: f64,
    /// Headings of the grid, evenly around.
    pub n_headings: usize,
    /// Radius of a ball about the body's origin that holds the whole vehicle, m.
    pub vehicle_radius_m: f64,
    /// Free room between that ball and walls, ceiling and obstacles, m.
    pub margin_m: f64,
    /// Free room between that ball and the surface below, m.
    pub surface_clearance_m: f64,
}

impl Default for SpaceSection {
    fn default() -> Self {
        Self {
            grid_m: 1.0,
            height_step_m: 1.0,
            n_headings: 8,
            vehicle_radius_m: 0.3,
            margin_m: 0.2,
            surface_clearance_m: 0.2,
        }
    }
}

/// An obstacle that reaches this near to the floor stands on it, m.
const ON_FLOOR_M: f64 = 0.1;
/// The grid has no more nodes than this.
const MAX_NODES: f64 = 1e6;

impl Config {
    /// Reads the files that obstacles name into the configuration; `folder` is where relative paths
    /// begin. What is there already stays.
    ///
    /// # Errors
    /// A file that cannot be read, or that holds no mesh.
    pub(super) fn read_meshes(&mut self, folder: &Path) -> Result<(), ConfigError> {
        for (index, section) in self.obstacles.iter_mut().enumerate() {
            if let ObstacleSection::Mesh { file, content: content @ None, .. } = section {
                let key = format!("obstacles[{index}].file");
                *content = Some(mesh_file::read(&key, &folder.join(file))?);
            }
        }
        Ok(())
    }

    pub(super) fn solids(&self) -> Result<Vec<Solid>, ConfigError> {
        let sections = self.obstacles.iter().enumerate();
        sections.map(|(index, section)| solid(&format!("obstacles[{index}]"), section)).collect()
    }

    /// Footprints of the obstacles that stand on the floor; a mesh leaves none.
    pub(super) fn standing_footprints(&self) -> Result<Vec<Footprint>, ConfigError> {
        let floor_m = self.hall.base_height_m + ON_FLOOR_M;
        let footprint = |solid: Solid| match solid {
            Solid::Prism(prism) if prism.heights_m().0 <= floor_m => {
                Some(Footprint::Polygon(prism.footprint().clone()))
            }
            Solid::Prism(_) | Solid::Mesh(_) => None,
        };
        Ok(self.solids()?.into_iter().filter_map(footprint).collect())
    }

    pub(super) fn space_settings(&self) -> Result<SpaceSettings, ConfigError> {
        let (s, hall) = (&self.planning.space, &self.hall);
        let metres =
            |name: &str, value, range| within(&format!("planning.space.{name}"), value, range, "m");
        #[expect(clippy::cast_precision_loss, reason = "only its size is judged")]
        within("planning.space.n_headings", s.n_headings as f64, (1.0, 72.0), "")?;
        let walls = hall.walls_m.as_ref().map(|corners| polygon("hall.walls_m", corners));
        let ceiling_m = hall
            .ceiling_m
            .map(|value| within("hall.ceiling_m", value, (hall.max_pile_height_m, 200.0), "m"));
        Ok(SpaceSettings {
            grid_m: metres("grid_m", s.grid_m, (0.1, 20.0))?,
            height_step_m: metres("height_step_m", s.height_step_m, (0.1, 20.0))?,
            n_headings: s.n_headings,
            vehicle_radius_m: metres("vehicle_radius_m", s.vehicle_radius_m, (0.05, 5.0))?,
            margin_m: metres("margin_m", s.margin_m, (0.0, 10.0))?,
            surface_clearance_m: metres("surface_clearance_m", s.surface_clearance_m, (0.0, 10.0))?,
            highest_surface_m: Some(hall.max_pile_height_m),
            walls: walls.transpose()?,
            ceiling_m: ceiling_m.transpose()?,
            obstacles: self.solids()?,
            fence: self.fence.as_ref().map(fence).transpose()?,
        })
    }

    /// The flight's height and the grid fit into the hall.
    pub(super) fn check_space(&self, space: &SpaceSettings) -> Result<(), ConfigError> {
        let height_m = self.planning.height_m;
        let keep_off_m = space.vehicle_radius_m + space.margin_m;
        let highest_m = space.ceiling_m.map_or(f64::INFINITY, |ceiling_m| ceiling_m - keep_off_m);
        if height_m > highest_m {
            let message = format!(
                "{height_m} m is too near to the ceiling: with vehicle_radius_m and margin_m, \
                 {highest_m} m is the highest"
            );
            return Err(invalid("planning.height_m", message));
        }
        if let Some(fence) = &space.fence {
            let range_m = (fence.min_height_m, fence.max_height_m);
            within("planning.height_m inside the fence", height_m, range_m, "m")?;
        }
        let outline =
            space.walls.as_ref().or(space.fence.as_ref().and_then(|f| f.outline.as_ref()));
        let hall = &self.hall.region;
        let (width_m, depth_m) = outline.map_or(
            (hall.x_max_m - hall.x_min_m + 10.0, hall.y_max_m - hall.y_min_m + 10.0),
            |outline| outline.bounds().size_m(),
        );
        let top_m = if highest_m.is_finite() { highest_m } else { height_m };
        let n_heights = (top_m - self.hall.max_pile_height_m).max(0.0) / space.height_step_m + 1.0;
        let n_places = (width_m / space.grid_m + 1.0) * (depth_m / space.grid_m + 1.0);
        #[expect(clippy::cast_precision_loss, reason = "only its size is judged")]
        let n_nodes = n_places * n_heights * space.n_headings as f64;
        within("nodes of the free space's grid", n_nodes, (1.0, MAX_NODES), "")?;
        Ok(())
    }
}

fn fence(section: &FenceSection) -> Result<Fence, ConfigError> {
    let outline = section.polygon_m.as_ref().map(|corners| polygon("fence.polygon_m", corners));
    let min_m = section.min_height_m.unwrap_or(-100.0);
    let min_height_m = within("fence.min_height_m", min_m, (-100.0, 200.0), "m")?;
    let max_m = section.max_height_m.unwrap_or(200.0);
    Ok(Fence {
        outline: outline.transpose()?,
        min_height_m,
        max_height_m: within("fence.max_height_m", max_m, (min_height_m, 200.0), "m")?,
    })
}

fn solid(key: &str, section: &ObstacleSection) -> Result<Solid, ConfigError> {
    let of = |name: &str| format!("{key}.{name}");
    match section {
        ObstacleSection::Box { centre_m, size_m, yaw_deg } => {
            let centre_m = place_in_hall(&of("centre_m"), *centre_m)?;
            for edge_m in size_m {
                within(&of("size_m"), *edge_m, (1e-3, 1000.0), "m")?;
            }
            let yaw_deg = within(&of("yaw_deg"), *yaw_deg, (-360.0, 360.0), "deg")?;
            Prism::turned_box(&centre_m, &Vector3::from(*size_m), rad_from_deg(yaw_deg))
                .map(Solid::from)
                .map_err(|error| invalid(&of("size_m"), error.to_string()))
        }
        ObstacleSection::Prism { polygon_m, heights_m: [low_m, high_m] } => {
            let footprint = polygon(&of("polygon_m"), polygon_m)?;
            let low_m = within(&of("heights_m"), *low_m, (-100.0, 200.0), "m")?;
            let high_m = within(&of("heights_m"), *high_m, (low_m + 1e-3, 200.0), "m")?;
            Ok(Prism::new(footprint, (low_m, high_m)).into())
        }
        ObstacleSection::Mesh { .. } => mesh(key, section).map(Solid::from),
    }
}

fn mesh(key: &str, section: &ObstacleSection) -> Result<Mesh, ConfigError> {
    let of = |name: &str| format!("{key}.{name}");
    let ObstacleSection::Mesh { scale, place_m, rotation_deg, content, .. } = section else {
        return Err(invalid(key, "is not a mesh"));
    };
    let content =
        content.as_ref().ok_or_else(|| invalid(&of("file"), "the file is not read yet"))?;
    let scale = within(&of("scale"), *scale, (1e-6, 1e6), "m")?;
    let origin_m = place_in_hall(&of("place_m"), *place_m)?;
    for angle_deg in rotation_deg {
        within(&of("rotation_deg"), *angle_deg, (-360.0, 360.0), "deg")?;
    }
    let [roll, pitch, yaw] = rotation_deg.map(rad_from_deg);
    let turn = Rotation::<Hall, Hall>::from_euler_rad(roll, pitch, yaw);
    let hall_from_file = Transform::new(turn, Point::from_coords(origin_m));
    let place = |corner: Vector3<f64>| (hall_from_file * Point::from_coords(corner * scale)).coords;
    let triangles = mesh_file::triangles(&of("content"), content)?;
    let triangles: Vec<[Vector3<f64>; 3]> =
        triangles.into_iter().map(|corners| corners.map(place)).collect();
    for corner in triangles.iter().flatten() {
        place_in_hall(&of("file"), [corner.x, corner.y, corner.z])?;
    }
    Mesh::new(triangles).map_err(|error| invalid(&of("file"), error.to_string()))
}

fn place_in_hall(key: &str, [x_m, y_m, z_m]: [f64; 3]) -> Result<Vector3<f64>, ConfigError> {
    let (x_m, y_m) = place(key, [x_m, y_m])?;
    Ok(Vector3::new(x_m, y_m, within(key, z_m, (-1000.0, 1000.0), "m")?))
}

#[cfg(test)]
mod tests;
