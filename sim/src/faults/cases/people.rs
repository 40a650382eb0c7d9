//! What people do, and those who pretend to be them.

use super::Lab;
use crate::autopilot::Flavour;
use crate::faults::bench::Bench;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage};
use stockpilot::mission::Phase;

const GROUND_STATION: MavHeader = MavHeader { system_id: 255, component_id: 190, sequence: 0 };

/// Setpoints must end this soon after the pilot's switch, s.
const SETPOINTS_END_S: f64 = 0.05;

fn is_let_go(bench: &Bench) -> bool {
    matches!(bench.phase(), Phase::Abort | Phase::Idle)
}

pub(super) fn mode_switch(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.autopilot().pilot_takes_over();
        bench.safe_within(SETPOINTS_END_S, "lets go", is_let_go);
        bench.run(5.0);
        bench.demand(bench.setpoints_for_s() <= SETPOINTS_END_S, "the setpoints end");
        bench.autopilot().pilot_gives_back();
        bench.run(10.0);
        bench.demand(bench.setpoints_for_s() <= SETPOINTS_END_S, "none when the mode comes back");
        bench.demand(bench.commands().is_empty(), "nothing is commanded");
    })
}

pub(super) fn kill_switch(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.falls();
        bench.strike();
        bench.autopilot().pilot_kills_motors();
        // Only the heartbeat tells of it, and PX4's comes once a second; setpoints move nothing meanwhile.
        let limit_s = match bench.flavour() {
            Flavour::Px4 => 1.0 + SETPOINTS_END_S,
            Flavour::ArduPilot => SETPOINTS_END_S,
        };
        bench.safe_within(limit_s, "lets go", is_let_go);
        bench.run(5.0);
        bench.demand(bench.setpoints_for_s() <= limit_s, "the setpoints end");
        bench.demand(bench.commands().is_empty(), "nothing is commanded");
    })
}

pub(super) fn ground_station_lost(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.operator_mut().is_silent = true;
        bench.safe_already();
        bench.run(12.0);
        bench.demand(bench.phases().is_empty() && bench.is_steered(), "the survey goes on");
        let header = bench.flight.companion_header();
        let is_own = header.system_id == 1 && header.component_id == 191;
        bench.demand(is_own, "never speaks as a ground station");
    })
}

fn command(target: (u8, u8), command: MavCmd, param1: f32) -> MavMessage {
    MavMessage::COMMAND_LONG(m::COMMAND_LONG_DATA {
        target_system: target.0,
        target_component: target.1,
        command,
        param1,
        confirmation: 1,
        ..m::COMMAND_LONG_DATA::DEFAULT
    })
}

pub(super) fn spoof_and_flood(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        let stranger = MavHeader { system_id: 66, component_id: 1, sequence: 0 };
        for number in [
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            MavCmd::MAV_CMD_DO_SET_MODE,
            MavCmd::MAV_CMD_NAV_LAND,
            MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
        ] {
            bench.flight.link.inject(GROUND_STATION, command((1, 191), number, 0.0));
            bench.flight.link.inject(stranger, command((1, 191), number, 0.0));
        }
        bench.run(0.5);
        bench.demand(bench.phases().is_empty(), "only an operator's five commands count");
        // Ten thousand messages a second of others, among them states that are not ours.
        let position = MavMessage::LOCAL_POSITION_NED(m::LOCAL_POSITION_NED_DATA::DEFAULT);
        let disarmed = MavMessage::EXTENDED_SYS_STATE(m::EXTENDED_SYS_STATE_DATA {
            vtol_state: m::MavVtolState::MAV_VTOL_STATE_UNDEFINED,
            landed_state: m::MavLandedState::MAV_LANDED_STATE_ON_GROUND,
        });
        for _ in 0..600 {
            for _ in 0..25 {
                bench.flight.link.inject(stranger, position.clone());
                bench.flight.link.inject(GROUND_STATION, disarmed.clone());
            }
            bench.step();
        }
        bench.demand(bench.phases().is_empty() && bench.is_steered(), "the survey goes on");
    })
}

pub(super) fn repeated_commands(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        let acks_before = bench.seen.n_acks;
        // The answer got lost: the same wish again, with a confirmation count.
        for _ in 0..3 {
            bench.flight.operator_mut().ask(MavCmd::MAV_CMD_USER_2);
            bench.run(0.2);
        }
        bench.safe_within(1.0, "holds", |b| b.phase() == Phase::Hold);
        bench.demand(bench.seen.n_acks - acks_before == 3, "each is answered");
        bench.demand(bench.phases() == [Phase::Hold], "and obeyed once");
        // A broadcast, and another component's command, are not for this one.
        for target in [(0, 0), (1, 0), (1, 192)] {
            let land = command(target, MavCmd::MAV_CMD_USER_5, 0.0);
            bench.flight.link.inject(GROUND_STATION, land);
        }
        bench.run(2.0);
        bench.demand(bench.phase() == Phase::Hold, "commands to others are not obeyed");
        bench.flight.operator_mut().ask(MavCmd::MAV_CMD_USER_3);
        let is_back = bench.until(1.0, |b| b.phase() == Phase::Survey);
        bench.demand(is_back, "resumes");
        bench.run(3.0);
    })
}
