//! Hazards that were observed on the real autopilots.

use super::Lab;
use super::companion::left_alone;
use super::sensors::jump;
use crate::autopilot::ParamValue;
use crate::faults::bench::Bench;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage};
use stockpilot::mission::Phase;

const GROUND_STATION: MavHeader = MavHeader { system_id: 255, component_id: 190, sequence: 0 };

/// A person sets the origin of the autopilot's map.
fn set_origin(bench: &mut Bench, altitude_mm: i32) {
    let now = bench.now();
    #[expect(deprecated, reason = "ground stations send it")]
    let message = MavMessage::SET_GPS_GLOBAL_ORIGIN(m::SET_GPS_GLOBAL_ORIGIN_DATA {
        latitude: 473_977_418,
        longitude: 85_455_939,
        altitude: altitude_mm,
        target_system: 1,
        time_usec: 0,
    });
    bench.autopilot().forward(now, GROUND_STATION, &message);
}

/// One second without ODOMETRY, and the largest climb in the seconds after it.
fn gap_of_vision(bench: &mut Bench, keeps_origin: bool) -> f64 {
    #[expect(deprecated, reason = "the message in question")]
    let is_origin = |message: &MavMessage| matches!(message, MavMessage::SET_GPS_GLOBAL_ORIGIN(_));
    let gap_ends = bench.now().plus(std::time::Duration::from_secs(1));
    bench.flight.link.tamper_with(move |_, now, (header, message)| {
        let is_gap = now < gap_ends && matches!(message, MavMessage::ODOMETRY(_));
        let is_kept = keeps_origin && is_origin(&message);
        if is_gap || is_kept { Vec::new() } else { vec![(header, message)] }
    });
    let height_m = bench.place().z;
    let mut climb_m = 0.0_f64;
    for _ in 0..1_600 {
        bench.step();
        climb_m = climb_m.max(bench.place().z - height_m);
        if bench.phase() == Phase::Land {
            bench.safe_now();
        }
    }
    climb_m
}

pub(super) fn high_origin(lab: &mut Lab) -> anyhow::Result<()> {
    // The companion sees the origin within five seconds and puts it level: nothing happens.
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        set_origin(bench, 489_400);
        bench.run(6.0);
        bench.demand(bench.said("dangerous"), "people are told");
        let climb_m = gap_of_vision(bench, false);
        bench.demand(climb_m < 0.5, &format!("climbed {climb_m:.1} m"));
        bench.demand(bench.phase() == Phase::Survey, "the survey goes on");
    })?;
    // It cannot put it level: the autopilot believes to be at the wrong height, and it lands.
    lab.fly(|bench| {
        bench.survey();
        bench.tolerate(f64::INFINITY);
        bench.strike();
        #[expect(deprecated, reason = "the message in question")]
        bench.flight.link.tamper_with(|_, _, (header, message)| match message {
            MavMessage::SET_GPS_GLOBAL_ORIGIN(_) => Vec::new(),
            _ => vec![(header, message)],
        });
        set_origin(bench, 489_400);
        bench.run(1.0);
        bench.strike();
        let climb_m = gap_of_vision(bench, true);
        bench.demand(climb_m < 3.0, &format!("climbed {climb_m:.1} m"));
        bench.safe_within(12.0, "lands", |b| b.phase() == Phase::Land || b.is_down());
        let is_down = bench.until(60.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
    })
}

pub(super) fn hold_on_loss(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        if let Some(stub) = bench.autopilot().px4_mut() {
            stub.params_mut().set("COM_OBL_RC_ACT", ParamValue::Int(5));
        }
        bench.survey();
        set_origin(bench, 0);
        bench.run(2.0);
        bench.strike();
        bench.flight.kill_companion();
        // The estimate runs out of vision a few seconds later, and then it lands.
        bench.safe_within(1.6, "holds by its failsafe", |b| {
            b.flight.rig.autopilot().mode_name() == "Loiter"
        });
        let is_down = bench.until(60.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
    })
}

/// With PX4's own default nobody flies after the loss: it says that it cannot, and sinks blindly.
pub(super) fn default_loss_action(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        if let Some(stub) = bench.autopilot().px4_mut() {
            stub.params_mut().set("COM_OBL_RC_ACT", ParamValue::Int(0));
        }
        bench.survey();
        bench.strike();
        bench.flight.kill_companion();
        bench.safe_within(2.0, "no setpoint flies it", |b| {
            b.flight.rig.autopilot().mode_name() == "Position"
        });
        let is_down = bench.until(40.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
    })
}

pub(super) fn reentry(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.freeze_companion();
        left_alone(bench);
        bench.run(0.3);
        bench.flight.thaw_companion();
        bench.run(15.0);
        bench.demand(bench.setpoints_for_s() <= 0.0, "no setpoint draws it back");
        bench.demand(bench.commands().is_empty(), "nothing is commanded");
        let is_down = bench.until(30.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
    })
}

pub(super) fn early_setpoint(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.strike();
        bench.safe_already();
        let mut is_early = false;
        for _ in 0..14_000 {
            bench.step();
            is_early |= bench.flight.rig.autopilot().is_landed() && bench.seen.setpoint.is_some();
            if bench.phase() == Phase::Survey {
                break;
            }
        }
        bench.demand(!is_early, "no setpoint on the ground");
        bench.demand(bench.phase() == Phase::Survey, "takes off by command");
        let takes_off = bench.commands().contains(&MavCmd::MAV_CMD_NAV_TAKEOFF);
        bench.demand(takes_off, "by command");
    })
}

pub(super) fn late_notice(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.faults.is_camera_covered = true;
        bench.safe_within(5.0, "commands LAND itself", |b| b.flight.rig.autopilot().is_landing());
        bench.demand(!bench.flight.rig.autopilot().is_in_failsafe(), "before the autopilot");
        let is_down = bench.until(40.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
    })
}

pub(super) fn early_mode(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.run(2.0);
        bench.strike();
        bench.safe_already();
        let now = bench.now();
        // The operator's start comes while it boots.
        bench.autopilot().reboot(now);
        let is_flying = bench.until(75.0, |b| b.phase() == Phase::Survey);
        bench.demand(is_flying, "takes off in the end");
        bench.demand(!bench.said("called off"), "the start is not called off");
        bench.run(2.0);
    })
}

pub(super) fn moves_with_reset(lab: &mut Lab) -> anyhow::Result<()> {
    jump(lab, 1.0)
}
