//! What happens to the companion computer.

use super::Lab;
use crate::autopilot::Flavour;
use crate::faults::bench::Bench;
use mavlink::dialects::ardupilotmega::MavCmd;
use std::time::Duration;
use stockpilot::mission::Phase;

/// The vehicle without its companion: PX4 lands by itself, `ArduPilot` brakes, holds, and lands once
/// its estimate runs out, eight seconds later.
pub(super) fn left_alone(bench: &mut Bench) {
    match bench.flavour() {
        Flavour::Px4 => {
            bench.safe_within(1.6, "PX4 lands by its failsafe", |b| {
                b.flight.rig.autopilot().is_landing()
            });
        }
        Flavour::ArduPilot => {
            bench.safe_within(3.0, "ArduPilot brakes", |b| b.speed_mps() < 0.2);
            let held_at = bench.place();
            bench.run(5.0);
            let moved_m = (bench.place() - held_at).norm();
            // Without vision it dead-reckons: more than half a metre was seen on the real one.
            bench.demand(moved_m < 1.5, &format!("ArduPilot holds its place, not {moved_m:.1} m"));
        }
    }
}

/// A companion that came back has not taken the vehicle; a person lands it.
fn nothing_resumes(bench: &mut Bench) {
    let restarted_at = bench.now();
    bench.run(15.0);
    let last_setpoint = bench.seen.setpoint.map(|(at, _)| at);
    bench.demand(last_setpoint.is_none_or(|at| at < restarted_at), "no setpoint by itself");
    bench.demand(bench.commands().is_empty(), "no command by itself");
    if bench.flavour() == Flavour::ArduPilot {
        bench.flight.operator_mut().ask(MavCmd::MAV_CMD_USER_5);
    }
    let is_down = bench.until(40.0, Bench::is_down);
    bench.demand(is_down, "on the ground in the end");
}

pub(super) fn killed(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.kill_companion();
        left_alone(bench);
        bench.flight.restart_companion();
        nothing_resumes(bench);
    })
}

pub(super) fn hung(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        let struck_at = bench.now();
        bench.flight.freeze_companion();
        left_alone(bench);
        let heartbeat_at = bench.seen.heartbeat_at;
        bench.demand(heartbeat_at.is_none_or(|at| at <= struck_at), "the heartbeat stops");
        bench.demand(bench.setpoints_for_s() <= 0.0, "the setpoints stop");
        bench.flight.restart_companion();
        nothing_resumes(bench);
    })
}

pub(super) fn clocks(lab: &mut Lab) -> anyhow::Result<()> {
    // A detector that stamps with a wall clock: an hour off, either way, or in 1970.
    for offset_ns in [3_600_000_000_000, -3_600_000_000_000, -1_700_000_000_000_000_000] {
        lab.fly(|bench| {
            bench.survey();
            bench.strike();
            bench.flight.faults.camera_offset_ns = offset_ns;
            bench.safe_within(2.2, "holds without credible frames", |b| b.phase() == Phase::Hold);
            bench.flight.faults.camera_offset_ns = 0;
            let is_back = bench.until(6.0, |b| b.phase() == Phase::Survey);
            bench.demand(is_back, "goes on with credible frames");
        })?;
    }
    // The computer sleeps for 0.4 s; what came meanwhile waits for it.
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.freeze_companion();
        bench.run(Duration::from_millis(400).as_secs_f64());
        bench.flight.thaw_companion();
        bench.safe_within(5.0, "in the survey again", |b| {
            b.is_steered() && b.phase() == Phase::Survey
        });
        bench.run(5.0);
        bench.demand(bench.phase() == Phase::Survey, "goes on");
    })
}
