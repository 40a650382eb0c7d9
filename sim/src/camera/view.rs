//! Which markers a camera sees, and where.

use super::CameraModel;
use crate::raycast;
use crate::world::{PlacedTag, World};
use stockpilot::geometry::{Body, Camera, Direction, Hall, Transform};

/// A marker in the exact picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenTag<'a> {
    /// The marker.
    pub tag: &'a PlacedTag,
    /// Its corners in the order of the marker's own, px.
    pub corners_px: [[f64; 2]; 4],
    /// A quarter of its outline, px.
    pub edge_px: f64,
}

impl CameraModel {
    /// The markers that a body at this pose sees, without any noise, in the order of the hall's.
    #[must_use]
    pub fn view<'a>(
        &self,
        world: &'a World,
        hall_from_body: &Transform<Hall, Body>,
    ) -> Vec<SeenTag<'a>> {
        let hall_from_camera = *hall_from_body * self.body_from_camera;
        let camera_from_hall = hall_from_camera.inverse();
        let is_seen = |seen: &SeenTag<'_>| is_in_sight(world, &hall_from_camera, seen.tag);
        let pictured = world.tags.iter().filter(|tag| self.is_facing(&hall_from_camera, tag));
        let pictured = pictured.filter_map(|tag| self.picture(&camera_from_hall, tag));
        pictured.filter(is_seen).collect()
    }

    /// True if the camera looks at the front of the marker, not too slanted.
    fn is_facing(&self, hall_from_camera: &Transform<Hall, Camera>, tag: &PlacedTag) -> bool {
        let to_camera = (hall_from_camera.origin - tag.centre()).coords;
        let least = self.detector.incidence_max_rad.cos() * to_camera.norm();
        to_camera.dot(&tag.normal.coords) >= least
    }

    /// The marker in the picture, if it is whole and large enough.
    fn picture<'a>(
        &self,
        camera_from_hall: &Transform<Camera, Hall>,
        tag: &'a PlacedTag,
    ) -> Option<SeenTag<'a>> {
        let mut corners_px = [[0.0; 2]; 4];
        for (pixel, corner) in corners_px.iter_mut().zip(tag.corners) {
            *pixel = self.lens.project(&(*camera_from_hall * corner).coords)?;
        }
        let is_whole =
            corners_px.iter().all(|pixel| self.lens.contains(*pixel, self.detector.margin_px));
        let edge_px = mean_edge_px(&corners_px);
        let is_readable = is_whole && edge_px >= self.detector.edge_min_px;
        is_readable.then_some(SeenTag { tag, corners_px, edge_px })
    }
}

fn mean_edge_px(corners_px: &[[f64; 2]; 4]) -> f64 {
    let edge_px = |i: usize| {
        let (a, b) = (corners_px[i], corners_px[(i + 1) % 4]);
        (a[0] - b[0]).hypot(a[1] - b[1])
    };
    (0..4).map(edge_px).sum::<f64>() / 4.0
}

/// True if nothing solid stands between the camera and the middle of the marker.
fn is_in_sight(world: &World, hall_from_camera: &Transform<Hall, Camera>, tag: &PlacedTag) -> bool {
    // The marker lies on a wall, which the beam meets there: nearer hits are in the way.
    const NEARLY_M: f64 = 0.02;
    let line = (tag.centre() - hall_from_camera.origin).coords;
    let distance_m = line.norm();
    let direction = Direction::from_coords(line / distance_m);
    let hit = raycast::cast(world, &hall_from_camera.origin, &direction, distance_m + 1.0);
    hit.is_some_and(|hit| hit.distance_m > distance_m - NEARLY_M)
}
