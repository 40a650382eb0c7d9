//! Sequences of events into the brain, from plausible to absurd; every number is finite, as the
//! edges promise.

#![no_main]

use arbitrary::{Result, Unstructured};
use libfuzzer_sys::fuzz_target;
use nalgebra::Vector3;
use std::time::Duration;
use stockpilot::geometry::{Body, Direction, Hall, Point, Rotation};
use stockpilot::messages::{
    AutopilotPose, BatterySample, Beam, CameraId, CommandOutcome, FlightMode, ImuSample,
    LandedState, OperatorCommand, OperatorRequest, OperatorVerb, Room, Scan, StorageState, TagDetection,
    TagFamily, TakeOff, VehicleCommand, VehicleState,
};
use stockpilot::pilot::Event;
use stockpilot::time::{Mono, Stamp};
use stockpilot_fuzz::{Map, Scene, frame_at};

/// Longer sequences find nothing that short ones do not, and take their time.
const MAX_EVENTS: usize = 200;
/// Seconds on the pad, each of them hundreds of events.
const MAX_RESTS: u32 = 2;

fuzz_target!(|input: &[u8]| {
    let mut u = Unstructured::new(input);
    let map = if u.ratio(1, 256).unwrap_or(false) { Map::Field } else { Map::Grid };
    let mut scene = Scene::new(map);
    let mut n_rests = 0;
    for _ in 0..MAX_EVENTS {
        if u.is_empty() || step(&mut u, &mut scene, &mut n_rests).is_err() {
            break;
        }
    }
});

fn step(u: &mut Unstructured<'_>, scene: &mut Scene, n_rests: &mut u32) -> Result<()> {
    match u.int_in_range(0..=12)? {
        0..=2 => {
            let by = Duration::from_millis(u.int_in_range(0..=200)?);
            scene.tick(by);
            return Ok(());
        }
        3 if *n_rests < MAX_RESTS => {
            *n_rests += 1;
            // A second on the pad as it should be: the brain gets somewhere.
            for k in 0..200_u64 {
                let at = scene.now();
                scene.tell(Event::Imu(resting(at)));
                if k % 10 == 0 {
                    scene.tell(Event::TagsSeen(frame_at(0.2, at)));
                }
                scene.tick(Duration::from_millis(5));
            }
            return Ok(());
        }
        _ => {}
    }
    let event = event(u, scene.now())?;
    scene.tell(event);
    Ok(())
}

fn resting(at: Stamp<Mono>) -> ImuSample {
    ImuSample { at, accel_mps2: Vector3::new(0.0, 0.0, 9.806_65), gyro_radps: Vector3::zeros() }
}

fn event(u: &mut Unstructured<'_>, now: Stamp<Mono>) -> Result<Event> {
    let at = stamp(u, now)?;
    Ok(match u.int_in_range(0..=9)? {
        0 => Event::Imu(ImuSample { at, accel_mps2: vector(u)?, gyro_radps: vector(u)? }),
        1 => Event::Imu(resting(at)),
        2 => Event::Scanned(scan(u, at)?),
        3 => Event::TagsSeen(frame_at(u.int_in_range(1..=40)? as f64 * 0.1, at)),
        4 => {
            let mut frame = frame_at(0.2, at);
            frame.camera = CameraId(u.int_in_range(0..=2)?);
            frame.tags.truncate(u.int_in_range(0..=12)?);
            for tag in &mut frame.tags {
                if u.ratio(1, 3)? {
                    tag.corners_px[u.int_in_range(0..=3)?] = [number(u)?, number(u)?];
                }
            }
            frame.tags.push(TagDetection {
                id: u.int_in_range(0..=20)?,
                family: TagFamily::Tag36h11,
                corners_px: [[number(u)?; 2]; 4],
                decision_margin: number(u)?,
            });
            Event::TagsSeen(frame)
        }
        5 => Event::Vehicle(VehicleState {
            at,
            is_armed: u.arbitrary()?,
            mode: *u.choose(&[
                FlightMode::Companion,
                FlightMode::Hold,
                FlightMode::Land,
                FlightMode::Return,
                FlightMode::TakeOff,
                FlightMode::Pilot,
                FlightMode::Other(9),
            ])?,
            landed: *u.choose(&[
                LandedState::Unknown,
                LandedState::OnGround,
                LandedState::InAir,
                LandedState::TakingOff,
                LandedState::Landing,
            ])?,
            in_failsafe: u.arbitrary()?,
            is_contested: u.arbitrary()?,
            is_ready: u.arbitrary()?,
            is_mode_prompt: u.arbitrary()?,
            takes_off: *u.choose(&[TakeOff::BySetpoints, TakeOff::ByCommand])?,
        }),
        6 => Event::Battery(BatterySample {
            at,
            voltage_v: number(u)?,
            current_a: number(u)?,
            remaining_ratio: f64::from(u.int_in_range(0..=100_u8)?) / 100.0,
        }),
        7 => Event::AutopilotPose(AutopilotPose {
            at,
            position: Point::from_coords(vector(u)?),
            velocity_mps: Direction::from_coords(vector(u)?),
            hall_from_body_rot: attitude(u)?,
        }),
        8 => Event::Operator(OperatorCommand {
            at,
            verb: *u.choose(&[
                OperatorVerb::Start,
                OperatorVerb::FlyGaps,
                OperatorVerb::Hold,
                OperatorVerb::Resume,
                OperatorVerb::Return,
                OperatorVerb::Land,
            ])?,
            from: OperatorRequest { system: u.arbitrary()?, component: u.arbitrary()? },
        }),
        _ => match u.int_in_range(0..=3)? {
            0 => Event::AutopilotLost(at),
            1 => Event::AutopilotRebooted(at),
            2 => Event::StorageLooked(StorageState {
                at,
                room: *u.choose(&[Room::Enough, Room::Low, Room::TooLittle])?,
                free_bytes: u.arbitrary()?,
                survey_bytes: u.arbitrary()?,
                records_lost: u.arbitrary()?,
                has_log_failed: u.arbitrary()?,
            }),
            _ => Event::CommandAnswered(CommandOutcome {
                at,
                command: *u.choose(&[
                    VehicleCommand::Arm,
                    VehicleCommand::Disarm,
                    VehicleCommand::EnterCompanionMode,
                    VehicleCommand::TakeOff,
                    VehicleCommand::EnterHold,
                    VehicleCommand::EnterLand,
                ])?,
                is_accepted: u.arbitrary()?,
            }),
        },
    })
}

fn scan(u: &mut Unstructured<'_>, start: Stamp<Mono>) -> Result<Scan> {
    let n = u.int_in_range(0..=60)?;
    let beams = (0..n).map(|k| {
        Ok(Beam {
            offset_ns: u.int_in_range(0..=200_000_000)?,
            angle_rad: if u.ratio(1, 8)? { number(u)? as f32 } else { k as f32 * 0.05 - 1.5 },
            range_m: if u.ratio(1, 8)? { number(u)? as f32 } else { 2.5 },
            intensity: u.arbitrary()?,
        })
    });
    let mut beams = beams.collect::<Result<Vec<_>>>()?;
    beams.retain(|beam| beam.angle_rad.is_finite() && beam.range_m.is_finite());
    Ok(Scan { start, beams })
}

/// Mostly about now; now and then at the ends of time.
fn stamp(u: &mut Unstructured<'_>, now: Stamp<Mono>) -> Result<Stamp<Mono>> {
    Ok(match u.int_in_range(0..=15)? {
        0 => Stamp::from_nanos(i64::MAX),
        1 => Stamp::from_nanos(i64::MIN),
        2 => Stamp::from_nanos(u.arbitrary()?),
        3 | 4 => now.minus(Duration::from_millis(u.int_in_range(0..=3_000)?)),
        5 => now.plus(Duration::from_millis(u.int_in_range(0..=3_000)?)),
        _ => now,
    })
}

/// Finite, of any size.
fn number(u: &mut Unstructured<'_>) -> Result<f64> {
    let any: f64 = u.arbitrary()?;
    Ok(if any.is_finite() { any } else { 1.0 })
}

fn vector(u: &mut Unstructured<'_>) -> Result<Vector3<f64>> {
    Ok(Vector3::new(number(u)?, number(u)?, number(u)?))
}

fn attitude(u: &mut Unstructured<'_>) -> Result<Option<Rotation<Hall, Body>>> {
    let [w, x, y, z] = [number(u)?, number(u)?, number(u)?, number(u)?];
    Ok(Rotation::from_wxyz(w, x, y, z))
}
