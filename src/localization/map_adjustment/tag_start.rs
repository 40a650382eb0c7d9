//! A first pose of one tag from located frames, some of which may show another tag under its name.
//!
//! Each large picture of the tag proposes two poses (a tag and its mirror image about the line of
//! sight look nearly alike), the rays to its corners propose one more. The pose that most pictures
//! agree on wins, so one wrong name, one swapped corner or one mirrored pose decides nothing.

use super::{corners_in_tag, pose_of_corners};
use crate::geometry::{Body, Hall, Point, Tag, Transform};
use crate::localization::camera_model::CameraModel;
use crate::localization::planar_pose;
use crate::localization::vision_fix::Reprojector;
use nalgebra::{Matrix3, Vector2, Vector3};

/// A tag's own pose in a camera is believed from this edge on, px: smaller ones are too vague.
const MIN_EDGE_PX: f64 = 16.0;
/// A picture agrees with a pose if its corners lie within this of where the pose puts them (root
/// mean square, px): first places are off by centimetres.
const AGREES_PX: f64 = 8.0;
/// A single picture must prefer its pose to the mirrored one by this factor of the residuals.
const CLEARLY: f64 = 3.0;
/// Proposals are taken from so many pictures, the largest ones.
const MAX_PROPOSERS: usize = 12;
/// Rays to one corner must spread by this at least, rad (root mean square).
const MIN_SPREAD_RAD: f64 = 0.04;
/// Edges of a tag from rays may be off by this share.
const MAX_UNEVENNESS: f64 = 0.2;

/// One picture of the tag in a located frame.
pub(super) struct Sight<'a> {
    camera: &'a CameraModel,
    hall_from_body: Transform<Hall, Body>,
    reprojector: Reprojector<'a>,
    corners_px: [[f64; 2]; 4],
}

impl<'a> Sight<'a> {
    pub(super) fn new(
        camera: &'a CameraModel,
        hall_from_body: &Transform<Hall, Body>,
        corners_px: [[f64; 2]; 4],
    ) -> Self {
        let reprojector = Reprojector::new(camera, hall_from_body);
        Self { camera, hall_from_body: *hall_from_body, reprojector, corners_px }
    }

    /// Half the mean diagonal's square: what the edge of a tag seen from the front would be.
    fn edge_px(&self) -> f64 {
        let diagonal = |a: usize, b: usize| {
            (Vector2::from(self.corners_px[a]) - Vector2::from(self.corners_px[b])).norm()
        };
        (diagonal(0, 2) + diagonal(1, 3)) / 8.0_f64.sqrt()
    }

    /// How far the corners are from where a pose puts them (root mean square), px.
    fn off_px(&self, corners: &[Point<Hall>; 4]) -> f64 {
        let mut squares = 0.0;
        for (place, seen_px) in corners.iter().zip(self.corners_px) {
            let Some((pixel, _)) = self.reprojector.reproject(place) else { return f64::INFINITY };
            squares += (Vector2::from(seen_px) - pixel).norm_squared();
        }
        (squares / 4.0).sqrt()
    }

    /// The two poses that this picture allows.
    fn proposals(&self, edge_m: f64) -> Vec<Transform<Hall, Tag>> {
        let bearings = self.corners_px.map(|pixel| self.camera.bearing(&Vector2::from(pixel)));
        let [Some(a), Some(b), Some(c), Some(d)] = bearings else { return Vec::new() };
        // The tag's own axes stand for the hall's here.
        let places = corners_in_tag(edge_m).map(|corner| corner.coords);
        let hall_from_camera = self.hall_from_body * self.camera.body_from_camera;
        planar_pose::camera_from_hall_candidates(&places, &[a, b, c, d])
            .iter()
            .map(|camera_from_tag| {
                pose_of_corners(
                    &places.map(|place| {
                        hall_from_camera * (*camera_from_tag * Point::from_coords(place))
                    }),
                )
            })
            .collect()
    }
}

/// The pose that explains most pictures; `None` if no half of them agree, or a single one leaves
/// two poses open.
pub(super) fn pose_most_agree_on(
    edge_m: f64,
    sights: &[Sight<'_>],
) -> Option<Transform<Hall, Tag>> {
    let mut proposals: Vec<Transform<Hall, Tag>> =
        triangulated(edge_m, sights).into_iter().collect();
    let mut largest: Vec<&Sight<'_>> =
        sights.iter().filter(|s| s.edge_px() > MIN_EDGE_PX).collect();
    largest.sort_by(|a, b| b.edge_px().total_cmp(&a.edge_px()));
    largest.truncate(MAX_PROPOSERS);
    proposals.extend(largest.iter().flat_map(|sight| sight.proposals(edge_m)));
    let mut judged: Vec<Judged> =
        proposals.into_iter().map(|pose| Judged::of(pose, edge_m, sights)).collect();
    judged.sort_by(|a, b| a.loss.total_cmp(&b.loss));
    let best = judged.first()?;
    let is_majority = 2 * best.n_agreeing > sights.len();
    // With one picture both its poses agree; the pixels themselves must decide.
    let is_clear = sights.len() > 1
        || judged.get(1).is_none_or(|next| next.worst_px > CLEARLY * best.worst_px.max(0.5));
    (is_majority && is_clear).then_some(best.pose)
}

/// A proposed pose against all pictures.
struct Judged {
    pose: Transform<Hall, Tag>,
    /// Bounded, so that pictures of another tag have no pull (Geman and `McClure` 1987).
    loss: f64,
    n_agreeing: usize,
    worst_px: f64,
}

impl Judged {
    fn of(pose: Transform<Hall, Tag>, edge_m: f64, sights: &[Sight<'_>]) -> Self {
        let corners = corners_in_tag(edge_m).map(|corner| pose * corner);
        let (mut loss, mut n_agreeing, mut worst_px) = (0.0, 0, 0.0_f64);
        for sight in sights {
            let off_px = sight.off_px(&corners);
            let square = (off_px / AGREES_PX).powi(2);
            loss += if square.is_finite() { square / (1.0 + square) } else { 1.0 };
            n_agreeing += usize::from(off_px < AGREES_PX);
            worst_px = worst_px.max(off_px);
        }
        Self { pose, loss, n_agreeing, worst_px }
    }
}

/// Where the rays to one corner come nearest to each other.
///
/// ```text
/// Σ (I − d dᵀ) p = Σ (I − d dᵀ) o
/// ```
/// - `o`, `d`: where a ray begins and its direction, in the hall
#[derive(Debug, Clone, Copy)]
struct Rays {
    sum: Matrix3<f64>,
    right: Vector3<f64>,
    n: f64,
}

impl Rays {
    const NONE: Self = Self {
        sum: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        right: Vector3::new(0.0, 0.0, 0.0),
        n: 0.0,
    };

    fn add(&mut self, origin: &Vector3<f64>, direction: &Vector3<f64>) {
        let across = Matrix3::identity() - direction * direction.transpose();
        self.sum += across;
        self.right += across * origin;
        self.n += 1.0;
    }

    fn nearest(&self) -> Option<Vector3<f64>> {
        // The smallest eigenvalue is the mean square of the angles between the rays and their mean.
        let spread = self.sum.symmetric_eigenvalues().min() / self.n;
        (spread > MIN_SPREAD_RAD * MIN_SPREAD_RAD)
            .then(|| self.sum.cholesky())?
            .map(|f| f.solve(&self.right))
    }
}

/// The tag from the rays to its corners, if it is seen from different sides.
fn triangulated(edge_m: f64, sights: &[Sight<'_>]) -> Option<Transform<Hall, Tag>> {
    let mut rays = [Rays::NONE; 4];
    for sight in sights {
        let hall_from_camera = sight.hall_from_body * sight.camera.body_from_camera;
        let turn = hall_from_camera.rotation.matrix();
        for (rays, pixel) in rays.iter_mut().zip(sight.corners_px) {
            if let Some(bearing) = sight.camera.bearing(&Vector2::from(pixel)) {
                rays.add(&hall_from_camera.origin.coords, &(turn * bearing));
            }
        }
    }
    let [Some(a), Some(b), Some(c), Some(d)] = rays.map(|rays| rays.nearest()) else {
        return None;
    };
    let is_even = [(a, b), (b, c), (c, d), (d, a)]
        .iter()
        .all(|(p, q)| ((p - q).norm() / edge_m - 1.0).abs() < MAX_UNEVENNESS);
    is_even.then(|| pose_of_corners(&[a, b, c, d].map(Point::from_coords)))
}
