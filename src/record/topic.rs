//! The channels of a log.

use super::twin;
use schemars::{Schema, schema_for};
use serde::{Deserialize, Serialize};

macro_rules! topics {
    ($($(#[$doc:meta])* $name:ident = $path:literal, $twin:ty;)+) => {
        /// A channel of JSON messages; the file's truth.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Topic {
            $($(#[$doc])* $name,)+
        }

        impl Topic {
            /// Every channel.
            pub const ALL: &'static [Self] = &[$(Self::$name),+];

            /// The channel's name in the file.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => $path,)+ }
            }

            /// The JSON schema of the channel's messages.
            #[must_use]
            pub fn schema(self) -> Schema {
                match self { $(Self::$name => schema_for!($twin),)+ }
            }
        }
    };
}

topics! {
    /// The clock struck.
    Tick = "/event/tick", twin::InstantTwin;
    /// Inertial sample.
    Imu = "/event/imu", twin::ImuTwin;
    /// Beams of the LiDAR, in columns.
    Scan = "/event/scan", twin::ScanTwin;
    /// Tags in a camera frame.
    Tags = "/event/tags", twin::TagsTwin;
    /// Heartbeat or landed state of the autopilot.
    Vehicle = "/event/vehicle", twin::VehicleTwin;
    /// Flight battery.
    Battery = "/event/battery", twin::BatteryTwin;
    /// Where the autopilot believes to be.
    AutopilotPose = "/event/autopilot_pose", twin::AutopilotPoseTwin;
    /// The autopilot's answer to a command.
    CommandAnswered = "/event/command_answered", twin::CommandOutcomeTwin;
    /// A person's command.
    Operator = "/event/operator", twin::OperatorTwin;
    /// The autopilot fell silent.
    AutopilotLost = "/event/autopilot_lost", twin::InstantTwin;
    /// The autopilot has started anew.
    AutopilotRebooted = "/event/autopilot_rebooted", twin::InstantTwin;
    /// The disk with the log.
    Storage = "/event/storage", twin::StorageTwin;
    /// A job came back.
    Finished = "/event/finished", twin::FinishedTwin;
    /// Setpoint sent to the autopilot.
    Setpoint = "/result/setpoint", twin::SetpointTwin;
    /// Own pose sent to the autopilot.
    Odometry = "/result/odometry", twin::OdometryTwin;
    /// What frames show by themselves, sent to the autopilot in its stead.
    Sight = "/result/sight", twin::OdometryTwin;
    /// Command sent to the autopilot.
    Command = "/result/command", twin::CommandTwin;
    /// A job began.
    Started = "/result/started", twin::StartedTwin;
    /// Volume and what belongs beside it.
    Volume = "/result/volume", twin::VolumeReportTwin;
    /// A line for people.
    Text = "/result/text", twin::TextTwin;
    /// Answer to a person's command.
    Answer = "/result/answer", twin::AnswerTwin;
    /// A step of the mission.
    Phase = "/result/phase", twin::PhaseTwin;
    /// How a frame of tags was treated.
    Fix = "/result/fix", twin::FixTwin;
    /// The surface.
    Surface = "/result/surface", twin::SurfaceTwin;
    /// The volumes of a surface with the accounts of their uncertainty.
    Accounts = "/result/accounts", twin::AccountsTwin;
    /// The waypoints ahead, and what they are expected to lead to.
    Plan = "/result/plan", twin::PlanTwin;
    /// What the flight came to.
    Ended = "/result/ended", twin::EndedTwin;
    /// Versions and the effective configuration; the first message of every file.
    Config = "/config", ConfigTwin;
    /// Entries that are missing at this place.
    Lost = "/record/lost", LostTwin;
    /// What a person said before the motors turned.
    Declared = "/record/declared", twin::DeclaredTwin;
}

impl Topic {
    /// The channel with this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|topic| topic.name() == name)
    }

    /// The name of the schema of its messages.
    #[must_use]
    pub fn schema_name(self) -> String {
        format!("stockpilot.{}", self.name().trim_start_matches('/').replace('/', "."))
    }

    /// True for what the brain was told.
    #[must_use]
    pub fn is_event(self) -> bool {
        self.name().starts_with("/event/")
    }

    /// True for what the brain gave out.
    #[must_use]
    pub fn is_result(self) -> bool {
        self.name().starts_with("/result/")
    }
}

/// What was running.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
pub(super) struct ConfigTwin {
    /// Version of this program.
    pub(super) version: String,
    /// What the program was built from and for.
    pub(super) build: String,
    /// The effective configuration, TOML.
    pub(super) config_toml: String,
}

/// A gap in the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
pub(super) struct LostTwin {
    /// Events and results that are missing here.
    pub(super) n_entries: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_distinct_and_lead_back() {
        for topic in Topic::ALL {
            assert_eq!(Topic::from_name(topic.name()), Some(*topic));
        }
        assert_eq!(Topic::from_name("/view/scan"), None);
    }

    #[test]
    fn schemas_describe_objects_with_units_in_their_keys() {
        for topic in Topic::ALL {
            let schema = serde_json::to_value(topic.schema()).unwrap();
            assert_eq!(schema["type"], "object", "{topic:?}");
        }
        let imu = serde_json::to_value(Topic::Imu.schema()).unwrap();
        assert!(imu["properties"]["at_ns"]["type"] == "integer");
        assert!(imu["properties"]["accel_mps2"]["type"] == "array");
    }
}
