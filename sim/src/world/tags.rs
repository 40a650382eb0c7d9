//! Markers on the walls of the hall.

use super::{Cuboid, Pad};
use nalgebra::Vector3;
use stockpilot::geometry::{Direction, Hall, Point};
use stockpilot::messages::TagFamily;
use stockpilot::stats::Noise;

/// Edge of a marker in a hall of up to [`USUAL_LENGTH_M`], m.
const EDGE_M: f64 = 0.5;
/// Markers of longer halls grow with the hall, so the far wall stays readable.
const USUAL_LENGTH_M: f64 = 24.5;
const LARGEST_EDGE_M: f64 = 0.9;
/// Middles of the rows over the floor, m.
const ROWS_M: [f64; 3] = [2.0, 4.5, 7.0];
const SPACING_M: f64 = 2.5;
/// The wall ahead of the camera: close to it, only a small window of it is in the picture.
const ROWS_AHEAD_M: [f64; 4] = [2.0, 4.5, 5.75, 7.0];
const SPACING_AHEAD_M: f64 = 1.1;
/// Markers for the vehicle on its pad: distance ahead of the pad and height, m.
const LAUNCH_AHEAD_M: [f64; 4] = [3.0, 3.8, 4.6, 5.4];
const LAUNCH_ROWS_M: [f64; 2] = [0.5, 1.2];

/// A marker on a wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedTag {
    /// The number inside the family.
    pub id: u32,
    /// The dictionary.
    pub family: TagFamily,
    /// Length of its sides, m.
    pub edge_m: f64,
    /// Lower left, lower right, upper right, upper left, seen from the front.
    pub corners: [Point<Hall>; 4],
    /// Unit vector out of its front.
    pub normal: Direction<Hall>,
}

impl PlacedTag {
    /// The middle of the marker.
    #[must_use]
    pub fn centre(&self) -> Point<Hall> {
        Point::from_coords(self.corners.iter().map(|c| c.coords).sum::<Vector3<f64>>() / 4.0)
    }
}

/// A wall as somebody in front of it sees it.
#[derive(Debug, Clone, Copy)]
struct WallFace {
    /// Lower left corner.
    origin_m: Vector3<f64>,
    right: Vector3<f64>,
    normal: Vector3<f64>,
    width_m: f64,
}

impl WallFace {
    /// The marker with its middle this far right and up of the wall's lower left corner.
    fn tag(&self, id: u32, edge_m: f64, (right_m, up_m): (f64, f64)) -> PlacedTag {
        let middle = self.origin_m + self.right * right_m + Vector3::z() * up_m;
        let corner = |right: f64, up: f64| {
            let half_m = 0.5 * edge_m;
            Point::from_coords(middle + (self.right * right + Vector3::z() * up) * half_m)
        };
        PlacedTag {
            id,
            family: TagFamily::Tag36h11,
            edge_m,
            corners: [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
            normal: Direction::from_coords(self.normal),
        }
    }
}

/// The four walls in the order +x, +y, −x, −y.
fn faces(hall: &Cuboid) -> [WallFace; 4] {
    let (low, high) = (hall.min_m, hall.max_m);
    let (length_m, width_m) = (high.x - low.x, high.y - low.y);
    let face = |x: f64, y: f64, right: Vector3<f64>, normal: Vector3<f64>, width_m: f64| WallFace {
        origin_m: Vector3::new(x, y, low.z),
        right,
        normal,
        width_m,
    };
    [
        face(high.x, high.y, -Vector3::y(), -Vector3::x(), width_m),
        face(low.x, high.y, Vector3::x(), -Vector3::y(), length_m),
        face(low.x, low.y, Vector3::y(), Vector3::x(), width_m),
        face(high.x, low.y, -Vector3::x(), Vector3::y(), length_m),
    ]
}

/// Markers on all walls, slightly off their rows so that no mirrored hall looks the same.
pub(super) fn placed(hall: &Cuboid, pad: &Pad, noise: &mut Noise) -> Vec<PlacedTag> {
    let length_m = hall.max_m.x - hall.min_m.x;
    let edge_m = (EDGE_M * length_m / USUAL_LENGTH_M).clamp(EDGE_M, LARGEST_EDGE_M);
    let mut tags = Vec::new();
    let [ahead, left, behind, right] = faces(hall);
    hang(&mut tags, &ahead, edge_m, (SPACING_AHEAD_M, &ROWS_AHEAD_M), noise);
    for face in [left, behind, right] {
        hang(&mut tags, &face, edge_m, (SPACING_M, &ROWS_M), noise);
    }
    for ahead_m in LAUNCH_AHEAD_M {
        for up_m in LAUNCH_ROWS_M {
            let right_m = hall.max_m.x - pad.position.coords.x - ahead_m;
            let place = (right_m + noise.between(-0.05, 0.05), up_m);
            tags.push(right.tag(next_id(&tags), EDGE_M, place));
        }
    }
    tags
}

/// Takes away the markers inside of a block that fills a corner of the hall, high in x and y, and
/// hangs others on its two faces towards the hall.
pub(super) fn hang_around(
    tags: &mut Vec<PlacedTag>,
    hall: &Cuboid,
    block: &Cuboid,
    noise: &mut Noise,
) {
    // A marker that sticks out of the block by half is gone as well.
    let edge_m = tags.first().map_or(EDGE_M, |tag| tag.edge_m);
    tags.retain(|tag| block.distance_m(&tag.centre().coords) > 0.5 * edge_m + 1e-6);
    let rest = Cuboid {
        min_m: hall.min_m,
        max_m: Vector3::new(block.min_m.x, block.min_m.y, hall.max_m.z),
    };
    // The faces of the hall that would end at the block, as far as the block reaches.
    let [ahead, left, ..] = faces(&rest);
    let ahead = WallFace {
        origin_m: Vector3::new(block.min_m.x, hall.max_m.y, hall.min_m.z),
        width_m: hall.max_m.y - block.min_m.y,
        ..ahead
    };
    let left = WallFace {
        origin_m: Vector3::new(block.min_m.x, block.min_m.y, hall.min_m.z),
        width_m: hall.max_m.x - block.min_m.x,
        ..left
    };
    hang(tags, &ahead, edge_m, (SPACING_AHEAD_M, &ROWS_AHEAD_M), noise);
    hang(tags, &left, edge_m, (SPACING_M, &ROWS_M), noise);
}

/// Rows of markers along one wall.
fn hang(
    tags: &mut Vec<PlacedTag>,
    face: &WallFace,
    edge_m: f64,
    (spacing_m, rows_m): (f64, &[f64]),
    noise: &mut Noise,
) {
    let n_columns = ((face.width_m - edge_m) / spacing_m).floor().max(1.0);
    for row_m in rows_m {
        let mut column = 0.5;
        while column < n_columns {
            let right_m = column / n_columns * face.width_m + noise.between(-0.12, 0.12);
            let up_m = row_m + noise.between(-0.08, 0.08);
            tags.push(face.tag(next_id(tags), edge_m, (right_m, up_m)));
            column += 1.0;
        }
    }
}

fn next_id(tags: &[PlacedTag]) -> u32 {
    tags.last().map_or(0, |tag| tag.id + 1)
}
