//! The faces of a hall that beams may be held against.

use crate::mapping::polygon::Polygon;
use crate::mapping::region::Rect;
use nalgebra::Vector3;

/// A face of the hall, n·x = c with n into the room.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    /// For people: "floor", "wall 3.0 0.0" for the one whose middle is there.
    pub name: String,
    /// Unit normal in hall axes, into the room.
    pub normal: Vector3<f64>,
    /// n·x of its points, m.
    pub offset_m: f64,
    /// How well that is known, m.
    pub sigma_m: f64,
    extent: Extent,
}

/// Where a face is.
#[derive(Debug, Clone, PartialEq)]
enum Extent {
    /// Level, inside the walls and outside of the material.
    Level { walls: Option<Polygon>, material: Option<Rect> },
    /// Upright over a line from a to b, from a height on.
    Upright { a: [f64; 2], b: [f64; 2], from_m: f64 },
}

/// What is known of a hall.
#[derive(Debug, Clone, PartialEq)]
pub struct Hall {
    /// Level of the floor, m, and its standard deviation, m.
    pub floor_m: (f64, f64),
    /// Inner faces of the walls, and the standard deviation of each along its normal, m.
    pub walls: Option<(Polygon, f64)>,
    /// The ceiling, m, and its standard deviation, m.
    pub ceiling_m: Option<(f64, f64)>,
    /// Where material may lie, which is no floor; `None` in an empty hall.
    pub material: Option<Rect>,
    /// No material is higher than this over the floor, m: walls count from there on.
    pub material_height_m: f64,
}

/// Nearer to its edge than this a face does not count: the beam may have met its neighbour, m.
const EDGE_M: f64 = 0.3;

impl Hall {
    /// Its faces: floor, walls, ceiling.
    #[must_use]
    pub fn planes(&self) -> Vec<Plane> {
        let outline = self.walls.as_ref().map(|(walls, _)| walls.clone());
        let level = |material| Extent::Level { walls: outline.clone(), material };
        let mut planes = vec![Plane {
            name: "floor".to_owned(),
            normal: Vector3::z(),
            offset_m: self.floor_m.0,
            sigma_m: self.floor_m.1,
            extent: level(self.material),
        }];
        if let Some((walls, sigma_m)) = &self.walls {
            let from_m = self.floor_m.0 + self.material.map_or(0.0, |_| self.material_height_m);
            let edges = walls.edges();
            planes.extend(edges.map(|edge| upright(edge, walls, from_m, *sigma_m)));
        }
        if let Some((height_m, sigma_m)) = self.ceiling_m {
            planes.push(Plane {
                name: "ceiling".to_owned(),
                normal: -Vector3::z(),
                offset_m: -height_m,
                sigma_m,
                extent: level(None),
            });
        }
        planes
    }
}

fn upright((a, b): ((f64, f64), (f64, f64)), walls: &Polygon, from_m: f64, sigma_m: f64) -> Plane {
    let along = Vector3::new(b.0 - a.0, b.1 - a.1, 0.0).normalize();
    let left = Vector3::new(-along.y, along.x, 0.0);
    // The corners may go either way round.
    let middle = Vector3::new(f64::midpoint(a.0, b.0), f64::midpoint(a.1, b.1), 0.0);
    let beside = middle + 1e-3 * left;
    let normal = if walls.contains(beside.x, beside.y) { left } else { -left };
    Plane {
        name: format!("wall {:.1} {:.1}", middle.x, middle.y),
        normal,
        offset_m: normal.x * a.0 + normal.y * a.1,
        sigma_m,
        extent: Extent::Upright { a: a.into(), b: b.into(), from_m },
    }
}

impl Plane {
    /// n·x − c: how far a place is in front of the face, m.
    #[must_use]
    pub fn distance_m(&self, place_m: &Vector3<f64>) -> f64 {
        self.normal.dot(place_m) - self.offset_m
    }

    /// True if the face is there, and not near its edge.
    #[must_use]
    pub fn has(&self, place_m: &Vector3<f64>) -> bool {
        match &self.extent {
            Extent::Level { walls, material } => {
                let (x, y) = (place_m.x, place_m.y);
                let is_inside = walls.as_ref().is_none_or(|walls| {
                    walls.contains(x, y) && walls.border_distance_m(x, y) > EDGE_M
                });
                is_inside && !material.is_some_and(|rect| rect.contains(x, y, EDGE_M))
            }
            Extent::Upright { a, b, from_m } => {
                let along = Vector3::new(b[0] - a[0], b[1] - a[1], 0.0);
                let way_m = (place_m - Vector3::new(a[0], a[1], place_m.z)).dot(&along.normalize());
                way_m > EDGE_M && way_m < along.norm() - EDGE_M && place_m.z > from_m + EDGE_M
            }
        }
    }
}

/// The face that a place lies on: the only one within `gate_m`; `None` for none and for several.
#[must_use]
pub fn face_of(planes: &[Plane], place_m: &Vector3<f64>, gate_m: f64) -> Option<usize> {
    let mut near = planes
        .iter()
        .enumerate()
        .filter(|(_, plane)| plane.distance_m(place_m).abs() < gate_m && plane.has(place_m));
    let (index, _) = near.next()?;
    near.next().is_none().then_some(index)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hall() -> Hall {
        // Clockwise, so the left of each edge is outside.
        let corners = [(0.0, 0.0), (0.0, 8.0), (10.0, 8.0), (10.0, 0.0)];
        Hall {
            floor_m: (0.1, 0.002),
            walls: Some((Polygon::new(&corners).unwrap(), 0.005)),
            ceiling_m: Some((6.0, 0.01)),
            material: Some(Rect { x_min_m: 2.0, y_min_m: 2.0, x_max_m: 8.0, y_max_m: 6.0 }),
            material_height_m: 2.0,
        }
    }

    #[test]
    fn faces_look_into_the_room() {
        let planes = hall().planes();
        assert_eq!(planes.len(), 6);
        let middle = Vector3::new(5.0, 4.0, 3.0);
        let distances: Vec<f64> = planes.iter().map(|p| p.distance_m(&middle)).collect();
        // Floor, the walls x = 0, y = 8, x = 10, y = 0, ceiling.
        for (found, expected) in distances.iter().zip([2.9, 5.0, 4.0, 5.0, 4.0, 3.0]) {
            assert!((found - expected).abs() < 1e-12, "{distances:?}");
        }
    }

    #[test]
    fn a_place_has_one_face_or_none() {
        let planes = hall().planes();
        let face = |x, y, z| {
            face_of(&planes, &Vector3::new(x, y, z), 0.2).map(|k| planes[k].name.as_str())
        };
        assert_eq!(face(1.0, 4.0, 0.15), Some("floor"));
        assert_eq!(face(5.0, 4.0, 0.15), None, "there may be material");
        assert_eq!(face(0.1, 4.0, 3.0), Some("wall 0.0 4.0"));
        assert_eq!(face(0.1, 4.0, 1.0), None, "material may lean there");
        assert_eq!(face(0.1, 7.9, 3.0), None, "a corner");
        assert_eq!(face(5.0, 4.0, 5.9), Some("ceiling"));
        assert_eq!(face(5.0, 4.0, 3.0), None);
    }
}
