//! A hall where a part of the markers has fallen off.

use super::{Cuboid, PlacedTag};
use stockpilot::stats::SeedBook;

/// Share of the wall ahead, and of the side walls behind it, that has lost its markers.
const SHARE: (f64, f64) = (0.5, 0.62);

/// The markers that are left: the end of the wall ahead at high y is bare, and so is the wall at
/// high y.
///
/// A vehicle that looks along x near that wall sees too little; turned, it may see more.
pub(super) fn left_over(seeds: SeedBook, hall: &Cuboid, tags: Vec<PlacedTag>) -> Vec<PlacedTag> {
    let mut noise = seeds.stream("world.poor-fix");
    let width_m = hall.max_m.y - hall.min_m.y;
    let bare_from_m = hall.max_m.y - width_m * noise.between(SHARE.0, SHARE.1);
    let is_left = |tag: &PlacedTag| {
        let faces_back = tag.normal.coords.x < -0.5;
        let faces_low_y = tag.normal.coords.y < -0.5;
        !(faces_low_y || (faces_back && tag.centre().coords.y > bare_from_m))
    };
    tags.into_iter().filter(is_left).collect()
}

#[cfg(test)]
mod tests {
    use super::super::World;
    use crate::camera::CameraModel;
    use stockpilot::geometry::{Point, Rotation, Transform};

    #[test]
    fn few_markers_are_seen_near_the_bare_wall_and_enough_elsewhere() {
        let camera = CameraModel::ahead();
        for seed in 0..5 {
            let world = World::poor_fix(seed, 1.0).unwrap();
            let n_seen = |x: f64, y: f64, yaw_rad: f64| {
                let turned = Rotation::from_euler_rad(0.0, 0.0, yaw_rad);
                camera.view(&world, &Transform::new(turned, Point::new(x, y, 7.0))).len()
            };
            assert!(n_seen(15.0, 18.0, 0.0) < 2, "{}", n_seen(15.0, 18.0, 0.0));
            assert!(n_seen(5.0, 3.0, 0.0) >= 6 && n_seen(15.0, 3.0, 0.0) >= 4);
            assert!(n_seen(15.0, 18.0, std::f64::consts::PI) >= 3, "turned round, there are some");
        }
    }
}
