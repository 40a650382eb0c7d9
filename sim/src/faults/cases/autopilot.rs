//! What the autopilot does, or does not.

use super::{Lab, heading};
use crate::autopilot::Flavour;
use crate::faults::bench::Bench;
use crate::faults::link_layer::Way;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavResult};
use stockpilot::mission::Phase;

const AUTOPILOT: MavHeader = MavHeader { system_id: 1, component_id: 1, sequence: 0 };

fn is_let_go(bench: &Bench) -> bool {
    matches!(bench.phase(), Phase::Abort | Phase::Idle)
}

pub(super) fn reboot(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        let is_starting = bench.until(6.0, |b| b.phase() == Phase::Preflight);
        bench.demand(is_starting, "the start begins");
        bench.strike();
        bench.safe_already();
        let now = bench.now();
        bench.autopilot().reboot(now);
        let is_flying = bench.until(75.0, |b| b.phase() == Phase::Survey);
        bench.demand(is_flying, "takes off once the autopilot is back");
        bench.demand(bench.said("has restarted"), "people are told");
        bench.run(2.0);
    })?;
    lab.fly(|bench| {
        bench.survey();
        bench.falls();
        bench.strike();
        let now = bench.now();
        bench.autopilot().reboot(now);
        // Its links are silent for two seconds.
        bench.safe_within(3.5, "lets go", is_let_go);
        bench.run(15.0);
        bench.demand(!bench.is_steered(), "no setpoint for the new start");
        bench.demand(bench.commands().is_empty(), "nothing is commanded");
        bench.demand(bench.said("has restarted"), "people are told");
    })
}

/// A heartbeat of another system's autopilot, armed and flown by its pilot.
fn rival(flavour: Flavour) -> MavMessage {
    let autopilot = match flavour {
        Flavour::Px4 => m::MavAutopilot::MAV_AUTOPILOT_PX4,
        Flavour::ArduPilot => m::MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
    };
    MavMessage::HEARTBEAT(m::HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: m::MavType::MAV_TYPE_QUADROTOR,
        autopilot,
        base_mode: m::MavModeFlag::from_bits_retain(0xd1),
        system_status: m::MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

pub(super) fn second_autopilot(lab: &mut Lab) -> anyhow::Result<()> {
    let other = MavHeader { system_id: 2, component_id: 1, sequence: 0 };
    let lookalike = MavHeader { system_id: 255, component_id: 190, sequence: 0 };
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        for _ in 0..10 {
            for flavour in Flavour::ALL {
                bench.flight.link.inject(other, rival(flavour));
                bench.flight.link.inject(lookalike, rival(flavour));
            }
            bench.run(1.0);
        }
        bench.demand(bench.phases().is_empty() && bench.is_steered(), "the survey goes on");
    })?;
    lab.fly(|bench| {
        bench.run(1.0);
        bench.strike();
        bench.safe_already();
        for _ in 0..75 {
            bench.flight.link.inject(other, rival(Flavour::Px4));
            bench.run(1.0);
        }
        bench.demand(bench.seen.commands.is_empty(), "no start beside a second autopilot");
        bench.demand(bench.said("second autopilot"), "people are told");
    })
}

/// Instead of reaching the autopilot, `command` is answered `result` and does nothing.
fn fake(bench: &mut Bench, command: MavCmd, result: MavResult) {
    let mut pending = Vec::new();
    bench.flight.link.tamper_with(move |way, _, (header, message)| match (way, &message) {
        (Way::ToAutopilot, MavMessage::COMMAND_LONG(data)) if data.command == command => {
            let ack = m::COMMAND_ACK_DATA {
                command,
                result,
                target_system: 1,
                target_component: header.component_id,
                ..m::COMMAND_ACK_DATA::DEFAULT
            };
            pending.push((AUTOPILOT, MavMessage::COMMAND_ACK(ack)));
            Vec::new()
        }
        (Way::ToCompanion, _) => {
            let mut passed = std::mem::take(&mut pending);
            passed.push((header, message));
            passed
        }
        _ => vec![(header, message)],
    });
}

pub(super) fn refusals(lab: &mut Lab) -> anyhow::Result<()> {
    let mode = MavCmd::MAV_CMD_DO_SET_MODE;
    let arm = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
    for (command, result) in [
        (mode, MavResult::MAV_RESULT_ACCEPTED),
        (mode, MavResult::MAV_RESULT_TEMPORARILY_REJECTED),
        (arm, MavResult::MAV_RESULT_FAILED),
        (arm, MavResult::MAV_RESULT_ACCEPTED),
        (arm, MavResult::MAV_RESULT_IN_PROGRESS),
    ] {
        lab.fly(|bench| {
            fake(bench, command, result);
            bench.until(6.0, |b| b.phase() == Phase::Preflight);
            bench.strike();
            bench.safe_already();
            let has_ended = bench.until(65.0, |b| b.phase() == Phase::Idle);
            bench.demand(has_ended, "gives up after a minute");
            bench.demand(!bench.flight.rig.autopilot().is_armed(), "never armed");
            bench.demand(bench.said("no take-off"), "people are told");
            bench.run(5.0);
            bench.demand(!bench.is_steered(), "no setpoint afterwards");
        })?;
    }
    Ok(())
}

pub(super) fn battery(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.rig.vehicle_mut().battery_mut().set_charge_ratio(0.24);
        bench.safe_within(2.5, "returns", |b| b.phase() == Phase::Return);
        let is_down = bench.until(80.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
    })?;
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.rig.vehicle_mut().battery_mut().set_charge_ratio(0.11);
        // A message every two seconds, and what it says must last.
        bench.safe_within(5.0, "lands", |b| b.phase() == Phase::Land);
        let is_down = bench.until(40.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
    })?;
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        let mut n_wild = 0;
        bench.flight.link.tamper_with(move |way, _, (header, mut message)| {
            if let (Way::ToCompanion, MavMessage::BATTERY_STATUS(data)) = (way, &mut message)
                && n_wild == 0
            {
                n_wild += 1;
                data.battery_remaining = 2;
            }
            vec![(header, message)]
        });
        bench.run(6.0);
        let is_kept = matches!(bench.phase(), Phase::Survey | Phase::Return);
        bench.demand(is_kept, "one wild word lands nobody");
    })?;
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.link.tamper_with(|_, _, (header, message)| match message {
            MavMessage::BATTERY_STATUS(_) | MavMessage::SYS_STATUS(_) => Vec::new(),
            _ => vec![(header, message)],
        });
        bench.safe_within(11.5, "returns without news of the battery", |b| {
            b.phase() == Phase::Return
        });
        let is_down = bench.until(80.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
    })
}

/// What reaches the autopilot drifts away by 0.3 m/s from now on, up to this far, m.
pub(super) fn drifting_odometry(bench: &mut Bench, up_to_m: f64) {
    let struck_at = bench.now();
    bench.flight.link.tamper_with(move |_, now, (header, mut message)| {
        if let MavMessage::ODOMETRY(data) = &mut message {
            #[expect(clippy::cast_possible_truncation, reason = "metres on the wire")]
            let drift_m = (0.3 * now.seconds_since(struck_at)).min(up_to_m) as f32;
            data.x += drift_m;
        }
        vec![(header, message)]
    });
}

pub(super) fn disagreement(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        drifting_odometry(bench, f64::INFINITY);
        // The drift alone takes 1.7 s to half a metre. The autopilot's belief follows it late, for its
        // own velocity says otherwise: ArduPilot's, which trusts a position by 0.2 m at best, most.
        // Until then it flies where it should, so the way that counts is that of its belief.
        let mut strayed_m = 0.0_f64;
        while bench.since_s() < 4.5 && bench.phase() != Phase::Land {
            bench.step();
            strayed_m = strayed_m.max(bench.disagreement_m());
        }
        bench.safe_within(4.5, "lands", |b| b.phase() == Phase::Land);
        // Half a metre, and half a second of the drift.
        bench.demand(strayed_m < 0.5 + 0.5 * 0.3 + 0.1, &format!("strayed {strayed_m:.2} m"));
        let is_down = bench.until(40.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
        bench.demand(bench.said("autopilot's position"), "people are told");
    })?;
    heading::disagreement(lab)
}

pub(super) fn no_take_off(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.flight.faults.is_camera_covered = true;
        bench.strike();
        bench.safe_already();
        bench.run(72.0);
        bench.demand(bench.seen.commands.is_empty(), "no start without a marker");
        bench.demand(bench.said("markers in view"), "people are told");
    })?;
    lab.fly(|bench| {
        #[expect(deprecated, reason = "the message in question")]
        bench.flight.link.tamper_with(|_, _, (header, message)| match message {
            MavMessage::SET_GPS_GLOBAL_ORIGIN(_) => Vec::new(),
            _ => vec![(header, message)],
        });
        bench.strike();
        bench.safe_already();
        bench.run(72.0);
        let is_flying = bench.phase() != Phase::Idle;
        // PX4 needs no origin to fly, ArduPilot does not arm without one.
        bench.demand(is_flying == (bench.flavour() == Flavour::Px4), "as the family asks");
    })
}

pub(super) fn odometry_refused(lab: &mut Lab) -> anyhow::Result<()> {
    // At 4 Hz PX4 does not fuse, and says nothing.
    lab.fly(|bench| {
        let mut n_sent = 0_u32;
        bench.flight.link.tamper_with(move |way, _, (header, message)| {
            let is_odometry = way == Way::ToAutopilot && matches!(message, MavMessage::ODOMETRY(_));
            n_sent += u32::from(is_odometry);
            if is_odometry && !n_sent.is_multiple_of(8) {
                Vec::new()
            } else {
                vec![(header, message)]
            }
        });
        bench.strike();
        bench.safe_already();
        bench.run(30.0);
        if bench.flavour() == Flavour::Px4 {
            bench.demand(!bench.flight.rig.autopilot().is_armed(), "PX4 cannot be armed");
        }
        bench.run(42.0);
    })?;
    // In the other family's frame: ArduPilot drops it without a word.
    lab.fly(|bench| {
        let wrong = match bench.flavour() {
            Flavour::Px4 => m::MavFrame::MAV_FRAME_GLOBAL,
            Flavour::ArduPilot => m::MavFrame::MAV_FRAME_LOCAL_NED,
        };
        bench.flight.link.tamper_with(move |_, _, (header, mut message)| {
            if let MavMessage::ODOMETRY(data) = &mut message {
                data.frame_id = wrong;
            }
            vec![(header, message)]
        });
        bench.strike();
        bench.safe_already();
        bench.run(72.0);
        bench.demand(!bench.flight.rig.autopilot().is_armed(), "never armed");
        bench.demand(bench.said("no take-off"), "people are told");
    })
}
