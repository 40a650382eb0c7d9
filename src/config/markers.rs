//! Tags and points of the configuration, and the files they may stand in.

use super::convert::{invalid, rect, within};
use super::error::ConfigError;
use super::field_layout;
use super::file::Config;
use crate::geometry::Point;
use crate::localization::marker_map::MarkerMap;
use crate::messages::TagFamily;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Files with tags and points.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MarkersSection {
    /// A TOML file beside this one with `[[tags]]` and `[[points]]` of its own. In the effective
    /// configuration it has been read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// A field layout of `WPILib` (JSON) beside this file. In the effective configuration it has
    /// been read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub field_layout: Option<PathBuf>,
    /// Edge of the layout's tags, which it does not tell, m: of the black square, where detectors
    /// put the corners.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub field_layout_edge_m: Option<f64>,
    /// Family of the layout's tags, which it does not tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub field_layout_family: Option<String>,
}

/// One tag.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TagSection {
    /// `36h11`, `25h9` or `16h5`.
    pub family: String,
    /// The number inside the family.
    pub id: u32,
    /// Lower left, lower right, upper right, upper left corner of the upright tag seen from its
    /// front, in the hall, m.
    pub corners_m: [[f64; 3]; 4],
    /// The whole region lies behind its front, and that is meant.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub faces_away: bool,
}

/// One point that belongs to no tag.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointSection {
    /// The number by which the detector names it.
    pub id: u32,
    /// Where it lies in the hall, m.
    pub place_m: [f64; 3],
}

/// A marker map in a file of its own.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct MarkersFile {
    pub(super) tags: Vec<TagSection>,
    pub(super) points: Vec<PointSection>,
}

impl MarkersSection {
    /// The tags and points of [`Self::file`]; what is wrong with them is told with its name.
    pub(super) fn read_file(&self, directory: &Path) -> Result<MarkersFile, ConfigError> {
        let Some(name) = &self.file else { return Ok(MarkersFile::default()) };
        let path = directory.join(name);
        let text = read(&path)?;
        let refuse = |message| ConfigError::File { path: path.clone(), message };
        let markers: MarkersFile = toml::from_str(&text).map_err(|e| refuse(e.to_string()))?;
        map_of(&markers.tags, &markers.points).map_err(|error| refuse(error.to_string()))?;
        Ok(markers)
    }

    /// The tags of [`Self::field_layout`]; what is wrong with them is told with its name.
    pub(super) fn read_layout(&self, directory: &Path) -> Result<Vec<TagSection>, ConfigError> {
        let Some(name) = &self.field_layout else { return Ok(Vec::new()) };
        let edge_m = self.field_layout_edge_m.ok_or_else(|| {
            invalid("markers.field_layout_edge_m", "is missing: a field layout has no tag size")
        })?;
        let edge_m = within("markers.field_layout_edge_m", edge_m, (0.02, 5.0), "m")?;
        let family = self.field_layout_family.as_deref().ok_or_else(|| {
            invalid("markers.field_layout_family", "is missing: a field layout has no family")
        })?;
        family_named("markers.field_layout_family", family)?;
        let path = directory.join(name);
        let text = read(&path)?;
        let refuse = |message| ConfigError::File { path: path.clone(), message };
        let tags = field_layout::parse(&text, family, edge_m)
            .map_err(|error| refuse(error.to_string()))?;
        map_of(&tags, &[]).map_err(|error| refuse(error.to_string()))?;
        Ok(tags)
    }
}

fn read(path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path)
        .map_err(|source| ConfigError::Unreadable { path: path.to_owned(), source })
}

fn family_named(key: &str, name: &str) -> Result<TagFamily, ConfigError> {
    TagFamily::from_name(name)
        .ok_or_else(|| invalid(key, format!("{name:?} is not 36h11, 25h9 or 16h5")))
}

/// The map of these tags and points.
fn map_of(tags: &[TagSection], points: &[PointSection]) -> Result<MarkerMap, ConfigError> {
    let mut map = MarkerMap::default();
    for tag in tags {
        let family = family_named(&format!("family of tag {}", tag.id), &tag.family)?;
        map.insert(family, tag.id, tag.corners_m.map(|[x, y, z]| Point::new(x, y, z)))?;
    }
    for point in points {
        let [x, y, z] = point.place_m;
        map.insert_point(point.id, Point::new(x, y, z))?;
    }
    Ok(map)
}

impl Config {
    /// The marker map, checked against the region that is flown over.
    pub(super) fn marker_map(&self) -> Result<MarkerMap, ConfigError> {
        let m = &self.markers;
        if m.file.is_some() || m.field_layout.is_some() {
            let message = "its files can only be read with the file that names them";
            return Err(invalid("markers", message));
        }
        let map = map_of(&self.tags, &self.points)?;
        if map.is_empty() {
            return Err(invalid("tags", "without tags the vehicle cannot know where it is"));
        }
        self.check_facing(&map)?;
        let place_sigma_m = within(
            "surface.uncertainty.marker_sigma_m",
            self.surface.uncertainty.marker_sigma_m,
            (0.0, 1.0),
            "m",
        )?;
        Ok(map.with_place_sigma_m(place_sigma_m))
    }

    /// The flight takes place in the region, between floor and flying height.
    fn check_facing(&self, map: &MarkerMap) -> Result<(), ConfigError> {
        let region = rect("hall.region", &self.hall.region)?;
        let low_m = self.hall.base_height_m;
        let high_m = self.planning.height_m.max(self.hall.max_pile_height_m);
        let flight = (
            Point::new(region.x_min_m, region.y_min_m, low_m),
            Point::new(region.x_max_m, region.y_max_m, high_m),
        );
        map.check_facing(flight, |family, id| {
            let is_it = |tag: &&TagSection| {
                tag.id == id && TagFamily::from_name(&tag.family) == Some(family)
            };
            self.tags.iter().find(is_it).is_some_and(|tag| tag.faces_away)
        })?;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
