//! What happens to markers, camera and LiDAR, and to the estimate that rests on them.

use super::Lab;
use crate::camera_faults::CameraFault;
use crate::faults::bench::Bench;
use crate::lidar_faults::LidarFault;
use crate::scenario::{Conditions, Lidar, Planner, Scenario, Surface};
use crate::world::World;
use anyhow::Context;
use mavlink::dialects::ardupilotmega::MavCmd;
use nalgebra::Vector3;
use stockpilot::mission::Phase;

/// Time from the last marker to the hold, s: 1.5 s until the fix counts as lost, and a tick.
const HOLDS_WITHIN_S: f64 = 1.8;

fn holds_then_lands(bench: &mut Bench, hold_within_s: f64) {
    bench.safe_within(hold_within_s, "holds", |b| b.phase() == Phase::Hold);
    let lands = bench.until(3.5, |b| b.phase() == Phase::Land);
    bench.demand(lands, "lands after three seconds");
    let is_down = bench.until(40.0, Bench::is_down);
    bench.demand(is_down, "on the ground in the end");
}

pub(super) fn markers_lost(lab: &mut Lab) -> anyhow::Result<()> {
    for gone_s in [0.5, 2.0, 10.0, 40.0] {
        lab.fly(|bench| {
            bench.survey();
            bench.strike();
            bench.flight.faults.is_camera_covered = true;
            if gone_s < 1.0 {
                bench.safe_already();
                bench.run(gone_s);
                bench.flight.faults.is_camera_covered = false;
                bench.run(4.0);
                bench.demand(bench.phases().is_empty(), "half a second is bridged");
            } else if gone_s < 5.0 {
                bench.safe_within(HOLDS_WITHIN_S, "holds", |b| b.phase() == Phase::Hold);
                bench.run(gone_s - bench.since_s());
                bench.flight.faults.is_camera_covered = false;
                bench.run(4.0);
                let phases = [Phase::Hold, Phase::Survey];
                bench.demand(bench.phases() == phases, "holds, then goes on");
            } else {
                holds_then_lands(bench, HOLDS_WITHIN_S);
            }
        })?;
    }
    Ok(())
}

/// Smaller jumps may be taken for noise, m.
const JUMP_DECLARED_M: f64 = 0.3;
/// The survey's 2 m/s and what gusts add; a vehicle that is pulled to a far place goes faster.
const LUNGE_MPS: f64 = 2.3;

/// All markers move by this much: the place where the vehicle believes to be jumps.
pub(super) fn jump(lab: &mut Lab, by_m: f64) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.tolerate(by_m + 1.2);
        bench.strike();
        // Against the view, or those ahead would vanish in their wall.
        let yaw_rad = bench.flight.rig.vehicle().hall_from_body().rotation.yaw_rad();
        let direction = -Vector3::new(yaw_rad.cos(), yaw_rad.sin(), 0.0);
        bench.flight.rig.move_all_tags(&(direction * by_m));
        let n_resets_before = bench.seen.reset_counters.len();
        let is_declared = by_m > JUMP_DECLARED_M;
        let mut fastest_mps = 0.0_f64;
        for _ in 0..600 {
            bench.step();
            fastest_mps = fastest_mps.max(bench.speed_mps());
            let n_resets = bench.seen.reset_counters.len() - n_resets_before;
            if n_resets > 0 || !is_declared {
                // Both steer by the same place again.
                let is_agreed = bench.disagreement_m() < 0.3;
                if is_agreed {
                    bench.safe_now();
                }
            }
        }
        let is_safe = fastest_mps < LUNGE_MPS;
        bench.demand(is_safe, &format!("lunges at {fastest_mps:.1} m/s after the jump"));
        let n_resets = bench.seen.reset_counters.len() - n_resets_before;
        if is_declared {
            bench.demand(n_resets == 1, "the jump is declared once");
        }
        // The hall itself did not move with its markers: no further.
        bench.flight.operator_mut().ask(MavCmd::MAV_CMD_USER_5);
        let is_down = bench.until(40.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
    })
}

pub(super) fn relocalisation(lab: &mut Lab) -> anyhow::Result<()> {
    for by_m in [0.05, 0.5, 3.0] {
        jump(lab, by_m)?;
    }
    Ok(())
}

pub(super) fn wrong_markers(lab: &mut Lab) -> anyhow::Result<()> {
    let wrong = [
        CameraFault::WrongId,
        CameraFault::SwappedCorners,
        CameraFault::MovedTag,
        CameraFault::OutlierCorners,
        CameraFault::PlanarFlip,
    ];
    for fault in wrong {
        lab.fly(|bench| {
            bench.survey();
            bench.strike();
            bench.safe_already();
            bench.flight.faults.camera = Some(fault);
            let mut worst_m = 0.0_f64;
            for _ in 0..2_000 {
                bench.step();
                if bench.phase() == Phase::Survey {
                    worst_m = worst_m.max(bench.belief_error_m());
                }
            }
            bench.demand(worst_m < 0.3, &format!("{fault:?}: {worst_m:.2} m off"));
        })?;
    }
    Ok(())
}

pub(super) fn lidar_silent(lab: &mut Lab) -> anyhow::Result<()> {
    // A covered window and a head that stands send as many beams as ever; dark ground looks like the
    // first for a while.
    for (fault, holds_within_s) in
        [(LidarFault::Silent, 2.5), (LidarFault::Covered, 5.5), (LidarFault::Stands, 2.5)]
    {
        lab.fly(|bench| {
            bench.survey();
            bench.strike();
            bench.flight.faults.lidar = Some(fault);
            bench.safe_within(holds_within_s, "holds", |b| b.phase() == Phase::Hold);
            bench.run(7.0 - bench.since_s());
            bench.flight.faults.lidar = None;
            let is_back = bench.until(3.0, |b| b.phase() == Phase::Survey);
            bench.demand(is_back, "goes on");
        })?;
    }
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.faults.lidar = Some(LidarFault::Silent);
        bench.safe_within(2.5, "holds", |b| b.phase() == Phase::Hold);
        let is_down = bench.until(90.0, |b| b.is_down() && b.phase() == Phase::Idle);
        bench.demand(is_down, "on the ground in the end");
        let phases = [Phase::Hold, Phase::Return, Phase::Land, Phase::Idle];
        bench.demand(bench.phases() == phases, "holds, returns, lands");
    })
}

pub(super) fn camera_dead(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.faults.is_camera_dead = true;
        holds_then_lands(bench, HOLDS_WITHIN_S);
    })?;
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.faults.camera = Some(CameraFault::FrozenCamera);
        // The picture must first be seen to stand while the vehicle moves.
        holds_then_lands(bench, 4.0);
    })
}

pub(super) fn late_detections(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        // 50 to 800 ms, each frame another: they overtake each other.
        bench.flight.faults.camera_delays_ms = &[50, 800, 200, 550, 100, 700];
        bench.run(12.0);
        bench.demand(bench.phases().is_empty(), "the survey goes on");
    })?;
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        // Older than what the filter remembers.
        bench.flight.faults.camera_delays_ms = &[1_500];
        holds_then_lands(bench, HOLDS_WITHIN_S + 0.2);
    })
}

pub(super) fn narrow_halls(lab: &mut Lab) -> anyhow::Result<()> {
    let seed = lab.seed;
    let worlds = [
        World::columns(seed, 1.0).context("columns")?,
        World::l_hall(seed, 1.0).context("l-hall")?,
    ];
    for world in worlds {
        let scenario = Scenario {
            world,
            planner: Planner::SquareWave,
            surface: Surface::KalmanGrid,
            variance: None,
            lidar: Lidar::Ld19,
            autopilot: lab.flavour,
            camera: crate::camera::CameraModel::ahead(),
            n_steps: 40,
            seed,
            conditions: Conditions { leg_spacing_m: Some(5.0), ..Conditions::default() },
        };
        let bench = Bench::of(&scenario)?;
        lab.fly_on(bench, |bench| {
            bench.strike();
            bench.safe_already();
            let has_ended = bench.until(400.0, |b| b.flight.summary().is_some());
            bench.demand(has_ended, "the survey ends");
            bench.demand(bench.is_down(), "on the ground in the end");
        });
    }
    Ok(())
}

pub(super) fn frames(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        let (mut worst_m, mut worst_rad) = (0.0_f64, 0.0_f64);
        for _ in 0..4_000 {
            bench.step();
            let truth = bench.flight.rig.vehicle().hall_from_body();
            let (believed, _) = bench.flight.rig.autopilot().believed_motion();
            worst_m = worst_m.max((believed.origin.coords - truth.origin.coords).norm());
            worst_rad = worst_rad.max(believed.rotation.minus(&truth.rotation).norm());
        }
        bench.demand(worst_m < 0.4, &format!("the autopilot is {worst_m:.2} m off"));
        bench.demand(worst_rad < 0.15, &format!("the autopilot is {worst_rad:.2} rad off"));
    })
}
