//! What a program answers.

use crate::geometry::Point;
use crate::planning::Waypoint;
use crate::planning::external::Proposal;
use serde::Deserialize;

/// The answer as it stands on stdout.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct AnswerTwin {
    waypoints: Vec<WaypointTwin>,
    #[serde(default)]
    is_complete: bool,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WaypointTwin {
    x_m: f64,
    y_m: f64,
    z_m: f64,
    yaw_rad: f64,
}

/// Reads an answer: one JSON object, nothing before and nothing behind it but white space.
///
/// # Errors
/// A sentence about what is wrong with it.
pub fn decoded(text: &[u8]) -> Result<Proposal, String> {
    if text.iter().all(u8::is_ascii_whitespace) {
        return Err("it says nothing".to_owned());
    }
    let answer: AnswerTwin = serde_json::from_slice(text)
        .map_err(|error| format!("its answer is not what it should be: {error}"))?;
    let waypoint = |twin: &WaypointTwin| Waypoint {
        place: Point::new(twin.x_m, twin.y_m, twin.z_m),
        yaw_rad: twin.yaw_rad,
    };
    let waypoints = answer.waypoints.iter().map(waypoint).collect();
    Ok(Proposal { waypoints, is_complete: answer.is_complete })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_one_object_with_nothing_around_it() {
        let text = br#" {"waypoints":[{"x_m":1.5,"y_m":2,"z_m":7,"yaw_rad":-0.5}]} "#;
        let proposal = decoded(text).unwrap();
        let waypoint = Waypoint { place: Point::new(1.5, 2.0, 7.0), yaw_rad: -0.5 };
        assert_eq!(proposal, Proposal { waypoints: vec![waypoint], is_complete: false });
        let done = decoded(br#"{"waypoints":[],"is_complete":true}"#).unwrap();
        assert!(done.is_complete && done.waypoints.is_empty());
    }

    #[test]
    fn everything_else_is_refused_with_a_reason() {
        let place = r#"{"x_m":1,"y_m":2,"z_m":7,"yaw_rad":0"#;
        let wrong = [
            String::new(),
            " \n".to_owned(),
            "hello".to_owned(),
            "[]".to_owned(),
            "{}".to_owned(),
            r#"{"waypoints":[]} {"waypoints":[]}"#.to_owned(),
            r#"{"waypoints":[],"speed":3}"#.to_owned(),
            format!(r#"{{"waypoints":[{place},"roll_rad":0}}]}}"#),
            r#"{"waypoints":[{"x_m":1,"y_m":2,"z_m":7}]}"#.to_owned(),
            r#"{"waypoints":[{"x_m":NaN,"y_m":2,"z_m":7,"yaw_rad":0}]}"#.to_owned(),
            r#"{"waypoints":[{"x_m":1e999,"y_m":2,"z_m":7,"yaw_rad":0}]}"#.to_owned(),
            format!(r#"{{"waypoints":[{place}}}"#),
        ];
        for text in wrong {
            let reason = decoded(text.as_bytes()).expect_err(&text);
            assert!(!reason.is_empty() && !reason.contains('\n'), "{reason}");
        }
    }
}
