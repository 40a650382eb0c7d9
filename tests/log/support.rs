//! Any event, and logs of them.

use proptest::collection::vec;
use proptest::num::f64::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
use proptest::prelude::{Just, Strategy, any, prop_oneof};
use std::path::Path;
use stockpilot::geometry::{Direction, Point, Rotation};
use stockpilot::messages::{
    AutopilotPose, BatterySample, Beam, CameraId, CommandOutcome, FlightMode, ImuSample,
    LandedState, OperatorCommand, OperatorRequest, OperatorVerb, PointDetection, Room, Scan,
    StorageState, TagDetection, TagDetections, TagFamily, TakeOff, VehicleCommand, VehicleState,
};
use stockpilot::pilot::{Action, Event};
use stockpilot::record::{LogHeader, LogItem, LogReader, RecordedEvent, Recorder, RecorderStats};
use stockpilot::time::{Mono, Stamp};

/// Any finite number, the smallest and both zeros included.
fn finite() -> impl Strategy<Value = f64> {
    POSITIVE | NEGATIVE | NORMAL | SUBNORMAL | ZERO
}

fn finite_single() -> impl Strategy<Value = f32> {
    use proptest::num::f32::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    POSITIVE | NEGATIVE | NORMAL | SUBNORMAL | ZERO
}

fn stamp() -> impl Strategy<Value = Stamp<Mono>> {
    any::<i64>().prop_map(Stamp::from_nanos)
}

fn coords() -> impl Strategy<Value = [f64; 3]> {
    [finite(), finite(), finite()]
}

fn imu() -> impl Strategy<Value = ImuSample> {
    (stamp(), coords(), coords()).prop_map(|(at, accel, gyro)| ImuSample {
        at,
        accel_mps2: accel.into(),
        gyro_radps: gyro.into(),
    })
}

fn scan() -> impl Strategy<Value = Scan> {
    let beam = (any::<u32>(), finite_single(), finite_single(), any::<u8>()).prop_map(
        |(offset_ns, angle_rad, range_m, intensity)| Beam {
            offset_ns,
            angle_rad,
            range_m,
            intensity,
        },
    );
    (stamp(), vec(beam, 0..20)).prop_map(|(start, beams)| Scan { start, beams })
}

fn tags() -> impl Strategy<Value = TagDetections> {
    let family =
        prop_oneof![Just(TagFamily::Tag36h11), Just(TagFamily::Tag25h9), Just(TagFamily::Tag16h5)];
    let corner = || [finite(), finite()];
    let corners = [corner(), corner(), corner(), corner()];
    let tag = (any::<u32>(), family, corners, finite()).prop_map(
        |(id, family, corners_px, decision_margin)| TagDetection {
            id,
            family,
            corners_px,
            decision_margin,
        },
    );
    let point = (any::<u32>(), [finite(), finite()])
        .prop_map(|(id, pixel_px)| PointDetection { id, pixel_px });
    (stamp(), stamp(), any::<u8>(), vec(tag, 0..5), vec(point, 0..5)).prop_map(
        |(captured_at, received_at, camera, tags, points)| TagDetections {
            captured_at,
            received_at,
            camera: CameraId(camera),
            tags,
            points,
        },
    )
}

fn vehicle() -> impl Strategy<Value = VehicleState> {
    let mode = prop_oneof![
        Just(FlightMode::Companion),
        Just(FlightMode::Hold),
        Just(FlightMode::Land),
        Just(FlightMode::TakeOff),
        Just(FlightMode::Return),
        Just(FlightMode::Pilot),
        any::<u32>().prop_map(FlightMode::Other),
    ];
    let landed = prop_oneof![
        Just(LandedState::Unknown),
        Just(LandedState::OnGround),
        Just(LandedState::TakingOff),
        Just(LandedState::InAir),
        Just(LandedState::Landing),
    ];
    let takes_off = prop_oneof![Just(TakeOff::BySetpoints), Just(TakeOff::ByCommand)];
    (stamp(), any::<[bool; 5]>(), mode, landed, takes_off).prop_map(
        |(at, flags, mode, landed, takes_off)| {
            let [is_armed, in_failsafe, is_ready, is_contested, is_mode_prompt] = flags;
            VehicleState {
                at,
                is_armed,
                mode,
                landed,
                in_failsafe,
                is_ready,
                is_contested,
                is_mode_prompt,
                takes_off,
            }
        },
    )
}

fn battery() -> impl Strategy<Value = BatterySample> {
    (stamp(), finite(), finite(), finite()).prop_map(
        |(at, voltage_v, current_a, remaining_ratio)| BatterySample {
            at,
            voltage_v,
            current_a,
            remaining_ratio,
        },
    )
}

fn autopilot_pose() -> impl Strategy<Value = AutopilotPose> {
    let angle = || -3.0..3.0_f64;
    let rotation =
        (angle(), angle(), angle()).prop_map(|(r, p, y)| Rotation::from_euler_rad(r, p, y));
    (stamp(), coords(), coords(), proptest::option::of(rotation)).prop_map(
        |(at, [x, y, z], [u, v, w], hall_from_body_rot)| AutopilotPose {
            at,
            position: Point::new(x, y, z),
            velocity_mps: Direction::new(u, v, w),
            hall_from_body_rot,
        },
    )
}

fn outcome() -> impl Strategy<Value = CommandOutcome> {
    let command = prop_oneof![
        Just(VehicleCommand::Arm),
        Just(VehicleCommand::Disarm),
        Just(VehicleCommand::EnterCompanionMode),
        Just(VehicleCommand::EnterHold),
        Just(VehicleCommand::EnterLand),
        Just(VehicleCommand::TakeOff),
    ];
    (stamp(), command, any::<bool>()).prop_map(|(at, command, is_accepted)| CommandOutcome {
        at,
        command,
        is_accepted,
    })
}

fn operator() -> impl Strategy<Value = OperatorCommand> {
    let verb = prop_oneof![
        Just(OperatorVerb::Start),
        Just(OperatorVerb::Hold),
        Just(OperatorVerb::Resume),
        Just(OperatorVerb::Return),
        Just(OperatorVerb::Land),
    ];
    (stamp(), verb, any::<u8>(), any::<u8>()).prop_map(|(at, verb, system, component)| {
        OperatorCommand { at, verb, from: OperatorRequest { system, component } }
    })
}

fn storage() -> impl Strategy<Value = StorageState> {
    let room = prop_oneof![Just(Room::Enough), Just(Room::Low), Just(Room::TooLittle)];
    let bytes = (any::<Option<u64>>(), any::<u64>(), any::<u64>());
    (stamp(), room, bytes, any::<bool>()).prop_map(|(at, room, bytes, has_log_failed)| {
        let (free_bytes, survey_bytes, records_lost) = bytes;
        StorageState { at, room, free_bytes, survey_bytes, records_lost, has_log_failed }
    })
}

/// Any event but a finished job, with any finite numbers.
pub(crate) fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        stamp().prop_map(Event::Ticked),
        imu().prop_map(Event::Imu),
        scan().prop_map(Event::Scanned),
        tags().prop_map(Event::TagsSeen),
        vehicle().prop_map(Event::Vehicle),
        battery().prop_map(Event::Battery),
        autopilot_pose().prop_map(Event::AutopilotPose),
        outcome().prop_map(Event::CommandAnswered),
        operator().prop_map(Event::Operator),
        stamp().prop_map(Event::AutopilotLost),
        storage().prop_map(Event::StorageLooked),
    ]
}

/// Writes a log: each event, and behind it the actions that belong to it.
pub(crate) fn write_log(path: &Path, steps: &[(Event, Vec<Action>)]) -> RecorderStats {
    let header = LogHeader { config_toml: "answer = 42\n".into(), ..LogHeader::default() };
    let mut recorder = Recorder::create(path, &header).unwrap();
    for (i, (event, actions)) in steps.iter().enumerate() {
        let at = Stamp::from_nanos(i64::try_from(i).unwrap() * 1_000_000);
        recorder.event(at, event);
        actions.iter().for_each(|action| recorder.result(at, action));
    }
    recorder.close()
}

/// All plain events of a log, in order, and whether the log is complete.
pub(crate) fn events_of(bytes: &[u8]) -> (Vec<Event>, bool) {
    let mut reader = LogReader::new(bytes);
    let events = reader
        .by_ref()
        .filter_map(|item| match item {
            LogItem::Event { event: RecordedEvent::Plain(event), .. } => Some(event),
            _ => None,
        })
        .collect();
    (events, reader.is_complete())
}

/// An inertial sample that differs from every other.
pub(crate) fn imu_event(n: u32) -> Event {
    Event::Imu(ImuSample {
        at: Stamp::from_nanos(i64::from(n) * 5_000_000),
        accel_mps2: [f64::from(n).sin(), f64::from(n).cos(), 9.8].into(),
        gyro_radps: [0.1 / f64::from(n + 1), 1e-3, -2.0].into(),
    })
}
