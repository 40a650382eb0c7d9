//! Messages for viewers, derived from entries; no replay looks at them.

use super::entry::{Entry, RecordedEvent};
use crate::geometry::{Body, Frame, Lidar, Transform};
use crate::messages::{Beam, HeightMap, NavEstimate, Scan, Severity, StatusText};
use crate::pilot::{Action, Event};
use crate::time::{Mono, Stamp};
use foxglove::bytes::Bytes;
use foxglove::schemas::log::Level;
use foxglove::schemas::packed_element_field::NumericType;
use foxglove::schemas::{
    FrameTransform, FrameTransforms, Grid, LaserScan, Log, PackedElementField, Pose, PoseInFrame,
    Quaternion, Timestamp, Vector2, Vector3,
};
use foxglove::{Encode, Schema};
use std::f64::consts::{PI, TAU};

/// A channel for viewers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum ViewTopic {
    /// `foxglove.LaserScan`, in the frame `lidar`.
    Scan,
    /// `foxglove.PoseInFrame`, body in the frame `hall`.
    Pose,
    /// `foxglove.FrameTransforms`: body in the frame `hall`, LiDAR in the frame `body`.
    Transforms,
    /// `foxglove.Log`.
    Log,
    /// `foxglove.Grid` with `elevation` and `sigma`, in the frame `hall`.
    Surface,
}

impl ViewTopic {
    pub(super) const ALL: [Self; 5] =
        [Self::Scan, Self::Pose, Self::Transforms, Self::Log, Self::Surface];

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Scan => "/view/scan",
            Self::Pose => "/view/pose",
            // The name that viewers are used to.
            Self::Transforms => "/tf",
            Self::Log => "/view/log",
            Self::Surface => "/view/surface",
        }
    }

    pub(super) fn schema(self) -> Option<Schema> {
        match self {
            Self::Scan => LaserScan::get_schema(),
            Self::Pose => PoseInFrame::get_schema(),
            Self::Transforms => FrameTransforms::get_schema(),
            Self::Log => Log::get_schema(),
            Self::Surface => Grid::get_schema(),
        }
    }
}

/// What viewers see of an entry written at `at`.
pub(super) fn views_of(
    entry: &Entry,
    at: Stamp<Mono>,
    body_from_lidar: Option<&Transform<Body, Lidar>>,
) -> Vec<(ViewTopic, Vec<u8>)> {
    let views = match entry {
        Entry::Event(RecordedEvent::Plain(Event::Scanned(scan))) => {
            [view(ViewTopic::Scan, &laser_scan(scan)), None]
        }
        Entry::Result(Action::PublishOdometry(estimate) | Action::PublishSight(estimate)) => [
            view(ViewTopic::Pose, &pose(estimate)),
            view(ViewTopic::Transforms, &transforms(estimate, body_from_lidar)),
        ],
        Entry::Result(Action::Say(text)) => [view(ViewTopic::Log, &log(text, at)), None],
        Entry::Result(Action::SurfaceSolved(surface)) => {
            [view(ViewTopic::Surface, &grid(surface)), None]
        }
        _ => return Vec::new(),
    };
    views.into_iter().flatten().collect()
}

fn view<T: Encode>(topic: ViewTopic, message: &T) -> Option<(ViewTopic, Vec<u8>)> {
    let mut bytes = Vec::new();
    message.encode(&mut bytes).ok().map(|()| (topic, bytes))
}

fn timestamp(at: Stamp<Mono>) -> Option<Timestamp> {
    let nanos = u64::try_from(at.nanos()).unwrap_or(0);
    let nsec = u32::try_from(nanos % 1_000_000_000).ok()?;
    Timestamp::new_checked(u32::try_from(nanos / 1_000_000_000).ok()?, nsec)
}

/// A laser scan wants equal steps of angle: each beam goes to the nearest of as many bins.
fn laser_scan(scan: &Scan) -> LaserScan {
    let n_bins = scan.beams.len().max(1);
    let mut ranges = vec![f64::NAN; n_bins];
    let mut intensities = vec![0.0; n_bins];
    for beam in scan.beams.iter().filter(|beam| beam.range_m > 0.0) {
        let bin = bin_of(beam, n_bins);
        ranges[bin] = f64::from(beam.range_m);
        intensities[bin] = f64::from(beam.intensity);
    }
    #[expect(clippy::cast_precision_loss, reason = "a scan has some thousand beams")]
    let step_rad = TAU / n_bins as f64;
    LaserScan {
        timestamp: timestamp(scan.start),
        frame_id: "lidar".into(),
        pose: Some(Pose {
            position: Some(Vector3::default()),
            orientation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
        }),
        start_angle: -PI,
        end_angle: PI - step_rad,
        ranges,
        intensities,
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "the turn's share lies in [0, 1) and a scan has some thousand beams"
)]
fn bin_of(beam: &Beam, n_bins: usize) -> usize {
    let turn_share = (f64::from(beam.angle_rad) + PI).rem_euclid(TAU) / TAU;
    (turn_share * n_bins as f64).round() as usize % n_bins
}

fn pose(estimate: &NavEstimate) -> PoseInFrame {
    let (position, orientation) = place_of(&estimate.hall_from_body);
    PoseInFrame {
        timestamp: timestamp(estimate.at),
        frame_id: "hall".into(),
        pose: Some(Pose { position: Some(position), orientation: Some(orientation) }),
    }
}

/// Where the body stands in the hall, and the LiDAR on the body: with every pose, so that who comes later
/// waits for nothing.
fn transforms(
    estimate: &NavEstimate,
    body_from_lidar: Option<&Transform<Body, Lidar>>,
) -> FrameTransforms {
    let transform = |parent: &str, child: &str, (translation, rotation)| FrameTransform {
        timestamp: timestamp(estimate.at),
        parent_frame_id: parent.into(),
        child_frame_id: child.into(),
        translation: Some(translation),
        rotation: Some(rotation),
    };
    let body = transform("hall", "body", place_of(&estimate.hall_from_body));
    let lidar = body_from_lidar.map(|mount| transform("body", "lidar", place_of(mount)));
    FrameTransforms { transforms: [body].into_iter().chain(lidar).collect() }
}

fn place_of<To: Frame, From: Frame>(pose: &Transform<To, From>) -> (Vector3, Quaternion) {
    let (origin, q) = (pose.origin.coords, pose.rotation.quaternion());
    (
        Vector3 { x: origin.x, y: origin.y, z: origin.z },
        Quaternion { x: q.i, y: q.j, z: q.k, w: q.w },
    )
}

fn log(text: &StatusText, at: Stamp<Mono>) -> Log {
    let level = match text.severity {
        Severity::Critical => Level::Fatal,
        Severity::Error => Level::Error,
        Severity::Warning => Level::Warning,
        Severity::Notice | Severity::Info => Level::Info,
    };
    Log {
        timestamp: timestamp(at),
        level: level.into(),
        message: text.text.clone(),
        name: "stockpilot".into(),
        ..Log::default()
    }
}

/// Bytes of one cell: two single-precision numbers.
const CELL_BYTES: u32 = 8;

#[expect(clippy::cast_possible_truncation, reason = "viewers want single precision")]
fn grid(surface: &HeightMap) -> Grid {
    let cells = surface.mean_m.iter().zip(&surface.sigma_m);
    let data: Vec<u8> = cells
        .flat_map(|(mean_m, sigma_m)| [*mean_m as f32, *sigma_m as f32])
        .flat_map(f32::to_le_bytes)
        .collect();
    let field = |name: &str, offset| PackedElementField {
        name: name.into(),
        offset,
        r#type: NumericType::Float32.into(),
    };
    let n_cols = u32::try_from(surface.grid.n_cols).unwrap_or(0);
    let corner = Vector3 { x: surface.grid.x_min_m, y: surface.grid.y_min_m, z: 0.0 };
    Grid {
        timestamp: timestamp(surface.at),
        frame_id: "hall".into(),
        pose: Some(Pose {
            position: Some(corner),
            orientation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
        }),
        column_count: n_cols,
        cell_size: Some(Vector2 { x: surface.grid.cell_m, y: surface.grid.cell_m }),
        row_stride: n_cols * CELL_BYTES,
        cell_stride: CELL_BYTES,
        fields: vec![field("elevation", 0), field("sigma", 4)],
        data: Bytes::from(data),
    }
}
