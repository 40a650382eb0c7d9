//! One log with a message on every channel that a recorder fills.

use crate::support::{imu_event, write_log};
use nalgebra::{Matrix6, SMatrix, Vector3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use stockpilot::geometry::{Body, Direction, Hall, Point, Rotation, Transform};
use stockpilot::messages::{
    AutopilotPose, BatterySample, Beam, BudgetRow, BudgetSource, CameraId, CommandOutcome,
    FixOutcome, FixRecord, FixSource, FlightMode, GridGeometry, HeightMap, HitCounts, LandedState,
    Mass, NavEstimate, OperatorAnswer, OperatorCommand, OperatorRequest, OperatorVerb,
    PointDetection, Room, Scan, Setpoint, Severity, SharedSensitivity, StatusText, StorageState,
    TagDetection, TagDetections, TagFamily, TakeOff, VehicleCommand, VehicleState, Verdict,
    VolumeAccount, VolumeBudget, VolumeEstimate, VolumeShares,
};
use stockpilot::mission::Phase;
use stockpilot::pilot::{Action, Event, FlightSummary, PhaseChange, PlanChoice, VolumeReport};
use stockpilot::planning::Waypoint;
use stockpilot::planning::planner::{PlanEnd, Prediction};
use stockpilot::record::{LogItem, LogReader, Topic};
use stockpilot::time::{Mono, Stamp};

const AT: Stamp<Mono> = Stamp::from_nanos(2_000_000_123);

fn pose() -> Transform<Hall, Body> {
    Transform::new(Rotation::from_euler_rad(0.1, -0.2, 2.0), Point::new(1.5, -2.5, 3.25))
}

fn operator() -> OperatorRequest {
    OperatorRequest { system: 255, component: 190 }
}

fn events() -> Vec<Event> {
    let beam = |i: u16| Beam {
        offset_ns: u32::from(i) * 222_222,
        angle_rad: 3.0 - f32::from(i) * 0.1,
        range_m: 2.0,
        intensity: 7,
    };
    let tag = TagDetection {
        id: 4,
        family: TagFamily::Tag25h9,
        corners_px: [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0]],
        decision_margin: 61.5,
    };
    vec![
        Event::Ticked(AT),
        imu_event(3),
        Event::Scanned(Scan { start: AT, beams: (0..60).map(beam).collect() }),
        Event::TagsSeen(TagDetections {
            captured_at: AT,
            received_at: AT,
            camera: CameraId(1),
            tags: vec![tag],
            points: vec![PointDetection { id: 9, pixel_px: [3.25, -7.5] }],
        }),
        Event::Vehicle(VehicleState {
            at: AT,
            is_armed: true,
            mode: FlightMode::Other(17),
            landed: LandedState::InAir,
            in_failsafe: false,
            is_ready: true,
            is_contested: false,
            is_mode_prompt: true,
            takes_off: TakeOff::ByCommand,
        }),
        Event::AutopilotRebooted(AT),
        Event::Battery(BatterySample {
            at: AT,
            voltage_v: 15.2,
            current_a: 11.0,
            remaining_ratio: 0.5,
        }),
        Event::AutopilotPose(AutopilotPose {
            at: AT,
            position: Point::new(1.0, 2.0, 3.0),
            velocity_mps: Direction::zero(),
            hall_from_body_rot: Some(pose().rotation),
        }),
        Event::CommandAnswered(CommandOutcome {
            at: AT,
            command: VehicleCommand::EnterCompanionMode,
            is_accepted: true,
        }),
        Event::Operator(OperatorCommand { at: AT, verb: OperatorVerb::Start, from: operator() }),
        Event::AutopilotLost(AT),
        Event::StorageLooked(StorageState {
            at: AT,
            room: Room::Low,
            free_bytes: Some(1_900_000_000),
            survey_bytes: 200_000_000,
            records_lost: 3,
            has_log_failed: false,
        }),
    ]
}

fn account() -> VolumeAccount {
    let mut budget = VolumeBudget::default();
    for source in BudgetSource::ALL {
        budget.rows.push(BudgetRow { source, var_m6: 0.25 });
    }
    let shared = SharedSensitivity {
        source: BudgetSource::RangeBias,
        component: 0,
        dv_dc: -38.5,
        sigma: 0.01,
    };
    budget.shared.push(shared);
    let shares = VolumeShares {
        measured_ratio: 0.5,
        interpolated_ratio: 0.125,
        unseen_ratio: 0.125,
        disturbed_ratio: 0.25,
    };
    VolumeAccount {
        name: "hall".to_owned(),
        estimate: volume(),
        mass: Some(Mass { mass_t: 48.3, sigma_t: 0.9 }),
        budget,
        shares,
    }
}

fn volume() -> VolumeEstimate {
    VolumeEstimate { at: AT, volume_m3: 40.25, sigma_m3: 0.5, coverage_ratio: 0.75 }
}

fn nav() -> NavEstimate {
    NavEstimate {
        at: AT,
        hall_from_body: pose(),
        velocity_mps: Direction::new(0.5, 0.0, 0.0),
        gyro_radps: Vector3::new(0.0, 0.0, 0.25),
        gyro_bias_radps: Vector3::zeros(),
        accel_bias_mps2: Vector3::zeros(),
        // Row 1, column 2 holds 17, so the order of the list shows.
        error_cov: SMatrix::from_fn(|row, col| if (row, col) == (1, 2) { 17.0 } else { 0.0 }),
        reset_counter: 3,
    }
}

fn fix() -> FixRecord {
    FixRecord {
        at: AT,
        age_s: 0.05,
        source: FixSource::Tight,
        n_tags: 2,
        n_tags_used: 1,
        n_points: 4,
        n_points_used: 3,
        fix: Some(FixOutcome {
            hall_from_body: pose(),
            pose_cov: Matrix6::identity(),
            residual_rms_px: 0.25,
            n_points: 8,
            q_pos: 12.5,
            q_position: 14.25,
        }),
        innovation: Some([0.5; 6]),
        innovation_cov: Some([[0.25; 6]; 6]),
        nis: None,
        nis_gate: 16.8119,
        verdict: Verdict::Fused,
    }
}

fn surface() -> HeightMap {
    let grid = GridGeometry { x_min_m: -1.0, y_min_m: -2.0, cell_m: 0.5, n_cols: 3, n_rows: 2 };
    HeightMap {
        at: AT,
        grid,
        mean_m: vec![0.5; 6],
        sigma_m: vec![0.25; 6],
        disturbed_cells: vec![4],
    }
}

fn actions() -> Vec<Action> {
    let setpoint = Setpoint {
        at: AT,
        position: Point::new(1.0, 2.0, 3.0),
        velocity_mps: Direction::zero(),
        accel_mps2: Direction::zero(),
        yaw_rad: 0.5,
        yaw_rate_radps: 0.0,
    };
    let report = VolumeReport {
        estimate: volume(),
        hits: HitCounts::default(),
        phase: Phase::Survey,
        steps_done: 4,
        battery_ratio: Some(0.5),
        position_sigma_m: None,
        is_final: false,
    };
    let change = PhaseChange {
        at: AT,
        from: Phase::TakeOff,
        to: Phase::Survey,
        reason: "height reached".into(),
    };
    let summary = FlightSummary {
        at: AT,
        volume: volume(),
        accounts: vec![account()],
        hits: HitCounts::default(),
        steps_done: 4,
        path_length_m: 31.5,
        is_complete: true,
        is_final: true,
    };
    let plan = PlanChoice {
        at: AT,
        ahead: vec![Waypoint { place: Point::new(1.0, 2.0, 7.0), yaw_rad: 0.5 }],
        end: PlanEnd::SmallGain,
        prediction: Some(Prediction { sigma_now_m3: 9.0, sigma_end_m3: 1.5, length_m: 12.0 }),
    };
    vec![
        Action::Steer(setpoint),
        Action::PublishOdometry(Box::new(nav())),
        Action::PublishSight(Box::new(nav())),
        Action::Command(VehicleCommand::EnterLand),
        Action::ReportVolume(report),
        Action::Say(StatusText { severity: Severity::Warning, text: "battery \"low\"".into() }),
        Action::Answer(OperatorAnswer {
            verb: OperatorVerb::Start,
            to: operator(),
            is_accepted: true,
        }),
        Action::PhaseChanged(change),
        Action::FixTreated(Box::new(fix())),
        Action::SurfaceSolved(Box::new(surface())),
        Action::VolumesAccounted(vec![account()]),
        Action::PlanChosen(Box::new(plan)),
        Action::Ended(Box::new(summary)),
    ]
}

/// Kept behind the tests, for readers in other languages.
fn written_log() -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("every_channel.mcap");
    if path.exists() {
        std::fs::remove_file(&path).unwrap();
    }
    let mut steps: Vec<_> = events().into_iter().map(|event| (event, vec![])).collect();
    steps.last_mut().unwrap().1 = actions();
    write_log(&path, &steps);
    path
}

#[test]
fn results_are_recorded_with_their_units_and_names() {
    let path = written_log();
    let mut results = BTreeMap::new();
    let mut seen = Vec::new();
    for item in LogReader::open(&path).unwrap() {
        match item {
            LogItem::Result { topic, json, .. } => {
                let message: serde_json::Value = serde_json::from_slice(&json).unwrap();
                results.insert(topic, message);
            }
            LogItem::Event { event, .. } => seen.push(event),
            _ => {}
        }
    }
    assert_eq!(seen.len(), 12);
    assert_eq!(results.len(), 13);
    let of = |topic: Topic| &results[&topic];
    assert_eq!(of(Topic::Setpoint)["position_m"], serde_json::json!([1.0, 2.0, 3.0]));
    assert_eq!(of(Topic::Command)["command"], "enter_land");
    assert_eq!(of(Topic::Odometry)["error_cov"][17], 17.0);
    assert_eq!(of(Topic::Odometry)["hall_from_body"]["origin_m"][2], 3.25);
    assert_eq!(of(Topic::Volume)["estimate"]["volume_m3"], 40.25);
    assert_eq!(of(Topic::Volume)["position_sigma_m"], serde_json::Value::Null);
    assert_eq!(of(Topic::Text)["text"], "battery \"low\"");
    assert_eq!(of(Topic::Phase)["to"], "survey");
    assert_eq!(of(Topic::Fix)["verdict"], "fused");
    assert_eq!(of(Topic::Fix)["fix"]["q_pos"], 12.5);
    assert_eq!(of(Topic::Sight), of(Topic::Odometry));
    assert_eq!(of(Topic::Surface)["grid"]["n_cols"], 3);
    assert_eq!(of(Topic::Plan)["end"], "small_gain");
    assert_eq!(of(Topic::Plan)["ahead"][0]["z_m"], 7.0);
    assert_eq!(of(Topic::Plan)["prediction"]["sigma_end_m3"], 1.5);
    assert_eq!(of(Topic::Ended)["path_length_m"], 31.5);
}

#[test]
fn viewers_find_every_derived_channel() {
    // Read by the MCAP library itself: the project's own reader passes over these channels.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let steps = vec![(events().remove(2), actions())];
    write_log(&path, &steps);
    let bytes = std::fs::read(&path).unwrap();
    let mut views = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        if message.channel.message_encoding == "protobuf" {
            let schema = message.channel.schema.as_ref().unwrap().name.clone();
            views.insert(message.channel.topic.clone(), (schema, message.data.len()));
        }
    }
    let names: Vec<_> = views.iter().map(|(topic, (schema, _))| (&**topic, &**schema)).collect();
    let expected = [
        ("/tf", "foxglove.FrameTransforms"),
        ("/view/log", "foxglove.Log"),
        ("/view/pose", "foxglove.PoseInFrame"),
        ("/view/scan", "foxglove.LaserScan"),
        ("/view/surface", "foxglove.Grid"),
    ];
    assert_eq!(names, expected);
    // Six cells of two single-precision numbers, and the head of the message.
    assert!(views["/view/surface"].1 > 48);
}
