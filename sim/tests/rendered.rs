//! The tag detector on rendered pictures, against the projection of the world's corners.

#![expect(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use nalgebra::Vector3;
use std::time::Duration;
use stockpilot::camera::picture::GreyPicture;
use stockpilot::camera::tag_finder::{Settings, TagFinder};
use stockpilot::geometry::{Body, Hall, Point, Rotation, Transform};
use stockpilot::messages::{TagDetection, TagFamily};
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};
use stockpilot_sim::camera::{CameraModel, Picture, PictureCamera, PictureModel};
use stockpilot_sim::world::{Cuboid, World};

/// Tags of this mean edge and more must be found and found exactly, px.
const EDGE_PX: f64 = 20.0;

fn at(x: f64, y: f64, z: f64, yaw_deg: f64) -> Transform<Hall, Body> {
    let rotation = Rotation::from_euler_rad(0.02, -0.03, yaw_deg.to_radians());
    Transform::new(rotation, Point::new(x, y, z))
}

fn noon() -> Stamp<Mono> {
    Stamp::ZERO.plus(Duration::from_secs(1))
}

fn found(picture: Picture, families: &[TagFamily]) -> Vec<TagDetection> {
    let settings = Settings { families: families.to_vec(), ..Settings::default() };
    let grey = GreyPicture::new(picture.width_px, picture.height_px, picture.pixels).unwrap();
    TagFinder::new(&settings).unwrap().find(&grey).unwrap().tags
}

/// Sums over corners of tags.
#[derive(Debug, Default)]
struct Errors {
    n_visible: usize,
    n_found: usize,
    squares_px2: f64,
    largest_px: f64,
    bias_px: [f64; 2],
}

impl Errors {
    /// Compares what was found with where the world's corners are projected, for tags of this edge.
    fn add(
        &mut self,
        camera: &CameraModel,
        world: &World,
        pose: &Transform<Hall, Body>,
        tags: &[TagDetection],
        edges_px: std::ops::Range<f64>,
    ) {
        for seen in camera.view(world, pose).iter().filter(|s| edges_px.contains(&s.edge_px)) {
            self.n_visible += 1;
            let Some(tag) = tags.iter().find(|tag| tag.id == seen.tag.id) else { continue };
            self.n_found += 1;
            for (got, truth) in tag.corners_px.iter().zip(seen.corners_px) {
                let (du, dv) = (got[0] - truth[0], got[1] - truth[1]);
                self.squares_px2 += du * du + dv * dv;
                self.largest_px = self.largest_px.max(du.hypot(dv));
                self.bias_px[0] += du;
                self.bias_px[1] += dv;
            }
        }
    }

    /// Of one coordinate.
    fn rms_px(&self) -> f64 {
        (self.squares_px2 / (8 * self.n_found) as f64).sqrt()
    }

    fn found_share(&self) -> f64 {
        self.n_found as f64 / self.n_visible as f64
    }
}

const POSES: [[f64; 4]; 10] = [
    [4.0, 10.0, 7.0, 0.0],
    [8.0, 6.0, 7.0, 20.0],
    [12.0, 14.0, 6.5, -35.0],
    [16.0, 10.0, 7.0, 10.0],
    [10.0, 10.0, 5.0, 90.0],
    [6.0, 12.0, 6.0, 180.0],
    [14.0, 5.0, 7.0, -90.0],
    [2.0, 3.0, 3.0, 45.0],
    [18.0, 16.0, 7.5, 135.0],
    [10.0, 3.0, 6.0, -150.0],
];

/// The oracle is the projection of the world's corners, which the renderer does not use to draw.
#[test]
fn corners_are_found_where_the_world_projects_them() {
    let mut camera = CameraModel::ahead();
    camera.detector.incidence_max_rad = 60_f64.to_radians();
    let seeds = SeedBook::new(11);
    let mut taker = PictureCamera::new(camera.clone(), PictureModel::usual(), seeds, noon());
    let (mut small, mut all) = (Errors::default(), Errors::default());
    let mut n_false = 0;
    for (seed, [x, y, z, yaw_deg]) in (0..).zip(POSES) {
        let world = World::alps(seed % 3).unwrap();
        // A gentle flight: 1 m/s ahead and a turn of 17 °/s blur by some tenths of a pixel.
        let pose_at = |when: Stamp<Mono>| {
            let t_s = when.seconds_since(noon());
            at(x + t_s, y, z, yaw_deg + 17.0 * t_s)
        };
        let tags = found(taker.picture(&world, noon(), pose_at), &[TagFamily::Tag36h11]);
        n_false += tags.iter().filter(|t| world.tags.iter().all(|w| w.id != t.id)).count();
        small.add(&camera, &world, &pose_at(noon()), &tags, EDGE_PX..30.0);
        all.add(&camera, &world, &pose_at(noon()), &tags, EDGE_PX..f64::INFINITY);
    }
    println!(
        "20 to 30 px: {small:?}, rms {:.3} px, found {:.2}",
        small.rms_px(),
        small.found_share()
    );
    println!("all: {all:?}, rms {:.3} px, found {:.2}", all.rms_px(), all.found_share());
    assert!(small.n_visible > 30 && all.n_visible > 150);
    // Asked are 0.3 px.
    assert!(small.rms_px() < 0.08 && all.rms_px() < 0.06);
    assert!(small.found_share() > 0.8 && all.found_share() > 0.9);
    assert_eq!(n_false, 0);
    // A shift of the picture against the projection, or of its stamp, would be the same everywhere: the turn moves
    // edges by 190 px/s.
    let n_corners = (4 * all.n_found) as f64;
    assert!(all.bias_px.iter().all(|sum| (sum / n_corners).abs() < 0.01), "{all:?}");
}

#[test]
fn a_tag_that_is_hidden_by_half_is_not_found_and_its_neighbours_are() {
    let mut world = World::alps(0).unwrap();
    let camera = CameraModel::ahead();
    let pose = at(8.0, 10.0, 7.0, 0.0);
    let seen = camera.view(&world, &pose);
    let ahead = seen.iter().filter(|s| s.tag.normal.coords.x < -0.9);
    let victim = *ahead.max_by(|a, b| a.edge_px.total_cmp(&b.edge_px)).unwrap().tag;
    let mut taker = PictureCamera::new(camera, PictureModel::usual(), SeedBook::new(3), noon());
    let before = found(taker.picture(&world, noon(), |_| pose), &[victim.family]);
    assert!(before.iter().any(|tag| tag.id == victim.id));
    // A board a metre before the tag, its lower edge at the tag's middle.
    let place = victim.centre().coords + victim.normal.coords;
    let reach = Vector3::new(0.05, 0.6, 0.0);
    world.guests =
        vec![Cuboid { min_m: place - reach, max_m: place + reach + Vector3::new(0.0, 0.0, 0.6) }];
    let after = found(taker.picture(&world, noon(), |_| pose), &[victim.family]);
    assert!(after.iter().all(|tag| tag.id != victim.id));
    assert!(after.len() + 8 >= before.len() && after.len() < before.len());
}
