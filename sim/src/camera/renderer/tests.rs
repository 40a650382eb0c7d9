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

/// The kernel of a moving edge is that of offset and instant together. Whatever the motion, as many rays are
/// on one side as on the other, and its skewness is nothing.
#[test]
fn no_motion_makes_the_blur_lean_to_a_side() {
    /// Equal steps of 48 rays would be 0.04 px.
    const GAP_PX: f64 = 0.2;
    let samples = samples(0.6);
    assert_eq!(samples.len(), N_SAMPLES);
    for instant in 0..N_INSTANTS {
        let n = samples.iter().filter(|sample| sample.instant == instant).count();
        assert!((10..=14).contains(&n), "{n} rays at instant {instant}");
    }
    // px from instant to instant
    for speed in [0.0, 0.07, -0.14] {
        for axis in 0..2 {
            let middle = (N_INSTANTS - 1) as f64 / 2.0;
            let mut places: Vec<f64> = samples
                .iter()
                .map(|s| f64::from(s.offset_px[axis]) + speed * (s.instant as f64 - middle))
                .collect();
            places.sort_by(f64::total_cmp);
            let lowest_and_highest = std::iter::zip(&places, places.iter().rev());
            for (low, high) in lowest_and_highest {
                assert!((low + high).abs() < 1e-6, "{low} and {high} at {speed}");
            }
            let (n, n_middle) = (places.len(), places.len() / 4);
            let gaps = places[n_middle..n - n_middle].windows(2).map(|pair| pair[1] - pair[0]);
            assert!(gaps.fold(0.0, f64::max) < GAP_PX, "{places:?} at {speed}");
        }
    }
}
