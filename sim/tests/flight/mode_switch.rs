//! The pilot's mode switch against the setpoints, a thousand times for each autopilot.

use crate::support::Flight;
use mavlink::dialects::ardupilotmega::MavMessage;
use std::time::Duration;
use stockpilot::mission::Phase;
use stockpilot::pilot::Action;
use stockpilot::stats::SeedBook;
use stockpilot_sim::autopilot::{Flavour, StubAutopilot};
use stockpilot_sim::campaign::{DirectFlight, Witnessed};

const TRIALS: usize = 1000;
const SEED: u64 = 51;

/// Time from the switch to the last setpoint, s; 0 if none came after it. Complains of any command.
fn setpoints_after_switch(mut flight: DirectFlight, watched: Duration) -> f64 {
    let switched_at = flight.rig.now();
    flight.rig.autopilot_mut().pilot_takes_over();
    let (mut last, mut commands) = (switched_at, Vec::new());
    while flight.rig.now() < switched_at.plus(watched) {
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
        // Anywhere between two words on the mode, in legs, in turns and in between.
        flight.run(noise.between(0.005, 0.055));
        assert_eq!(flight.phase(), Phase::Survey, "the survey must outlast the trials");
        let watched = Duration::from_millis(300);
        longest_s = longest_s.max(setpoints_after_switch(flight.direct.fork(), watched));
    }
    assert!(longest_s <= 0.05, "seed {SEED}: setpoints for {longest_s} s after the switch");
    // Were it always 0, nothing would have been measured: PX4 tells the mode 20 ms after its last word
    // on it at the earliest. ArduPilot's heartbeat leaves at once, so that no setpoint may follow at all.
    assert_eq!(longest_s > 0.0, flavour == Flavour::Px4, "seed {SEED}: {longest_s} s");
}

/// PX4 before v1.15 knows no `CURRENT_MODE`, and no PX4 sends its heartbeat faster than once a second.
#[test]
fn an_old_px4_tells_the_switch_a_second_late_and_that_is_told_before_the_start() {
    let mut flight = Flight::in_survey_with(Flavour::Px4, SEED, |autopilot| {
        if let StubAutopilot::Px4(stub) = autopilot {
            stub.forgets_current_mode();
        }
    });
    let told = "mode switch seen up to 1 s late";
    assert!(flight.direct.texts().iter().any(|text| text.contains(told)));
    let mut noise = SeedBook::new(SEED).stream("old switch");
    let mut longest_s = 0.0_f64;
    for _ in 0..20 {
        flight.run(noise.between(0.05, 0.55));
        let watched = Duration::from_millis(1_300);
        longest_s = longest_s.max(setpoints_after_switch(flight.direct.fork(), watched));
    }
    assert!(0.5 < longest_s && longest_s < 1.05, "seed {SEED}: {longest_s} s");
}

#[test]
fn the_pilots_switch_stops_setpoints_within_50_ms_in_1000_trials_on_px4() {
    in_random_trials(Flavour::Px4);
}

#[test]
fn the_pilots_switch_stops_setpoints_within_50_ms_in_1000_trials_on_ardupilot() {
    in_random_trials(Flavour::ArduPilot);
}
