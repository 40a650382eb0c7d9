use super::*;
use crate::stats::{Noise, SeedBook};

const SIZE_PX: u32 = 120;
const N_CELLS: u8 = 8;

/// A black ring of one cell on white, turned and blurred: the brightness is known in closed form, and
/// so are the corners.
#[derive(Debug, Clone, Copy)]
struct Ring {
    centre: [f64; 2],
    angle_rad: f64,
    edge_px: f64,
    blur_px: f64,
}

impl Ring {
    /// Corners in order around the ring.
    fn corners_px(&self) -> [[f64; 2]; 4] {
        let (sin, cos) = self.angle_rad.sin_cos();
        [[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]].map(|[x, y]| {
            let (x, y) = (x * self.edge_px, y * self.edge_px);
            [self.centre[0] + cos * x - sin * y, self.centre[1] + sin * x + cos * y]
        })
    }

    /// Share of a square of this edge in the pixel at a place.
    fn share(&self, edge_px: f64, [u, v]: [f64; 2]) -> f64 {
        let (sin, cos) = self.angle_rad.sin_cos();
        let (du, dv) = (u - self.centre[0], v - self.centre[1]);
        let step = |d: f64| 0.5 * (1.0 + libm::erf(d / self.blur_px / SQRT_2));
        [cos * du + sin * dv, cos * dv - sin * du]
            .map(|d| step(0.5 * edge_px - d) * step(0.5 * edge_px + d))
            .iter()
            .product()
    }

    fn picture(&self, noise_grey: f64, noise: &mut Noise) -> GreyPicture {
        self.picture_of(SIZE_PX, noise_grey, noise)
    }

    fn picture_of(&self, size_px: u32, noise_grey: f64, noise: &mut Noise) -> GreyPicture {
        let inner_px = self.edge_px * (1.0 - 2.0 / f64::from(N_CELLS));
        let places = (0..size_px).flat_map(|row| (0..size_px).map(move |col| (col, row)));
        let pixels = places.map(|(col, row)| {
            let at = [f64::from(col) + 0.5, f64::from(row) + 0.5];
            let black = self.share(self.edge_px, at) - self.share(inner_px, at);
            let grey = 190.0 - 170.0 * black + noise_grey * noise.normal();
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "grey")]
            let pixel = grey.round() as u8;
            pixel
        });
        GreyPicture::new(size_px, size_px, pixels.collect()).unwrap()
    }
}

/// Rings of this edge at awkward places and angles.
fn rings(edge_px: f64, n: usize, noise: &mut Noise) -> Vec<Ring> {
    let mut ring = || Ring {
        centre: [noise.between(55.0, 65.0), noise.between(55.0, 65.0)],
        angle_rad: noise.between(-0.8, 0.8),
        edge_px,
        blur_px: noise.between(0.5, 0.9),
    };
    let upright = [0.0, 0.5, 0.25].map(|part| Ring {
        centre: [60.0 + part, 60.0],
        angle_rad: 0.0,
        edge_px,
        blur_px: 0.7,
    });
    upright.into_iter().chain((0..n).map(|_| ring())).collect()
}

/// Errors of all coordinates of all corners after a first guess that is off by up to a quarter of a pixel: the
/// library is off by a tenth.
fn errors_px(rings: &[Ring], noise_grey: f64, noise: &mut Noise) -> Vec<f64> {
    let mut errors = Vec::new();
    for ring in rings {
        let picture = ring.picture(noise_grey, noise);
        let truth = ring.corners_px();
        let guess = truth.map(|corner| corner.map(|px| px + noise.between(-0.25, 0.25)));
        let found = refined(&picture, guess, N_CELLS);
        errors.extend(
            std::iter::zip(found.iter().flatten(), truth.iter().flatten()).map(|(f, t)| f - t),
        );
    }
    errors
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

/// Near an edge of a small cell the next ones begin within the blur, and few distances occur along an upright one: there
/// a fit may end nowhere, and the guess stays.
#[test]
fn corners_of_a_blurred_ring_are_where_they_were_drawn() {
    let mut noise = SeedBook::new(4).stream("rings");
    for (edge_px, guess_px, limit_px) in [(20.0, 0.144, 0.10), (48.0, 0.144, 0.03)] {
        for noise_grey in [0.0, 4.0] {
            let rings = rings(edge_px, 120, &mut noise);
            let errors = errors_px(&rings, noise_grey, &mut noise);
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            let rms = rms(&errors);
            println!("{edge_px} px: guess {guess_px} px, rms {rms:.4} px, mean {mean:+.4} px");
            assert!(rms < limit_px, "{edge_px} px: {rms}");
            // Four standard deviations of a mean; the corners of a ring share edges.
            assert!(mean.abs() < 4.0 * rms / (errors.len() as f64 / 2.0).sqrt(), "{mean}");
        }
    }
}

#[test]
fn an_edge_that_is_hidden_in_part_stays_and_the_others_do_not_suffer() {
    let mut noise = SeedBook::new(6).stream("rings");
    let ring = Ring { centre: [60.3, 60.1], angle_rad: 0.1, edge_px: 48.0, blur_px: 0.7 };
    let picture = ring.picture(0.0, &mut noise);
    // Grey over the middle of the lower edge, from corner 0 to corner 1.
    let mut pixels = picture.pixels().to_vec();
    for row in 74..100 {
        for col in 50..72 {
            pixels[row * SIZE_PX as usize + col] = 110;
        }
    }
    let hidden = GreyPicture::new(SIZE_PX, SIZE_PX, pixels).unwrap();
    let truth = ring.corners_px();
    let guess = truth.map(|[u, v]| [u + 0.2, v - 0.3]);
    let found = refined(&hidden, guess, N_CELLS);
    for i in [2, 3] {
        let off = Vector2::from(found[i]) - Vector2::from(truth[i]);
        assert!(off.norm() < 0.02, "{i}: {off}");
    }
    let along = (Vector2::from(guess[1]) - Vector2::from(guess[0])).normalize();
    for i in [0, 1] {
        let beside_px = (Vector2::from(found[i]) - Vector2::from(guess[0])).perp(&along);
        assert!(beside_px.abs() < 1e-9, "{i}: {beside_px}");
    }
}

#[test]
fn a_plain_picture_moves_nothing() {
    let n_pixels = (SIZE_PX * SIZE_PX) as usize;
    let plain = GreyPicture::new(SIZE_PX, SIZE_PX, vec![120; n_pixels]).unwrap();
    let corners = [[40.0, 80.5], [80.0, 81.0], [79.5, 40.0], [41.0, 41.0]];
    let found = refined(&plain, corners, N_CELLS);
    for (found, corner) in std::iter::zip(found.iter().flatten(), corners.iter().flatten()) {
        assert!((found - corner).abs() < 1e-9);
    }
    // Beyond the picture there is nothing to look at.
    let outside = [[-30.0, 20.0], [-5.0, 20.0], [-5.0, -10.0], [-30.0, -10.0]];
    assert!(refined(&plain, outside, N_CELLS).iter().flatten().all(|px| px.is_finite()));
    let point = [[50.0, 50.0]; 4];
    assert_eq!(refined(&plain, point, N_CELLS), point);
}

/// A tag with its data cells before a pinhole camera, turned about its upright axis.
#[derive(Debug, Clone, Copy)]
struct Oblique {
    /// Turn away from the camera, rad, and roll in the picture, rad.
    turn_rad: f64,
    roll_rad: f64,
    /// Its edge seen from the front, px.
    edge_px: f64,
    /// Its middle in the picture, px.
    middle_px: [f64; 2],
    /// Which data cells are white, bit by bit.
    cells: u64,
}

impl Oblique {
    /// Focal length and distance in edges: the perspective of a tag that is some metres away.
    const DISTANCE_EDGES: f64 = 6.0;

    /// Where a point of the tag is seen, px; its corners are at ±0.5.
    fn seen_px(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.turn_rad.sin_cos();
        let scale = self.edge_px * Self::DISTANCE_EDGES / (Self::DISTANCE_EDGES + x * sin);
        let (u, v) = (scale * x * cos, scale * y);
        let (sin, cos) = self.roll_rad.sin_cos();
        [self.middle_px[0] + cos * u - sin * v, self.middle_px[1] + sin * u + cos * v]
    }

    /// The point of the tag that is seen there: [`Self::seen_px`] solved for it.
    fn point(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = self.roll_rad.sin_cos();
        let (u, v) = (u - self.middle_px[0], v - self.middle_px[1]);
        let (u, v) = ((cos * u + sin * v) / self.edge_px, (cos * v - sin * u) / self.edge_px);
        let (sin, cos) = self.turn_rad.sin_cos();
        let x = u * Self::DISTANCE_EDGES / (cos * Self::DISTANCE_EDGES - u * sin);
        [x, v * (Self::DISTANCE_EDGES + x * sin) / Self::DISTANCE_EDGES]
    }

    /// Black ring of one cell, data cells inside, white outside.
    fn grey(&self, [x, y]: [f64; 2]) -> f64 {
        let cell = |at: f64| ((at + 0.5) * f64::from(N_CELLS)).floor();
        let (col, row) = (cell(x), cell(y));
        let (last, inside) = (f64::from(N_CELLS) - 1.0, 1.0..=f64::from(N_CELLS) - 2.0);
        if !(0.0..=last).contains(&col) || !(0.0..=last).contains(&row) {
            return 190.0;
        }
        if !inside.contains(&col) || !inside.contains(&row) {
            return 20.0;
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 35")]
        let bit = ((row - 1.0) * 6.0 + col - 1.0) as u32;
        if (self.cells >> bit) & 1 == 1 { 190.0 } else { 20.0 }
    }

    /// The picture: in every pixel the mean over its own square, seen through a lens that blurs by half a pixel.
    fn picture(&self) -> GreyPicture {
        const STEPS_PER_PX: i32 = 5;
        const REACH_PX: i32 = 2;
        const LENS_PX: f64 = 0.5;
        let phi = |z: f64| 0.5 * (1.0 + libm::erf(z / SQRT_2));
        let part = |step: i32| (f64::from(step) + 0.5) / f64::from(STEPS_PER_PX);
        let steps: Vec<(f64, f64)> = (-REACH_PX * STEPS_PER_PX..REACH_PX * STEPS_PER_PX)
            .map(part)
            .map(|d| (d, phi((d + 0.5) / LENS_PX) - phi((d - 0.5) / LENS_PX)))
            .collect();
        let whole: f64 = steps.iter().map(|(_, weight)| weight).sum();
        let places = (0..SIZE_PX).flat_map(|row| (0..SIZE_PX).map(move |col| (col, row)));
        let pixels = places.map(|(col, row)| {
            let mut sum = 0.0;
            for (dv, weight_v) in &steps {
                for (du, weight_u) in &steps {
                    let at = [f64::from(col) + 0.5 + du, f64::from(row) + 0.5 + dv];
                    sum += weight_u * weight_v * self.grey(self.point(at));
                }
            }
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "grey")]
            let pixel = (sum / whole / whole).round() as u8;
            pixel
        });
        GreyPicture::new(SIZE_PX, SIZE_PX, pixels.collect()).unwrap()
    }
}

/// Seen aslant, cells are 4.5 px along the upright edges and 1 to 2 px across them. With a band by the cells along, its
/// rims lie in the data cells, and one upright edge in two does not fit: then the guess stays, off by 0.144 px,
/// and 0.11 px is the root mean square of all.
#[test]
fn the_corners_of_a_tag_seen_aslant_are_where_they_were_drawn() {
    let mut noise = SeedBook::new(8).stream("oblique");
    let mut errors = Vec::new();
    for turn_deg in [-72.0, -65.0, 60.0, 65.0, 70.0, 74.0_f64] {
        for roll_rad in [0.0, 0.2] {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "36 bits")]
            let cells = (noise.between(0.0, 1.0) * 68e9) as u64;
            let tag = Oblique {
                turn_rad: turn_deg.to_radians(),
                roll_rad,
                edge_px: 36.0,
                middle_px: [noise.between(55.0, 65.0), noise.between(55.0, 65.0)],
                cells,
            };
            let truth =
                [[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]].map(|p| tag.seen_px(p));
            let back = tag.point(truth[0]);
            assert!((back[0] + 0.5).abs() < 1e-12 && (back[1] - 0.5).abs() < 1e-12, "{back:?}");
            let picture = tag.picture();
            for _ in 0..6 {
                let guess = truth.map(|corner| corner.map(|px| px + noise.between(-0.25, 0.25)));
                let found = refined(&picture, guess, N_CELLS);
                let pairs = std::iter::zip(found.iter().flatten(), truth.iter().flatten());
                errors.extend(pairs.map(|(found, truth)| found - truth));
            }
        }
    }
    let rms = rms(&errors);
    println!("aslant: guess 0.144 px, rms {rms:.4} px");
    assert!(rms < 0.085, "{rms} px");
}

#[test]
fn a_huge_tag_costs_no_more_than_a_large_one_and_is_as_exact() {
    let mut noise = SeedBook::new(9).stream("rings");
    for angle_rad in [0.0, 0.6] {
        let ring = Ring { centre: [500.3, 500.1], angle_rad, edge_px: 680.0, blur_px: 0.7 };
        let picture = ring.picture_of(1000, 2.0, &mut noise);
        let truth = ring.corners_px();
        let guess = truth.map(|[u, v]| [u + 0.2, v - 0.15]);
        let [from, to, ..] = guess.map(Vector2::from);
        let edge = Edge::new(from, to, Vector2::new(500.3, 500.1), f64::from(N_CELLS));
        // The band is 5 px wide; across the pixels it is longer by √2 at most.
        let n_near = edge.pixels(&picture, 0.0, 0.0).count();
        assert!((600..1600).contains(&n_near), "{n_near} pixels");
        let found = refined(&picture, guess, N_CELLS);
        for (found, truth) in std::iter::zip(found.iter().flatten(), truth.iter().flatten()) {
            assert!((found - truth).abs() < 0.02, "{found} {truth}");
        }
    }
}
