use super::*;
use crate::camera::PictureCamera;
use crate::world::Region;
use std::time::Duration;
use stockpilot::geometry::{Point, Rotation};
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

fn noon() -> Stamp<Mono> {
    Stamp::ZERO.plus(Duration::from_secs(1))
}

/// A camera without any fault before one tag: columns by hand.
///
/// The tag hangs on the wall x = 12; the camera looks along x from 4 m before it, f = 640 px, so a metre is
/// 160 px and a cell of 1/16 m is 10 px. Its left edge lies 1.0015625 m left of the axis: at 640 − 160.25.
#[test]
fn an_edge_between_pixels_gives_each_its_share() {
    let region = Region::new(0.0, 0.0, 10.0, 10.0);
    let floor = crate::world::HeightField::from_fn(&region, 0.1, |_, _| 0.0).unwrap();
    let mut world = World::assemble("open", floor, Vec::new(), SeedBook::new(0));
    let eye = Point::new(8.0, 5.0, 5.0);
    let mut tag = world.tags[0];
    let (left, top) = (5.0 + 1.001_562_5, 5.0 + 0.5);
    let corner = |right: f64, down: f64| Point::new(12.0, left - right, top - down);
    tag.corners = [corner(0.0, 0.5), corner(0.5, 0.5), corner(0.5, 0.0), corner(0.0, 0.0)];
    tag.normal = Direction::new(-1.0, 0.0, 0.0);
    world.hall.max_m.x = 12.0;
    world.tags = vec![tag];
    let mut camera = CameraModel::ahead();
    camera.lens =
        Lens { cx_px: 640.0, cy_px: 400.0, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, ..Lens::wide() };
    camera.body_from_camera = crate::camera::mounted(0.0, 0.0, 0.0, Point::origin());
    let model = PictureModel {
        blur_sigma_px: 0.0,
        vignetting: 0.0,
        read_noise: 0.0,
        shot_noise: 0.0,
        white: 0.8,
        black: 0.1,
        wall: 0.4,
        ..PictureModel::usual()
    };
    let mut taker = PictureCamera::new(camera, model, SeedBook::new(0), noon());
    let pose = Transform::new(Rotation::identity(), eye);
    let picture = taker.picture(&world, noon(), |_| pose);
    let grey = |col: usize, row: usize| f64::from(picture.pixels[row * 1280 + col]);
    // Rows: the top edge is at 400 − 80 = 320; row 325 goes through the black border.
    let [wall, white, black] = [0.4, 0.8, 0.1].map(|share| share * 255.0);
    let near = |got: f64, expected: f64| (got - expected).abs() < 255.0 * 0.7 / 40.0;
    assert!(near(grey(460, 325), wall), "{}", grey(460, 325));
    assert!(near(grey(469, 325), 0.75 * wall + 0.25 * white), "{}", grey(469, 325));
    assert!(near(grey(475, 325), white));
    assert!(near(grey(479, 325), 0.75 * white + 0.25 * black), "{}", grey(479, 325));
    assert!(near(grey(480, 325), black));
    assert!(near(grey(485, 319), white) && near(grey(485, 320), black), "the top edge");
}
