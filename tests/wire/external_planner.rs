//! Programs that plan: a good one, and all the ways in which one can fail.

use crate::support::until;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use stockpilot::config::Config;
use stockpilot::geometry::Point;
use stockpilot::mapping::Mapper;
use stockpilot::messages::VolumeEstimate;
use stockpilot::pilot::{Job, JobOutput, Settings};
use stockpilot::planning::external::ExternalSettings;
use stockpilot::planning::free_space::FreeSpace;
use stockpilot::planning::planner::{Belief, Plan, PlanEnd, PlanRequest};
use stockpilot::planning::{PlannerKind, Waypoint};
use stockpilot::service::external_planner::{question, run_and_wait};
use stockpilot::time::Stamp;

/// The example's hall, with fixes good enough everywhere that a marker is seen.
fn request(command: &[&str], time_limit: Duration) -> PlanRequest {
    let example = include_str!("../../deploy/config.example.toml");
    let mut config = Config::from_toml(example, "config.example.toml".as_ref()).unwrap();
    config.planning.min_fix_quality = 0.1;
    let Settings { localization, mapping, mut planning, .. } = config.pilot_settings().unwrap();
    planning.planner = PlannerKind::External;
    let command = command.iter().map(|&word| word.to_owned()).collect();
    planning.external = Some(ExternalSettings { command, time_limit });
    let mapper = Mapper::new(mapping.clone());
    let free_space =
        FreeSpace::evaluate(&planning, &localization.cameras, &localization.marker_map, 0.5);
    PlanRequest {
        pending: vec![Waypoint { place: Point::new(6.0, 10.0, 7.0), yaw_rad: 0.0 }],
        current: Vec::new(),
        n_waypoints: 30,
        longest_m: Some(200.0),
        over_home: Some(Point::new(6.0, 10.0, 7.0)),
        free_space: Arc::new(free_space),
        lidar: mapping.lidar,
        belief: Belief::Grid {
            cells: Box::new(mapper.grid().clone()),
            areas_m2: mapper.base().cell_areas_m2.clone().into(),
        },
        volume_m3: 600.0,
        constant_var_m6: 0.0,
        accounted: Some(VolumeEstimate {
            at: Stamp::ZERO,
            volume_m3: 600.0,
            sigma_m3: 31.0,
            coverage_ratio: 0.1,
        }),
        settings: planning,
    }
}

fn asked(command: &[&str], time_limit: Duration) -> Result<Plan, String> {
    match run_and_wait(Job::Plan(Box::new(request(command, time_limit)))) {
        JobOutput::PlannedOutside(found) => found,
        other => panic!("{other:?}"),
    }
}

/// What a shell script comes to.
fn script(text: &str) -> Result<Plan, String> {
    asked(&["sh", "-c", text], Duration::from_secs(20))
}

const TWO_METRES_ON: &str =
    r#"{"waypoints":[{"x_m":8.0,"y_m":10.0,"z_m":7.0,"yaw_rad":0.0}],"is_complete":true}"#;

#[test]
fn the_example_in_python_plans_a_survey() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/planners/nearest_unseen.py");
    let plan = asked(&["python3", path.to_str().unwrap()], Duration::from_secs(60)).unwrap();
    assert!(plan.waypoints.len() > 5 && plan.waypoints.len() <= 30, "{plan:?}");
    let request = request(&["-"], Duration::from_secs(1));
    let mut from = request.pending[0];
    for to in &plan.waypoints {
        assert!(request.free_space.is_way_free(&from, to), "{from:?} to {to:?}");
        from = *to;
    }
    // It wants to see what it has not seen: the plan leads away, and over different places.
    assert!(plan.waypoints.iter().any(|w| w.distance_m(&request.pending[0]) > 4.0), "{plan:?}");
}

#[test]
fn a_question_says_what_the_documentation_says() {
    let request = request(&["-"], Duration::from_secs(1));
    let text = question::encoded(&request).unwrap();
    assert_eq!(text.iter().filter(|byte| **byte == b'\n').count(), 1, "one line");
    let asked: serde_json::Value = serde_json::from_slice(&text).unwrap();
    let schema = include_str!("../../src/service/external_planner/schema.md");
    let example = schema.split("```").nth(1).unwrap().trim_start_matches("json");
    let documented: serde_json::Value = serde_json::from_str(example).unwrap();
    same_keys("", &documented, &asked);
    let map = &asked["map"];
    let n_cells = map["n_cols"].as_u64().unwrap() * map["n_rows"].as_u64().unwrap();
    for list in ["mean_m", "sigma_m", "area_m2", "n_hits"] {
        assert_eq!(map[list].as_array().unwrap().len() as u64, n_cells, "{list}");
    }
    assert_eq!(asked["sigma_m3"], 31.0);
    assert_eq!(asked["longest_m"], 200.0);
    let n_feasible = request.free_space.feasible().count();
    assert!(n_feasible > 20);
    assert_eq!(asked["candidates"].as_array().unwrap().len(), n_feasible);
}

/// Every key of one stands in the other, all the way down; of a list the first entries count.
fn same_keys(at: &str, documented: &serde_json::Value, asked: &serde_json::Value) {
    match (documented, asked) {
        (serde_json::Value::Object(documented), serde_json::Value::Object(asked)) => {
            let keys = |map: &serde_json::Map<String, _>| map.keys().cloned().collect::<Vec<_>>();
            let (mut left, mut right) = (keys(documented), keys(asked));
            left.sort();
            right.sort();
            assert_eq!(left, right, "at {at}");
            for (key, value) in documented {
                same_keys(&format!("{at}/{key}"), value, &asked[key]);
            }
        }
        (serde_json::Value::Array(documented), serde_json::Value::Array(asked)) => {
            if let (Some(documented), Some(asked)) = (documented.first(), asked.first()) {
                same_keys(&format!("{at}/0"), documented, asked);
            }
        }
        _ => {}
    }
}

#[test]
fn an_answer_of_a_program_that_does_not_listen_counts() {
    let plan = script(&format!("echo '{TWO_METRES_ON}'")).unwrap();
    assert_eq!((plan.waypoints.len(), plan.end), (1, PlanEnd::Complete));
    // And one that reads everything first.
    assert_eq!(script(&format!("cat > /dev/null; echo '{TWO_METRES_ON}'")), Ok(plan));
}

#[test]
fn every_failure_is_a_sentence_for_people() {
    let nowhere = TWO_METRES_ON.replace("8.0", "800.0");
    let failures = [
        ("exit 3", "exit status: 3"),
        ("echo 'no idea where to go' >&2; exit 1", "exit status: 1: no idea where to go"),
        ("kill -9 $$", "signal: 9"),
        ("cat > /dev/null", "it says nothing"),
        ("echo hello", "its answer is not what it should be"),
        (&format!("echo '{TWO_METRES_ON}'; exit 4"), "exit status: 4"),
        (&format!("echo '{nowhere}'"), "waypoint 0 is not in free space"),
        (r#"echo '{"waypoints":[]}'"#, "no waypoint, and not complete"),
        // Without end, on either stream.
        ("yes", "it says more than 1048576 bytes"),
        (&format!("yes | head -c 9000000 >&2; echo '{TWO_METRES_ON}'; exit 5"), "exit status: 5"),
    ];
    for (text, expected) in failures {
        let reason = script(text).expect_err(text);
        assert!(reason.contains(expected), "{text}: {reason}");
        assert!(reason.chars().count() < 250 && !reason.contains('\n'), "{reason}");
    }
    let reason = asked(&["/nonexistent/planner"], Duration::from_secs(20)).unwrap_err();
    assert!(reason.contains("cannot start /nonexistent/planner"), "{reason}");
}

#[test]
fn a_program_that_hangs_is_ended_with_everything_it_started() {
    let folder = tempfile::tempdir().unwrap();
    let pids = folder.path().join("pids");
    // It closes its own streams, but its child keeps them open.
    let text = format!("sleep 1000 & echo $! > {0}; echo $$ >> {0}; wait", pids.display());
    let reason = asked(&["sh", "-c", &text], Duration::from_secs(2)).unwrap_err();
    assert_eq!(reason, "no answer within 2.0 s");
    let started = std::fs::read_to_string(&pids).unwrap();
    assert_eq!(started.lines().count(), 2);
    // Gone, or dead and not yet collected by its new parent; a killed process takes a moment to die.
    let is_dead = |pid: &str| {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        stat.is_empty() || stat.contains(") Z ") || stat.contains(") X ")
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
    runtime.block_on(until(|| started.lines().all(is_dead)));
}
