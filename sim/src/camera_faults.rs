//! A detector that is wrong, between a camera and the brain.
//!
//! Each fault works on the frames as they arrive and leaves their stamps alone. Only the moved
//! marker is a fault of the hall: it hangs elsewhere while the fault lasts, and back afterwards.

use crate::camera::CameraModel;
use crate::rig::Rig;
use clap::ValueEnum;
use nalgebra::Vector3;
use std::f64::consts::TAU;
use stockpilot::messages::{TagDetection, TagDetections};
use stockpilot::stats::{Noise, SeedBook};

/// What a detector gets wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CameraFault {
    /// The marker in the middle of each frame carries the number of another one that hangs
    /// elsewhere.
    WrongId,
    /// The corners of the marker in the middle of each frame begin at the wrong one.
    SwappedCorners,
    /// One marker hangs 0.3 m beside its place on the map.
    MovedTag,
    /// Three corners in ten are 8 to 60 px off.
    OutlierCorners,
    /// The pixels of the last good frame come again and again, freshly stamped.
    FrozenCamera,
    /// Only the smallest marker that is seen nearly frontally, so that its pose and the mirrored
    /// one explain the pixels almost equally well.
    PlanarFlip,
    /// Only the marker in the middle of the picture.
    OneTag,
}

/// How far a moved marker hangs beside its place, m.
pub const MOVED_BY_M: f64 = 0.3;
/// Share of corners that [`CameraFault::OutlierCorners`] displaces.
pub const OUTLIER_RATIO: f64 = 0.3;

impl CameraFault {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::WrongId,
        Self::SwappedCorners,
        Self::MovedTag,
        Self::OutlierCorners,
        Self::FrozenCamera,
        Self::PlanarFlip,
        Self::OneTag,
    ];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::WrongId => "wrong-id",
            Self::SwappedCorners => "swapped-corners",
            Self::MovedTag => "moved-tag",
            Self::OutlierCorners => "outlier-corners",
            Self::FrozenCamera => "frozen-camera",
            Self::PlanarFlip => "planar-flip",
            Self::OneTag => "one-tag",
        }
    }
}

/// Spoils the frames of one flight.
#[derive(Debug, Clone)]
pub struct CameraFaultLayer {
    noise: Noise,
    /// The marker that hangs elsewhere now, and by how much.
    moved: Option<(u32, Vector3<f64>)>,
    /// The marker that a fault has picked; kept as long as it is in the picture.
    picked: Option<u32>,
    /// The last frame with markers that no fault has touched.
    last_good: Vec<TagDetection>,
}

impl CameraFaultLayer {
    /// A layer with noise from the stream `camera_faults` of this seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self {
            noise: SeedBook::new(seed).stream("camera_faults"),
            moved: None,
            picked: None,
            last_good: Vec::new(),
        }
    }

    /// The marker that the fault of the moment is about.
    #[must_use]
    pub const fn picked(&self) -> Option<u32> {
        self.picked
    }

    /// The frame as a detector with this fault hands it over.
    pub fn apply(
        &mut self,
        fault: Option<CameraFault>,
        mut frame: TagDetections,
        rig: &mut Rig,
    ) -> TagDetections {
        if fault != Some(CameraFault::MovedTag)
            && let Some((id, by_m)) = self.moved.take()
        {
            rig.move_tag(id, &-by_m);
        }
        match fault {
            None => {
                self.picked = None;
                self.last_good.clone_from(&frame.tags);
            }
            Some(CameraFault::WrongId) => self.misread_one(&mut frame.tags, rig),
            Some(CameraFault::SwappedCorners) => {
                if let Some(tag) = self.pick(&mut frame.tags, rig) {
                    tag.corners_px.rotate_left(1);
                }
            }
            Some(CameraFault::MovedTag) => self.move_one(&mut frame.tags, rig),
            Some(CameraFault::OutlierCorners) => self.displace(&mut frame.tags),
            Some(CameraFault::FrozenCamera) => frame.tags.clone_from(&self.last_good),
            Some(CameraFault::PlanarFlip) => keep_smallest_frontal(&mut frame.tags),
            Some(CameraFault::OneTag) => {
                let kept = self.pick(&mut frame.tags, rig).copied();
                frame.tags = Vec::from_iter(kept);
            }
        }
        frame
    }

    /// The marker picked before, or else the one nearest to the middle of the picture.
    fn pick<'a>(
        &mut self,
        tags: &'a mut [TagDetection],
        rig: &Rig,
    ) -> Option<&'a mut TagDetection> {
        let camera = rig.camera();
        let off_middle = |tag: &TagDetection| off_middle_px(tag, camera);
        let central = tags.iter().min_by(|a, b| off_middle(a).total_cmp(&off_middle(b)));
        let central = central.map(|tag| tag.id);
        let is_in_view = |id: &u32| tags.iter().any(|tag| tag.id == *id);
        self.picked = self.picked.filter(is_in_view).or(central);
        tags.iter_mut().find(|tag| Some(tag.id) == self.picked)
    }

    fn misread_one(&mut self, tags: &mut [TagDetection], rig: &Rig) {
        let is_unseen = |id: &u32| tags.iter().all(|tag| tag.id != *id);
        let alias = rig.world().tags.iter().map(|tag| tag.id).find(is_unseen);
        if let (Some(tag), Some(alias)) = (self.pick(tags, rig), alias) {
            tag.id = alias;
        }
    }

    /// Moves one marker sideways along its wall, once.
    fn move_one(&mut self, tags: &mut [TagDetection], rig: &mut Rig) {
        if self.moved.is_some() {
            return;
        }
        let Some(id) = self.pick(tags, rig).map(|tag| tag.id) else { return };
        let Some(placed) = rig.world().tags.iter().find(|tag| tag.id == id) else { return };
        let along = (placed.corners[1] - placed.corners[0]).coords.normalize();
        let by_m = along * MOVED_BY_M;
        rig.move_tag(id, &by_m);
        self.moved = Some((id, by_m));
    }

    fn displace(&mut self, tags: &mut [TagDetection]) {
        for corner in tags.iter_mut().flat_map(|tag| &mut tag.corners_px) {
            if self.noise.chance(OUTLIER_RATIO) {
                let (sin, cos) = self.noise.between(0.0, TAU).sin_cos();
                let by_px = self.noise.between(8.0, 60.0);
                corner[0] += by_px * cos;
                corner[1] += by_px * sin;
            }
        }
    }
}

/// The frame with `n_max` markers at most, the largest in the picture.
#[must_use]
pub fn keep_largest(mut frame: TagDetections, n_max: Option<usize>) -> TagDetections {
    if let Some(n_max) = n_max {
        frame.tags.sort_by(|a, b| outline_px(b).total_cmp(&outline_px(a)));
        frame.tags.truncate(n_max);
    }
    frame
}

/// Length of side `k` of a marker, px.
fn side_px(tag: &TagDetection, k: usize) -> f64 {
    let (a, b) = (tag.corners_px[k], tag.corners_px[(k + 1) % 4]);
    (a[0] - b[0]).hypot(a[1] - b[1])
}

fn outline_px(tag: &TagDetection) -> f64 {
    (0..4).map(|k| side_px(tag, k)).sum()
}

/// From the middle of the picture to that of the marker, px.
fn off_middle_px(tag: &TagDetection, camera: &CameraModel) -> f64 {
    let size_px = [camera.lens.width_px, camera.lens.height_px].map(f64::from);
    let off = |k: usize| {
        tag.corners_px.iter().map(|corner| corner[k]).sum::<f64>() / 4.0 - 0.5 * size_px[k]
    };
    off(0).hypot(off(1))
}

/// Opposite sides of a marker that is seen frontally differ by less than this share.
const FRONTAL_RATIO: f64 = 1.08;

fn keep_smallest_frontal(tags: &mut Vec<TagDetection>) {
    let is_frontal = |tag: &&TagDetection| {
        (0..2).all(|k| {
            let (a, b) = (side_px(tag, k), side_px(tag, k + 2));
            a.max(b) < FRONTAL_RATIO * a.min(b)
        })
    };
    let smallest = tags
        .iter()
        .filter(is_frontal)
        .min_by(|a, b| outline_px(a).total_cmp(&outline_px(b)))
        .copied();
    *tags = Vec::from_iter(smallest);
}
