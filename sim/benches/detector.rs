//! The tag detector on a rendered picture of 1280 × 720 px, and the renderer itself.

#![expect(clippy::unwrap_used, reason = "a bench may stop at the first surprise")]
#![expect(clippy::print_stdout, reason = "says what was found in the picture that is timed")]

use criterion::{Criterion, criterion_group, criterion_main};
use std::time::Duration;
use stockpilot::camera::picture::GreyPicture;
use stockpilot::camera::tag_finder::{Settings, TagFinder};
use stockpilot::geometry::{Point, Rotation, Transform};
use stockpilot::stats::SeedBook;
use stockpilot::time::Stamp;
use stockpilot_sim::camera::{CameraModel, Lens, PictureCamera, PictureModel};
use stockpilot_sim::world::World;

fn benches(c: &mut Criterion) {
    let mut camera = CameraModel::ahead();
    camera.lens = Lens { height_px: 720, cy_px: 357.8, ..Lens::wide() };
    let world = World::alps(0).unwrap();
    let pose = Transform::new(Rotation::identity(), Point::new(6.0, 10.0, 6.0));
    let at = Stamp::ZERO.plus(Duration::from_secs(1));
    let n_visible = camera.view(&world, &pose).len();
    let mut taker = PictureCamera::new(camera, PictureModel::usual(), SeedBook::new(1), at);
    let picture = taker.picture(&world, at, |_| pose);
    let grey = GreyPicture::new(picture.width_px, picture.height_px, picture.pixels).unwrap();
    for decimation in [1.0, 1.5, 2.0] {
        let settings = Settings { decimation, ..Settings::default() };
        let mut finder = TagFinder::new(&settings).unwrap();
        let n_found = finder.find(&grey).unwrap().tags.len();
        assert!(n_found > 10, "{n_found} of {n_visible}");
        println!(
            "decimation {decimation}: {n_found} found, {n_visible} in view with edges from 14 px"
        );
        c.bench_function(&format!("tags in 1280 x 720, decimation {decimation}"), |b| {
            b.iter(|| finder.find(&grey).unwrap());
        });
    }
    c.bench_function("render 1280 x 720", |b| b.iter(|| taker.picture(&world, at, |_| pose)));
}

criterion_group! {
    name = all;
    config = Criterion::default().sample_size(20).measurement_time(Duration::from_secs(4));
    targets = benches
}
criterion_main!(all);
