//! The session with a scripted other side.

mod commands;
mod identity;
mod people;
mod reports;
mod samples;

use super::*;
use crate::geometry::{Direction, Point};
use crate::link::Address;
use crate::messages::{
    CommandOutcome, FlightMode, Mass, OperatorAnswer, OperatorCommand, OperatorRequest,
    OperatorVerb, Setpoint, TakeOff, VehicleCommand, VolumeAccount, VolumeBudget, VolumeEstimate,
    VolumeShares,
};
use crate::mission::Phase;
use crate::pilot::{Action, VolumeReport};
use crate::time::Boot;
use mavlink::dialects::ardupilotmega as wire;
use mavlink::dialects::ardupilotmega::{MavCmd, MavResult};

/// Offset of the scripted autopilot's clock.
const BOOT_AT_NS: i64 = 30_000_000_000;
const AUTOPILOT: (u32, u8) = (7, 1);
const PEOPLE: (u32, u8) = (255, 190);

fn at_ms(ms: i64) -> Stamp<Mono> {
    Stamp::from_nanos(60_000_000_000 + ms * 1_000_000)
}

fn boot_at(at: Stamp<Mono>) -> Stamp<Boot> {
    Stamp::from_nanos(at.nanos() - BOOT_AT_NS)
}

struct Scene {
    session: Session,
    out: SessionOutput,
}

impl Scene {
    fn new() -> Self {
        Self::at("udpin:127.0.0.1:0")
    }

    fn at(address: &str) -> Self {
        let address: Address = address.parse().unwrap();
        Self { session: Session::new(Settings::new(address)), out: SessionOutput::default() }
    }

    /// A session that has heard its autopilot at 0 ms and has made its first requests.
    fn heard() -> Self {
        let mut scene = Self::new();
        scene.hears(AUTOPILOT, heartbeat(0x1d, 0x0304_0000), 0);
        scene.tick(0);
        scene.out.clear();
        scene
    }

    /// As [`Self::heard`], with the clocks compared ten times; now is 1000 ms.
    fn synced() -> Self {
        let mut scene = Self::heard();
        scene.sync(100, 0);
        scene.out.clear();
        scene
    }

    /// Ten exchanges of TIMESYNC from `from_ms` on, with an autopilot that booted `shift_ns` later.
    fn sync(&mut self, from_ms: i64, shift_ns: i64) {
        for step in 0..10 {
            let now_ms = from_ms + step * 100;
            self.tick(now_ms);
            let asked = self.sent().into_iter().find_map(|message| match message {
                MavMessage::TIMESYNC(data) if data.tc1 == 0 => Some(data),
                _ => None,
            });
            let ts1 = asked.expect("a request every 100 ms").ts1;
            assert_eq!(ts1, at_ms(now_ms).nanos());
            let tc1 = boot_at(at_ms(now_ms)).nanos() - shift_ns + 200_000;
            let answer = TIMESYNC_DATA { tc1, ts1, ..Default::default() };
            let arrived = Stamp::from_nanos(ts1 + 400_000);
            self.hears_at(AUTOPILOT, &MavMessage::TIMESYNC(answer), arrived);
            self.out.clear();
        }
    }

    #[expect(clippy::needless_pass_by_value, reason = "messages are built in the call")]
    fn hears(&mut self, from: (u32, u8), message: MavMessage, ms: i64) {
        self.hears_at(from, &message, at_ms(ms));
    }

    fn hears_at(&mut self, from: (u32, u8), message: &MavMessage, arrived: Stamp<Mono>) {
        let header = MavHeader { system_id: from.0, component_id: from.1, sequence: 0 };
        self.session.on_message(&header, message, arrived, &mut self.out);
    }

    fn tick(&mut self, ms: i64) {
        self.session.on_time(at_ms(ms), &mut self.out);
    }

    fn acts(&mut self, action: &Action, ms: i64) {
        self.session.on_action(action, at_ms(ms), &mut self.out);
    }

    fn sent(&mut self) -> Vec<MavMessage> {
        std::mem::take(&mut self.out.messages)
    }

    fn told(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.out.events)
    }

    /// Outcomes among the events so far.
    fn outcomes(&mut self) -> Vec<(VehicleCommand, bool)> {
        let outcome = |event| match event {
            Event::CommandAnswered(CommandOutcome { command, is_accepted, .. }) => {
                Some((command, is_accepted))
            }
            _ => None,
        };
        self.told().into_iter().filter_map(outcome).collect()
    }
}

fn heartbeat(base_mode: u8, custom_mode: u32) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode,
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
        base_mode: MavModeFlag::from_bits_retain(base_mode),
        system_status: MavState::MAV_STATE_STANDBY,
        mavlink_version: 3,
    })
}

fn highres_imu(at: Stamp<Mono>) -> wire::HIGHRES_IMU_DATA {
    wire::HIGHRES_IMU_DATA {
        time_usec: u64::try_from(boot_at(at).nanos() / 1_000).unwrap(),
        xacc: 0.5,
        yacc: -0.25,
        zacc: -9.75,
        xgyro: 0.125,
        ygyro: 0.25,
        zgyro: -0.5,
        ..Default::default()
    }
}

fn ack(command: MavCmd, result: MavResult) -> MavMessage {
    MavMessage::COMMAND_ACK(wire::COMMAND_ACK_DATA {
        command,
        result,
        target_system: 7,
        target_component: OWN_COMPONENT,
        ..Default::default()
    })
}

fn user_command(target: (u8, u8), command: MavCmd) -> MavMessage {
    MavMessage::COMMAND_LONG(wire::COMMAND_LONG_DATA {
        command,
        target_system: target.0,
        target_component: target.1,
        ..Default::default()
    })
}
