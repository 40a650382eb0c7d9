//! What is written, and its bytes.

use super::topic::Topic;
use super::twin;
use super::view::{ViewTopic, views_of};
use crate::geometry::{Body, Lidar, Transform};
use crate::messages::{
    AutopilotPose, BatterySample, CommandOutcome, Declaration, ImuSample, OperatorCommand,
    StorageState, VehicleState,
};
use crate::pilot::{Action, Event, Job, JobId, JobOutput};
use crate::planning::planner::Plan;
use crate::time::{Mono, Stamp};
use serde::Serialize;

type JsonWriter<'a> = serde_json::Serializer<&'a mut Vec<u8>>;
type JsonReader<'a> = serde_json::Deserializer<serde_json::de::SliceRead<'a>>;

/// An event as a log holds it.
#[derive(Debug, Clone, PartialEq)]
pub enum RecordedEvent {
    /// Any event but a finished job.
    Plain(Event),
    /// A finished job; a replay runs the job of this number again, unless it was done outside.
    Finished {
        /// When its result reached the brain.
        at: Stamp<Mono>,
        /// The job's number.
        id: JobId,
        /// What a program outside found, which nobody can compute again.
        outside: Option<Result<Plan, String>>,
    },
}

impl RecordedEvent {
    /// The event for a brain: plain, or with the output of its job; `None` if that job never began.
    pub(super) fn for_brain(
        self,
        take_job: impl FnOnce(JobId) -> Option<Box<Job>>,
    ) -> Option<Event> {
        match self {
            Self::Plain(event) => Some(event),
            Self::Finished { at, id, outside } => {
                let job = take_job(id)?;
                let output = outside.map_or_else(|| job.run(), JobOutput::PlannedOutside);
                Some(Event::Finished { at, id, output: Box::new(output) })
            }
        }
    }
}

/// An event or a result without what a replay computes anew: jobs and their outputs.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Entry {
    /// What the brain was told.
    Event(RecordedEvent),
    /// Any action but the start of a job.
    Result(Action),
    /// The start of a job.
    Started { id: JobId },
    /// What a person said before the motors turned.
    Declared { at: Stamp<Mono>, said: Declaration },
}

impl From<&Event> for Entry {
    fn from(event: &Event) -> Self {
        match event {
            Event::Finished { at, id, output } => {
                let outside = output.outside().cloned();
                Self::Event(RecordedEvent::Finished { at: *at, id: *id, outside })
            }
            other => Self::Event(RecordedEvent::Plain(other.clone())),
        }
    }
}

impl From<&Action> for Entry {
    fn from(action: &Action) -> Self {
        match action {
            Action::Start { id, .. } => Self::Started { id: *id },
            other => Self::Result(other.clone()),
        }
    }
}

/// A message's channel and bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Encoded {
    pub(super) topic: Topic,
    pub(super) json: Vec<u8>,
}

/// An entry as it is written, with what viewers see of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Written {
    pub(super) encoded: Encoded,
    pub(super) views: Vec<(ViewTopic, Vec<u8>)>,
}

impl Written {
    /// The entry's bytes; viewers place the LiDAR's turns by its mounting.
    pub(super) fn new(
        at: Stamp<Mono>,
        entry: &Entry,
        body_from_lidar: Option<&Transform<Body, Lidar>>,
    ) -> serde_json::Result<Self> {
        Ok(Self { encoded: entry.encoded()?, views: views_of(entry, at, body_from_lidar) })
    }
}

impl Entry {
    pub(super) fn encoded(&self) -> serde_json::Result<Encoded> {
        match self {
            Self::Event(RecordedEvent::Plain(event)) => encode_event(event),
            Self::Result(action) => encode_action(action),
            Self::Event(RecordedEvent::Finished { at, id, outside }) => {
                encode(Topic::Finished, &twin::FinishedTwin::new(*at, *id, outside.as_ref()))
            }
            Self::Started { id } => encode(Topic::Started, &twin::StartedTwin { id: *id }),
            Self::Declared { at, said } => {
                encode(Topic::Declared, &twin::DeclaredTwin::new(*at, said))
            }
        }
    }
}

/// The channel and bytes of an action, as a log holds them.
pub(super) fn encode_action(action: &Action) -> serde_json::Result<Encoded> {
    match action {
        Action::Steer(it) => encode_by(Topic::Setpoint, |to| twin::SetpointTwin::serialize(it, to)),
        Action::PublishOdometry(it) => {
            encode_by(Topic::Odometry, |to| twin::OdometryTwin::serialize(it, to))
        }
        Action::PublishSight(it) => {
            encode_by(Topic::Sight, |to| twin::OdometryTwin::serialize(it, to))
        }
        Action::Command(it) => encode(Topic::Command, &twin::CommandTwin { command: *it }),
        Action::Start { id, .. } => encode(Topic::Started, &twin::StartedTwin { id: *id }),
        Action::ReportVolume(it) => {
            encode_by(Topic::Volume, |to| twin::VolumeReportTwin::serialize(it, to))
        }
        Action::Say(it) => encode_by(Topic::Text, |to| twin::TextTwin::serialize(it, to)),
        Action::Answer(it) => encode_by(Topic::Answer, |to| twin::AnswerTwin::serialize(it, to)),
        Action::PhaseChanged(it) => {
            encode_by(Topic::Phase, |to| twin::PhaseTwin::serialize(it, to))
        }
        Action::FixTreated(it) => encode_by(Topic::Fix, |to| twin::FixTwin::serialize(it, to)),
        Action::SurfaceSolved(it) => {
            encode_by(Topic::Surface, |to| twin::SurfaceTwin::serialize(it, to))
        }
        Action::VolumesAccounted(it) => {
            encode(Topic::Accounts, &twin::AccountsTwin::from(it.as_slice()))
        }
        Action::PlanChosen(it) => encode(Topic::Plan, &twin::PlanTwin::from(it.as_ref())),
        Action::Ended(it) => encode_by(Topic::Ended, |to| twin::EndedTwin::serialize(it, to)),
    }
}

fn encode_event(event: &Event) -> serde_json::Result<Encoded> {
    match event {
        Event::Ticked(at) => encode(Topic::Tick, &twin::InstantTwin { at: *at }),
        Event::Imu(it) => encode_by(Topic::Imu, |to| twin::ImuTwin::serialize(it, to)),
        Event::Scanned(scan) => encode(Topic::Scan, &twin::ScanTwin::from(scan)),
        Event::TagsSeen(seen) => encode(Topic::Tags, &twin::TagsTwin::from(seen)),
        Event::Vehicle(it) => encode_by(Topic::Vehicle, |to| twin::VehicleTwin::serialize(it, to)),
        Event::Battery(it) => encode_by(Topic::Battery, |to| twin::BatteryTwin::serialize(it, to)),
        Event::AutopilotPose(it) => {
            encode_by(Topic::AutopilotPose, |to| twin::AutopilotPoseTwin::serialize(it, to))
        }
        Event::CommandAnswered(it) => {
            encode_by(Topic::CommandAnswered, |to| twin::CommandOutcomeTwin::serialize(it, to))
        }
        Event::Operator(it) => {
            encode_by(Topic::Operator, |to| twin::OperatorTwin::serialize(it, to))
        }
        Event::AutopilotLost(at) => encode(Topic::AutopilotLost, &twin::InstantTwin { at: *at }),
        Event::AutopilotRebooted(at) => {
            encode(Topic::AutopilotRebooted, &twin::InstantTwin { at: *at })
        }
        Event::StorageLooked(it) => {
            encode_by(Topic::Storage, |to| twin::StorageTwin::serialize(it, to))
        }
        Event::Finished { at, id, output } => {
            encode(Topic::Finished, &twin::FinishedTwin::new(*at, *id, output.outside()))
        }
    }
}

pub(super) fn encode<T: Serialize>(topic: Topic, message: &T) -> serde_json::Result<Encoded> {
    Ok(Encoded { topic, json: serde_json::to_vec(message)? })
}

fn encode_by(
    topic: Topic,
    serialize: impl FnOnce(&mut JsonWriter<'_>) -> serde_json::Result<()>,
) -> serde_json::Result<Encoded> {
    let mut json = Vec::new();
    serialize(&mut serde_json::Serializer::new(&mut json))?;
    Ok(Encoded { topic, json })
}

/// Reads an event back; `None` for a channel that holds no events.
pub(super) fn decode_event(topic: Topic, json: &[u8]) -> Option<serde_json::Result<RecordedEvent>> {
    let event =
        match topic {
            Topic::Tick => instant(json).map(Event::Ticked),
            Topic::AutopilotLost => instant(json).map(Event::AutopilotLost),
            Topic::AutopilotRebooted => instant(json).map(Event::AutopilotRebooted),
            Topic::Imu => decode_by::<ImuSample>(json, |from| twin::ImuTwin::deserialize(from))
                .map(Event::Imu),
            Topic::Scan => decode_scan(json),
            Topic::Tags => serde_json::from_slice::<twin::TagsTwin>(json)
                .map(|seen| Event::TagsSeen(seen.into())),
            Topic::Vehicle => {
                decode_by::<VehicleState>(json, |from| twin::VehicleTwin::deserialize(from))
                    .map(Event::Vehicle)
            }
            Topic::Battery => {
                decode_by::<BatterySample>(json, |from| twin::BatteryTwin::deserialize(from))
                    .map(Event::Battery)
            }
            Topic::AutopilotPose => {
                decode_by::<AutopilotPose>(json, |from| twin::AutopilotPoseTwin::deserialize(from))
                    .map(Event::AutopilotPose)
            }
            Topic::CommandAnswered => decode_by::<CommandOutcome>(json, |from| {
                twin::CommandOutcomeTwin::deserialize(from)
            })
            .map(Event::CommandAnswered),
            Topic::Storage => {
                decode_by::<StorageState>(json, |from| twin::StorageTwin::deserialize(from))
                    .map(Event::StorageLooked)
            }
            Topic::Operator => {
                decode_by::<OperatorCommand>(json, |from| twin::OperatorTwin::deserialize(from))
                    .map(Event::Operator)
            }
            Topic::Finished => {
                return Some(
                    serde_json::from_slice::<twin::FinishedTwin>(json).map(RecordedEvent::from),
                );
            }
            _ => return None,
        };
    Some(event.map(RecordedEvent::Plain))
}

fn instant(json: &[u8]) -> serde_json::Result<Stamp<Mono>> {
    serde_json::from_slice::<twin::InstantTwin>(json).map(|twin| twin.at)
}

fn decode_scan(json: &[u8]) -> serde_json::Result<Event> {
    serde_json::from_slice::<twin::ScanTwin>(json)?
        .into_scan()
        .map(Event::Scanned)
        .ok_or_else(|| serde::de::Error::custom("the columns of a scan differ in length"))
}

fn decode_by<T>(
    json: &[u8],
    deserialize: impl FnOnce(&mut JsonReader<'_>) -> serde_json::Result<T>,
) -> serde_json::Result<T> {
    let mut from = serde_json::Deserializer::from_slice(json);
    let message = deserialize(&mut from)?;
    from.end()?;
    Ok(message)
}
