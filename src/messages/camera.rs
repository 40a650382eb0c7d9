//! Markers found in camera frames.

use crate::time::{Mono, Stamp};

/// Which camera saw it; an index into the configured cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct CameraId(pub u8);

/// The dictionary a tag belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TagFamily {
    /// AprilTag 36h11.
    Tag36h11,
    /// AprilTag 25h9.
    Tag25h9,
    /// AprilTag 16h5.
    Tag16h5,
}

impl TagFamily {
    /// The usual short name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tag36h11 => "36h11",
            Self::Tag25h9 => "25h9",
            Self::Tag16h5 => "16h5",
        }
    }

    /// The family with this short name; a leading `tag` is allowed.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        match name.strip_prefix("tag").unwrap_or(name) {
            "36h11" => Some(Self::Tag36h11),
            "25h9" => Some(Self::Tag25h9),
            "16h5" => Some(Self::Tag16h5),
            _ => None,
        }
    }
}

/// One tag in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TagDetection {
    /// The number inside the family.
    pub id: u32,
    /// The dictionary.
    pub family: TagFamily,
    /// Corners in pixels (u right, v down; the centre of the first pixel is at 0.5, 0.5), as
    /// seen: lower left, lower right, upper right, upper left of the upright tag.
    pub corners_px: [[f64; 2]; 4],
    /// How clearly the tag's bits were read; larger is better, scale of the detector.
    pub decision_margin: f64,
}

/// One mapped point in one frame, found by whatever knows it: a lamp, a painted cross, a corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointDetection {
    /// The number of the point in the marker map.
    pub id: u32,
    /// Where it was seen, px; the convention is that of [`TagDetection::corners_px`].
    pub pixel_px: [f64; 2],
}

/// All tags and points of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct TagDetections {
    /// Middle of the exposure.
    pub captured_at: Stamp<Mono>,
    /// When the detections reached this computer's service.
    pub received_at: Stamp<Mono>,
    /// Which camera.
    pub camera: CameraId,
    /// The tags, in the detector's order.
    pub tags: Vec<TagDetection>,
    /// Mapped points that belong to no tag, in the detector's order.
    pub points: Vec<PointDetection>,
}
