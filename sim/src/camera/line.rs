//! Detections as a line of JSON, for a datagram.

use serde::Serialize;
use stockpilot::messages::TagDetections;

#[derive(Debug, Serialize)]
struct Line {
    captured_at_ns: i64,
    clock: &'static str,
    camera: u8,
    tags: Vec<LineTag>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    points: Vec<LinePoint>,
}

#[derive(Debug, Serialize)]
struct LinePoint {
    id: u32,
    pixel_px: [f64; 2],
}

#[derive(Debug, Serialize)]
struct LineTag {
    id: u32,
    family: &'static str,
    corners_px: [[f64; 2]; 4],
    decision_margin: f64,
}

/// One frame as a line of JSON without its line break; the receiver stamps the arrival itself.
///
/// # Errors
/// None for finite numbers; JSON has no others.
pub fn detections_line(frame: &TagDetections) -> serde_json::Result<String> {
    let tags = frame.tags.iter().map(|tag| LineTag {
        id: tag.id,
        family: tag.family.name(),
        corners_px: tag.corners_px,
        decision_margin: tag.decision_margin,
    });
    let points =
        frame.points.iter().map(|point| LinePoint { id: point.id, pixel_px: point.pixel_px });
    serde_json::to_string(&Line {
        captured_at_ns: frame.captured_at.nanos(),
        clock: "mono",
        camera: frame.camera.0,
        tags: tags.collect(),
        points: points.collect(),
    })
}
