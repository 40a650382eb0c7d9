//! The pilot's mode switch against the setpoints, a thousand times for each autopilot.

use crate::support::Flight;
use mavlink::dialects::ardupilotmega::MavMessage;
use std::time::Duration;
use stockpilot::mission::Phase;
use stockpilot::pilot::Action;
use stockpilot::stats::SeedBook;
use stockpilot_sim::autopilot::Flavour;
use stockpilot_sim::campaign::{DirectFlight, Witnessed};

const TRIALS: usize = 1000;
const SEED: u64 = 51;

/// Time from the switch to the last setpoint, s; 0 if none came after it. Complains of any command.
fn setpoints_after_switch(mut flight: DirectFlight) -> f64 {
    let switched_at = flight.rig.now();
    flight.rig.autopilot_mut().pilot_takes_over();
    let (mut last, mut commands) = (switched_at, Vec::new());
    while flight.rig.now() < switched_at.plus(Duration::from_millis(300)) {
        flight.step(&mut |now, witnessed| match witnessed {
            Witnessed::ToAutopilot(MavMessage::SET_POSITION_TARGET_LOCAL_NED(_)) => last = now,
            Witnessed::Action(Action::Command(command)) => commands.push(*command),
            _ => {}
        });
    }
    assert_eq!(commands, [], "after the switch");
    assert_eq!(flight.phase(), Phase::Abort);
    assert!(flight.rig.autopilot().is_with_pilot());
    last.seconds_since(switched_at)
}

fn in_random_trials(flavour: Flavour) {
    let mut flight = Flight::in_survey_of(flavour, SEED);
    let mut noise = SeedBook::new(SEED).stream("switch");
    let mut longest_s = 0.0_f64;
    for _ in 0..TRIALS {
        // Anywhere between two heartbeats, in legs, in turns and in between.
        flight.run(noise.between(0.005, 0.055));
        assert_eq!(flight.phase(), Phase::Survey, "the survey must outlast the trials");
        longest_s = longest_s.max(setpoints_after_switch(flight.direct.fork()));
    }
    assert!(longest_s <= 0.05, "seed {SEED}: setpoints for {longest_s} s after the switch");
    // Were it always 0, nothing would have been measured: PX4 tells the mode with its next heartbeat.
    // ArduPilot sends one at once, so that no setpoint may follow at all.
    assert_eq!(longest_s > 0.0, flavour == Flavour::Px4, "seed {SEED}: {longest_s} s");
}

#[test]
fn the_pilots_switch_stops_setpoints_within_50_ms_in_1000_trials_on_px4() {
    in_random_trials(Flavour::Px4);
}

#[test]
fn the_pilots_switch_stops_setpoints_within_50_ms_in_1000_trials_on_ardupilot() {
    in_random_trials(Flavour::ArduPilot);
}
