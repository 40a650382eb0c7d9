//! What people see and ask beside the five commands: parameters, the quality of the fix, repetitions.

use super::*;
use crate::geometry::{Rotation, Transform};
use crate::link::PAGE;
use crate::link::params::Published;
use crate::messages::NavEstimate;
use nalgebra::{SMatrix, Vector3};

fn operator(command: MavCmd) -> MavMessage {
    user_command((7, OWN_COMPONENT), command)
}

fn results(messages: &[MavMessage]) -> Vec<(MavCmd, MavResult)> {
    let result = |message: &MavMessage| match message {
        MavMessage::COMMAND_ACK(data) => Some((data.command, data.result)),
        _ => None,
    };
    messages.iter().filter_map(result).collect()
}

#[test]
fn a_start_that_comes_again_after_it_was_called_off_is_refused() {
    let mut scene = Scene::heard();
    let from = OperatorRequest { system: 255, component: 190 };
    let yes = |verb| Action::Answer(OperatorAnswer { verb, to: from, is_accepted: true });
    scene.hears(PEOPLE, operator(MavCmd::MAV_CMD_USER_1), 0);
    assert_eq!(scene.told().len(), 1);
    scene.acts(&yes(OperatorVerb::Start), 10);
    scene.hears(PEOPLE, operator(MavCmd::MAV_CMD_USER_2), 1_000);
    assert_eq!(scene.told().len(), 1);
    scene.acts(&yes(OperatorVerb::Hold), 1_010);
    scene.sent();
    // The first answer was lost: the ground station asks again, and nobody hears of it.
    scene.hears(PEOPLE, operator(MavCmd::MAV_CMD_USER_1), 3_000);
    assert!(scene.told().is_empty());
    let refused = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
    assert_eq!(results(&scene.sent()), [(MavCmd::MAV_CMD_USER_1, refused)]);
    // The hold comes again too; the mission is idle now and says no, the person hears the yes.
    scene.hears(PEOPLE, operator(MavCmd::MAV_CMD_USER_2), 4_000);
    assert_eq!(scene.told().len(), 1, "a hold always reaches the mission");
    let no = OperatorAnswer { verb: OperatorVerb::Hold, to: from, is_accepted: false };
    scene.acts(&Action::Answer(no), 4_010);
    let accepted = MavResult::MAV_RESULT_ACCEPTED;
    assert_eq!(results(&scene.sent()), [(MavCmd::MAV_CMD_USER_2, accepted)]);
}

#[test]
fn parameters_are_shown_at_the_pace_of_the_ticks() {
    let mut scene = Scene::new();
    let mut settings = Settings::new("udpin:127.0.0.1:0".parse().unwrap());
    settings.published =
        ["SP_A", "SP_B", "SP_C"].map(|name| Published { name, value: 1.0 }).to_vec();
    scene.session = Session::new(settings);
    let list = MavMessage::PARAM_REQUEST_LIST(wire::PARAM_REQUEST_LIST_DATA {
        target_system: 7,
        target_component: 0,
    });
    // Before the autopilot is known there is no address to answer under.
    scene.hears(PEOPLE, list.clone(), 0);
    scene.hears(AUTOPILOT, heartbeat(0x1d, 0x0304_0000), 0);
    scene.tick(0);
    scene.sent();
    scene.hears(PEOPLE, list, 10);
    let mut n_per_tick = Vec::new();
    for ms in [17, 33, 50] {
        scene.tick(ms);
        let sent = scene.sent();
        n_per_tick.push(sent.iter().filter(|m| matches!(m, MavMessage::PARAM_VALUE(_))).count());
    }
    assert_eq!(n_per_tick, [2, 1, 0]);
}

#[test]
fn the_quality_of_the_fix_is_told_once_a_second_and_falls_to_zero() {
    let mut scene = Scene::heard();
    // 0.2 m of the 1 m at which the quality ends.
    let mut error_cov = SMatrix::<f64, 15, 15>::identity() * 1e-6;
    error_cov[(1, 1)] = 0.04;
    let estimate = NavEstimate {
        at: at_ms(0),
        hall_from_body: Transform::new(Rotation::identity(), Point::new(1.0, 2.0, 3.0)),
        velocity_mps: Direction::zero(),
        gyro_radps: Vector3::zeros(),
        gyro_bias_radps: Vector3::zeros(),
        accel_bias_mps2: Vector3::zeros(),
        error_cov,
        reset_counter: 0,
    };
    let mut told = Vec::new();
    for ms in (0..4_000).step_by(20) {
        scene.hears(AUTOPILOT, heartbeat(0x1d, 0x0304_0000), ms);
        if ms < 2_500 {
            scene.acts(&Action::PublishOdometry(Box::new(estimate.clone())), ms);
        }
        scene.tick(ms);
        for message in scene.sent() {
            if let MavMessage::NAMED_VALUE_FLOAT(data) = message {
                assert_eq!(data.name.to_str(), Ok("FIX_Q"));
                told.push((ms, data.value));
            }
        }
    }
    // 100 × (1 − 0.2); nothing is fixed after 2.5 s.
    assert_eq!(told, [(0, 80.0), (1_000, 80.0), (2_000, 80.0), (3_000, 0.0)]);
}

#[test]
fn the_own_page_asks_like_a_ground_station_and_nobody_on_the_wire_is_it() {
    let mut scene = Scene::heard();
    let answer = |verb, is_accepted| OperatorAnswer { verb, to: PAGE, is_accepted };
    let start = scene.session.on_own_wish(OperatorVerb::Start, at_ms(0));
    assert!(matches!(start, Some(Event::Operator(command)) if command.from == PAGE));
    let yes = answer(OperatorVerb::Start, true);
    assert!(scene.session.own_answer(&yes, at_ms(0)));
    // The answer goes to the page, not to everybody on the link.
    scene.acts(&Action::Answer(yes), 10);
    assert_eq!(results(&scene.sent()), []);
    // Called off: a start that comes late is refused without the mission, a hold never is.
    scene.session.own_answer(&answer(OperatorVerb::Hold, true), at_ms(1_000));
    assert_eq!(scene.session.on_own_wish(OperatorVerb::Start, at_ms(3_000)), None);
    assert!(scene.session.on_own_wish(OperatorVerb::Hold, at_ms(3_000)).is_some());
    // System 0 means everybody: who sends under it could take the page's answers.
    scene.hears((0, OWN_COMPONENT), operator(MavCmd::MAV_CMD_USER_1), 4_000);
    assert!(scene.told().is_empty() && results(&scene.sent()).is_empty());
}
