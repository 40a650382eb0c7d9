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
        let inner_px = self.edge_px * (1.0 - 2.0 / f64::from(N_CELLS));
        let places = (0..SIZE_PX).flat_map(|row| (0..SIZE_PX).map(move |col| (col, row)));
        let pixels = places.map(|(col, row)| {
            let at = [f64::from(col) + 0.5, f64::from(row) + 0.5];
            let black = self.share(self.edge_px, at) - self.share(inner_px, at);
            let grey = 190.0 - 170.0 * black + noise_grey * noise.normal();
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "grey")]
            let pixel = grey.round() as u8;
            pixel
        });
        GreyPicture::new(SIZE_PX, SIZE_PX, pixels.collect()).unwrap()
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
