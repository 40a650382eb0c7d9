//! One line of a detector.

use super::MAX_LINE_BYTES;
use crate::messages::{CameraId, PointDetection, TagDetection, TagDetections, TagFamily};
use crate::time::{Mono, Stamp};
use serde::Deserialize;
use std::time::Duration;

/// More tags than this in one frame are not believed.
const MAX_TAGS: usize = 256;
/// More points than this in one frame are not believed.
const MAX_POINTS: usize = 1024;
/// Corners may lie this many image sizes outside the image.
const MAX_IMAGE_SIZES: f64 = 10.0;
/// A capture may be this far ahead of its arrival: the grain of the two clock readings.
const MAX_AHEAD: Duration = Duration::from_millis(5);
/// A capture older than this is of no use.
const MAX_AGE: Duration = Duration::from_secs(10);

/// Why a line was not taken.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// The line is too long to be a frame's tags.
    #[error("line is longer than {limit} bytes")]
    TooLong {
        /// The bound, bytes.
        limit: usize,
    },
    /// Not the JSON object that is expected.
    #[error("line is not a detection object: {cause}")]
    Malformed {
        /// What the JSON reader says.
        cause: String,
    },
    /// The capture is stamped by a clock that is not known here.
    #[error("clock \"{clock}\" is unknown, only \"mono\" is")]
    UnknownClock {
        /// The name given.
        clock: String,
    },
    /// No such camera is configured.
    #[error("camera {camera} is not configured, there are {n_cameras}")]
    UnknownCamera {
        /// The number given.
        camera: u8,
        /// Configured cameras.
        n_cameras: usize,
    },
    /// Too many tags for one frame.
    #[error("{got} tags in a frame, at most {limit} are taken")]
    TooManyTags {
        /// Tags in the line.
        got: usize,
        /// The bound.
        limit: usize,
    },
    /// The tag's family is not known.
    #[error("tag family \"{family}\" is unknown")]
    UnknownFamily {
        /// The name given.
        family: String,
    },
    /// A corner is far outside the image.
    #[error("corner ({u}, {v}) px of tag {id} is too far outside the image")]
    FarCorner {
        /// The tag.
        id: u32,
        /// Column, px.
        u: f64,
        /// Row, px.
        v: f64,
    },
    /// Too many points for one frame.
    #[error("{got} points in a frame, at most {limit} are taken")]
    TooManyPoints {
        /// Points in the line.
        got: usize,
        /// The bound.
        limit: usize,
    },
    /// A point is far outside the image.
    #[error("point {id} at ({u}, {v}) px is too far outside the image")]
    FarPoint {
        /// The point.
        id: u32,
        /// Column, px.
        u: f64,
        /// Row, px.
        v: f64,
    },
    /// The capture lies in the future.
    #[error("capture is {ahead_s:.3} s ahead of its arrival, are both on the same clock?")]
    FromTheFuture {
        /// How far, s.
        ahead_s: f64,
    },
    /// The capture is too long ago.
    #[error("capture is {age_s:.1} s old, at most 10 s are taken")]
    TooOld {
        /// How long ago, s.
        age_s: f64,
    },
}

/// The JSON form of a frame.
#[derive(Deserialize)]
struct FrameLine {
    captured_at_ns: i64,
    clock: String,
    #[serde(default)]
    camera: u8,
    tags: Vec<TagLine>,
    #[serde(default)]
    points: Vec<PointLine>,
}

#[derive(Deserialize)]
struct PointLine {
    id: u32,
    pixel_px: [f64; 2],
}

#[derive(Deserialize)]
struct TagLine {
    id: u32,
    family: String,
    corners_px: [[f64; 2]; 4],
    decision_margin: f64,
}

/// Reads one line that arrived at `received_at`; `image_sizes_px` has width and height per camera.
///
/// # Errors
/// Why the line is not taken.
pub fn read_line(
    line: &[u8],
    received_at: Stamp<Mono>,
    image_sizes_px: &[[u32; 2]],
) -> Result<TagDetections, Refusal> {
    if line.len() > MAX_LINE_BYTES {
        return Err(Refusal::TooLong { limit: MAX_LINE_BYTES });
    }
    let frame: FrameLine = serde_json::from_slice(line)
        .map_err(|error| Refusal::Malformed { cause: error.to_string() })?;
    if frame.clock != "mono" {
        return Err(Refusal::UnknownClock { clock: frame.clock });
    }
    let size_px = image_sizes_px
        .get(usize::from(frame.camera))
        .ok_or(Refusal::UnknownCamera { camera: frame.camera, n_cameras: image_sizes_px.len() })?;
    if frame.tags.len() > MAX_TAGS {
        return Err(Refusal::TooManyTags { got: frame.tags.len(), limit: MAX_TAGS });
    }
    if frame.points.len() > MAX_POINTS {
        return Err(Refusal::TooManyPoints { got: frame.points.len(), limit: MAX_POINTS });
    }
    let captured_at = Stamp::from_nanos(frame.captured_at_ns);
    check_age(captured_at, received_at)?;
    let tags =
        frame.tags.into_iter().map(|tag| read_tag(tag, *size_px)).collect::<Result<_, _>>()?;
    let points = frame
        .points
        .into_iter()
        .map(|point| read_point(&point, *size_px))
        .collect::<Result<_, _>>()?;
    let camera = CameraId(frame.camera);
    Ok(TagDetections { captured_at, received_at, camera, tags, points })
}

/// A stamp must not lie ahead of its arrival nor far before it.
pub(super) fn check_age(captured_at: Stamp<Mono>, received_at: Stamp<Mono>) -> Result<(), Refusal> {
    let age_s = received_at.seconds_since(captured_at);
    if captured_at.since(received_at) > MAX_AHEAD {
        return Err(Refusal::FromTheFuture { ahead_s: -age_s });
    }
    if received_at.since(captured_at) > MAX_AGE {
        return Err(Refusal::TooOld { age_s });
    }
    Ok(())
}

fn read_tag(tag: TagLine, size_px: [u32; 2]) -> Result<TagDetection, Refusal> {
    let Some(family) = TagFamily::from_name(&tag.family) else {
        return Err(Refusal::UnknownFamily { family: tag.family });
    };
    for [u, v] in tag.corners_px {
        if !is_near([u, v], size_px) {
            return Err(Refusal::FarCorner { id: tag.id, u, v });
        }
    }
    Ok(TagDetection {
        id: tag.id,
        family,
        corners_px: tag.corners_px,
        decision_margin: tag.decision_margin,
    })
}

fn read_point(point: &PointLine, size_px: [u32; 2]) -> Result<PointDetection, Refusal> {
    let [u, v] = point.pixel_px;
    if !is_near([u, v], size_px) {
        return Err(Refusal::FarPoint { id: point.id, u, v });
    }
    Ok(PointDetection { id: point.id, pixel_px: [u, v] })
}

fn is_near([u, v]: [f64; 2], [width_px, height_px]: [u32; 2]) -> bool {
    let is_near = |at: f64, size: u32| at.abs() <= MAX_IMAGE_SIZES * f64::from(size);
    is_near(u, width_px) && is_near(v, height_px)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZES: [[u32; 2]; 1] = [[1280, 720]];
    const GOOD: &str = r#"{"captured_at_ns":900000000,"clock":"mono","camera":0,"tags":[{"id":7,
        "family":"tag36h11","corners_px":[[1.5,2],[3,4],[5,6],[7,-8.25]],"decision_margin":80.1}]}"#;

    fn read(line: &str) -> Result<TagDetections, Refusal> {
        read_line(line.as_bytes(), Stamp::from_nanos(1_000_000_000), &SIZES)
    }

    fn refusal_of(from: &str, to: &str) -> Refusal {
        assert!(GOOD.contains(from), "{from}");
        read(&GOOD.replace(from, to)).unwrap_err()
    }

    #[test]
    fn a_frame_is_read_to_the_last_digit() {
        let frame = read(GOOD).unwrap();
        assert_eq!(frame.captured_at, Stamp::from_nanos(900_000_000));
        assert_eq!(frame.received_at, Stamp::from_nanos(1_000_000_000));
        let expected = TagDetection {
            id: 7,
            family: TagFamily::Tag36h11,
            corners_px: [[1.5, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, -8.25]],
            decision_margin: 80.1,
        };
        assert_eq!(frame.tags, [expected]);
    }

    #[test]
    fn each_fault_has_its_reason() {
        assert!(matches!(refusal_of("mono", "boot"), Refusal::UnknownClock { .. }));
        assert!(matches!(
            refusal_of("\"camera\":0", "\"camera\":1"),
            Refusal::UnknownCamera { camera: 1, n_cameras: 1 }
        ));
        assert!(matches!(refusal_of("36h11", "36h12"), Refusal::UnknownFamily { .. }));
        assert!(matches!(refusal_of("[1.5,2]", "[12801,2]"), Refusal::FarCorner { id: 7, .. }));
        assert!(matches!(refusal_of("[3,4]", "[3]"), Refusal::Malformed { .. }));
        assert!(matches!(refusal_of("[3,4]", "[NaN,4]"), Refusal::Malformed { .. }));
        assert!(matches!(refusal_of("80.1", "1e999"), Refusal::Malformed { .. }));
        assert!(matches!(refusal_of("80.1}", "80.1"), Refusal::Malformed { .. }));
        assert!(matches!(refusal_of("\"id\":7", "\"id\":-7"), Refusal::Malformed { .. }));
    }

    #[test]
    fn points_may_stand_beside_tags() {
        let with = |points: &str| {
            read(&GOOD.replace("\"tags\":", &format!("\"points\":{points},\"tags\":")))
        };
        let frame =
            with(r#"[{"id":12,"pixel_px":[100.25,-3]},{"id":4,"pixel_px":[7,8]}]"#).unwrap();
        let expected = [
            PointDetection { id: 12, pixel_px: [100.25, -3.0] },
            PointDetection { id: 4, pixel_px: [7.0, 8.0] },
        ];
        assert_eq!(frame.points, expected);
        assert_eq!(frame.tags.len(), 1);
        assert_eq!(read(GOOD).unwrap().points, []);
        let far = with(r#"[{"id":12,"pixel_px":[100.25,7201]}]"#).unwrap_err();
        assert!(matches!(far, Refusal::FarPoint { id: 12, .. }));
        let crowd = format!("[{}]", vec![r#"{"id":1,"pixel_px":[1,2]}"#; 1025].join(","));
        assert_eq!(with(&crowd), Err(Refusal::TooManyPoints { got: 1025, limit: 1024 }));
        assert!(matches!(with(r#"[{"id":1}]"#), Err(Refusal::Malformed { .. })));
    }

    #[test]
    fn captures_are_bound_to_their_arrival() {
        let at = |ns: i64| read(&GOOD.replace("900000000", &ns.to_string()));
        assert!(at(1_005_000_000).is_ok());
        assert!(matches!(at(1_005_000_001), Err(Refusal::FromTheFuture { .. })));
        assert!(at(-9_000_000_000).is_ok());
        assert!(matches!(at(-9_000_000_001), Err(Refusal::TooOld { .. })));
        assert!(matches!(at(i64::MAX), Err(Refusal::FromTheFuture { .. })));
        assert!(matches!(at(i64::MIN), Err(Refusal::TooOld { .. })));
    }

    #[test]
    fn crowds_are_refused() {
        let tag = &GOOD[GOOD.find("{\"id\"").unwrap()..GOOD.len() - 2];
        let crowd = |n: usize| GOOD.replace(tag, &vec![tag; n].join(","));
        assert_eq!(read(&crowd(256)).unwrap().tags.len(), 256);
        assert_eq!(read(&crowd(257)), Err(Refusal::TooManyTags { got: 257, limit: 256 }));
        assert!(matches!(read(&" ".repeat(MAX_LINE_BYTES + 1)), Err(Refusal::TooLong { .. })));
    }
}
