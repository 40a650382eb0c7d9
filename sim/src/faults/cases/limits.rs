//! What computer and line cannot do, and what ends or wraps in flight.

use super::Lab;
use super::autopilot::drifting_odometry;
use crate::autopilot::StubAutopilot;
use crate::faults::bench::{Bench, scenario};
use crate::scenario::Scenario;
use crate::world::{Cuboid, Region, World};
use anyhow::Context;
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega as m;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage};
use nalgebra::Vector3;
use std::time::Duration;
use stockpilot::mission::Phase;
use stockpilot::stats::SeedBook;

const GROUND_STATION: MavHeader = MavHeader { system_id: 255, component_id: 190, sequence: 0 };
/// A radio's 57600 baud, bytes/s in each direction.
const RADIO_BYTES_PER_S: f64 = 5_760.0;
/// Of every 100 ms a throttled computer works so long, in steps of 5 ms.
const WORKING_STEPS: usize = 6;

/// The power fails: what is in the file by then is a log up to some instant.
pub(super) fn power_cut(lab: &mut Lab) -> anyhow::Result<()> {
    let seed = lab.seed;
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        let mut noise = SeedBook::new(seed).stream("power cut");
        for _ in 0..20 {
            bench.run(0.2);
            match bench.flight.log_cut_at(noise.uniform()) {
                Ok(is_prefix) => bench.demand(is_prefix, "a cut log holds what came before"),
                Err(error) => bench.demand(false, &format!("a cut log: {error}")),
            }
        }
        bench.demand(bench.phases().is_empty(), "the survey goes on");
    })
}

/// The processor is throttled to a third: the loop works 30 ms and waits 70.
pub(super) fn slow_computer(lab: &mut Lab) -> anyhow::Result<()> {
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        let mut longest_s = 0.0_f64;
        for step in 0..3_000 {
            match step % 20 {
                0 => bench.flight.thaw_companion(),
                WORKING_STEPS => bench.flight.freeze_companion(),
                _ => {}
            }
            bench.step();
            let age_s = bench.seen.setpoint.map_or(0.0, |(at, _)| bench.now().seconds_since(at));
            longest_s = longest_s.max(age_s);
        }
        bench.demand(longest_s < 0.12, &format!("no setpoint for {longest_s:.3} s"));
        bench.demand(bench.belief_error_m() < 0.15, "knows its place");
        let is_flown = bench.phases().iter().all(|p| matches!(p, Phase::Hold | Phase::Survey));
        bench.demand(is_flown, "the survey goes on, or waits");
        bench.flight.thaw_companion();
        bench.run(3.0);
    })
}

/// What does not fit is lost, what fits is late.
pub(super) fn slow_link(lab: &mut Lab) -> anyhow::Result<()> {
    // From the ground on: clocks and streams never come about, so neither does a flight.
    lab.fly(|bench| {
        bench.flight.link.slow_down(RADIO_BYTES_PER_S);
        bench.strike();
        bench.safe_already();
        bench.run(75.0);
        bench.demand(!bench.flight.rig.autopilot().is_armed(), "no start over such a line");
        bench.demand(bench.flight.texts().iter().any(|t| t.contains("no take-off")), "is told");
    })?;
    // In flight: a third of the inertial samples arrives, and late; nothing is flown by them, and
    // what keeps the vehicle safe still gets through.
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.flight.link.slow_down(RADIO_BYTES_PER_S);
        bench.safe_within(1.5, "waits", |bench| bench.phase() == Phase::Hold);
        bench.safe_within(2.5, "lands", |bench| bench.phase() == Phase::Land);
        let is_down = bench.until(60.0, Bench::is_down);
        bench.demand(bench.said("samples are"), "says why");
        bench.demand(is_down, "on the ground in the end");
    })?;
    // Only the way to the autopilot is slow: every sample is in time, and the survey goes on.
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        bench.flight.link.slow_down_to_autopilot(RADIO_BYTES_PER_S);
        bench.run(20.0);
        bench.demand(bench.phases().is_empty() && bench.is_steered(), "the survey goes on");
        bench.flight.operator_mut().ask(MavCmd::MAV_CMD_USER_5);
        let is_down = bench.until(60.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
    })
}

/// A door opens beside a leg that a rail accompanies. The vehicle is pushed towards it; it must not be led
/// there, nor held there.
pub(super) fn blown(lab: &mut Lab) -> anyhow::Result<()> {
    let rail = Cuboid::over(&Region::new(6.0, RAIL_Y_M - 0.2, 21.0, RAIL_Y_M), 6.0, 8.0);
    let mut world = World::piles(lab.seed).context("a generated world")?;
    world.obstacles.push(rail);
    let bench = Bench::of(&Scenario { world, ..scenario(lab.flavour, lab.seed)? })?;
    lab.fly_on(bench, |bench| {
        bench.survey();
        let is_beside = bench.until(60.0, |b| b.place().x > 8.0);
        bench.demand(is_beside, "a leg beside the rail");
        bench.strike();
        bench.tolerate(f64::INFINITY);
        let mut nearest_m = f64::INFINITY;
        let mut is_blown = true;
        for _ in 0..1_600 {
            // Ever stronger, until the vehicle gives way.
            is_blown &= bench.phase() == Phase::Survey;
            let blast_mps =
                if is_blown { BLAST_MPS + BLAST_GROWS_MPS2 * bench.since_s() } else { 0.0 };
            bench.flight.rig.vehicle_mut().blast(Vector3::y() * -blast_mps);
            bench.step();
            let led_to_m = bench.seen.setpoint.map_or(f64::INFINITY, |(_, place)| place.y);
            nearest_m = nearest_m.min(led_to_m - RAIL_Y_M);
            if bench.phase() == Phase::Hold {
                bench.safe_now();
            }
        }
        bench.demand(nearest_m > KEPT_OFF_M, &format!("led to {nearest_m:.2} m beside the rail"));
        bench.demand(bench.said("too near to something: holding"), "holds and says why");
        let is_settled = bench.until(30.0, |b| b.phase() == Phase::Survey);
        bench.demand(is_settled, "the survey goes on");
    });
    Ok(())
}

/// 1.1 m beside a leg.
const RAIL_Y_M: f64 = 1.4;
/// The air's speed at first, and how fast it grows.
const BLAST_MPS: f64 = 10.0;
const BLAST_GROWS_MPS2: f64 = 20.0;
/// The vehicle's radius and the margin around it.
const KEPT_OFF_M: f64 = 0.5;

/// The autopilot has been on for 49.7 days: its count of milliseconds begins again.
pub(super) fn wraps(lab: &mut Lab) -> anyhow::Result<()> {
    let flavour = lab.flavour;
    // While the survey is on its way: it begins some 15 s after the start.
    let lead = Duration::from_millis(1 << 32).saturating_sub(Duration::from_secs(35));
    lab.fly(move |bench| {
        *bench.autopilot() = StubAutopilot::indoor(flavour, lead);
        bench.survey();
        bench.run((36.0 - bench.now().seconds()).max(0.0));
        bench.strike();
        let is_surveying = bench.phase() == Phase::Survey;
        bench.demand(is_surveying && bench.is_steered(), "the survey goes on over the wrap");
        bench.demand(!bench.said("has restarted"), "no restart is made of it");
        // What the autopilot believes is still compared. A wall is a metre away, and whoever lands by a
        // place that drifts on drifts along.
        drifting_odometry(bench, 0.9);
        bench.safe_within(4.5, "lands", |b| b.phase() == Phase::Land);
        let is_down = bench.until(40.0, Bench::is_down);
        bench.demand(is_down, "on the ground in the end");
    })?;
    // Somebody writes one of the own parameters in flight: they are what was configured.
    lab.fly(|bench| {
        bench.survey();
        bench.strike();
        bench.safe_already();
        for name in ["SP_SPEED_MPS", "SP_BAT_RETURN", "SP_HEIGHT_M", "SP_STEPS"] {
            let set = m::PARAM_SET_DATA {
                param_id: name.into(),
                param_value: 99.0,
                target_system: 1,
                target_component: 191,
                param_type: m::MavParamType::MAV_PARAM_TYPE_REAL32,
            };
            bench.flight.link.inject(GROUND_STATION, MavMessage::PARAM_SET(set));
        }
        bench.run(5.0);
        bench.demand(bench.phases().is_empty() && bench.is_steered(), "the survey goes on");
        bench.demand(bench.speed_mps() < 2.5, "no faster");
    })
}
