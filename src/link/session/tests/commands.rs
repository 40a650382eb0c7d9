//! Commands to the autopilot, and from people.

use super::*;
use crate::pilot::PhaseChange;

#[test]
fn of_two_acks_for_a_mode_the_second_counts() {
    let set_mode = MavCmd::MAV_CMD_DO_SET_MODE;
    let accepted = MavResult::MAV_RESULT_ACCEPTED;
    let enter = VehicleCommand::EnterCompanionMode;
    // Refused in the air: 0, then 1.
    let mut scene = Scene::heard();
    scene.acts(&Action::Command(enter), 100);
    let sent = scene.sent();
    let [MavMessage::COMMAND_LONG(command)] = sent.as_slice() else { panic!("{sent:?}") };
    assert_eq!((command.param1, command.param2, command.param3), (1.0, 6.0, 0.0));
    scene.hears(AUTOPILOT, ack(set_mode, accepted), 110);
    assert_eq!(scene.outcomes(), []);
    scene.hears(AUTOPILOT, ack(set_mode, MavResult::MAV_RESULT_TEMPORARILY_REJECTED), 120);
    assert_eq!(scene.outcomes(), [(enter, false)]);
    // Accepted twice.
    scene.acts(&Action::Command(enter), 200);
    scene.hears(AUTOPILOT, ack(set_mode, accepted), 210);
    scene.hears(AUTOPILOT, ack(set_mode, accepted), 220);
    assert_eq!(scene.outcomes(), [(enter, true)]);
    // Accepted once only: good after a while.
    scene.acts(&Action::Command(enter), 300);
    scene.hears(AUTOPILOT, ack(set_mode, accepted), 310);
    scene.tick(600);
    assert_eq!(scene.outcomes(), []);
    scene.tick(620);
    assert_eq!(scene.outcomes(), [(enter, true)]);
    // Arming is acknowledged once.
    scene.acts(&Action::Command(VehicleCommand::Arm), 700);
    scene.hears(AUTOPILOT, ack(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, accepted), 710);
    assert_eq!(scene.outcomes(), [(VehicleCommand::Arm, true)]);
}

#[test]
fn unanswered_commands_are_repeated_with_confirmation_and_given_up() {
    let mut scene = Scene::heard();
    scene.acts(&Action::Command(VehicleCommand::Arm), 0);
    let mut confirmations = Vec::new();
    for step in 0..=30 {
        scene.hears(AUTOPILOT, heartbeat(0x1d, 0), step * 100);
        scene.tick(step * 100);
        for message in scene.sent() {
            match message {
                MavMessage::COMMAND_LONG(data)
                    if data.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM =>
                {
                    confirmations.push(data.confirmation);
                }
                _ => {}
            }
        }
    }
    assert_eq!(confirmations, [0, 1, 2, 3, 4]);
    assert_eq!(scene.outcomes(), [(VehicleCommand::Arm, false)]);
    assert_eq!(scene.session.stats().commands_unanswered, 1);
    // A late answer finds nobody.
    let late = ack(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavResult::MAV_RESULT_ACCEPTED);
    scene.hears(AUTOPILOT, late, 3_200);
    assert_eq!(scene.outcomes(), []);
}

#[test]
fn a_newer_mode_replaces_an_older_one_under_way() {
    let mut scene = Scene::heard();
    scene.acts(&Action::Command(VehicleCommand::EnterCompanionMode), 0);
    scene.acts(&Action::Command(VehicleCommand::EnterLand), 50);
    assert_eq!(scene.outcomes(), [(VehicleCommand::EnterCompanionMode, false)]);
    let last = scene.sent().pop();
    let Some(MavMessage::COMMAND_LONG(data)) = last else { panic!("{last:?}") };
    assert_eq!((data.param2, data.param3), (4.0, 6.0));
}

/// The commands among `sent`, by their MAVLink numbers.
fn commands(sent: &[MavMessage]) -> Vec<MavCmd> {
    let command = |message: &MavMessage| match message {
        MavMessage::COMMAND_LONG(data) => Some(data.command),
        _ => None,
    };
    sent.iter().filter_map(command).collect()
}

#[test]
fn nothing_unanswered_is_repeated_over_a_pilot_who_has_taken_the_vehicle() {
    // PX4: OFFBOARD, then position mode, told by CURRENT_MODE or by the heartbeat.
    let (companion, position) = (0x0006_0000, 0x0003_0000);
    let by_heartbeat = |scene: &mut Scene| scene.hears(AUTOPILOT, heartbeat(0x9d, position), 100);
    let by_mode = |scene: &mut Scene| {
        let mode = wire::CURRENT_MODE_DATA { custom_mode: position, ..Default::default() };
        scene.hears(AUTOPILOT, MavMessage::CURRENT_MODE(mode), 100);
    };
    let taken: [&dyn Fn(&mut Scene); 2] = [&by_heartbeat, &by_mode];
    for is_taken in taken.into_iter().map(Some).chain([None]) {
        let mut scene = Scene::heard();
        scene.hears(AUTOPILOT, heartbeat(0x9d, companion), 10);
        scene.acts(&Action::Command(VehicleCommand::Disarm), 50);
        assert_eq!(commands(&scene.sent()), [MavCmd::MAV_CMD_COMPONENT_ARM_DISARM]);
        if let Some(take) = is_taken {
            take(&mut scene);
        }
        scene.tick(700);
        let is_repeated = commands(&scene.sent()).contains(&MavCmd::MAV_CMD_COMPONENT_ARM_DISARM);
        assert_eq!(is_repeated, is_taken.is_none(), "a lost one is repeated else");
    }
}

#[test]
fn what_was_asked_before_a_landing_is_not_repeated_in_it() {
    let mut scene = Scene::heard();
    scene.acts(&Action::Command(VehicleCommand::Arm), 0);
    let change = PhaseChange {
        at: at_ms(100),
        from: Phase::Preflight,
        to: Phase::Land,
        reason: "operator".to_owned(),
    };
    scene.acts(&Action::PhaseChanged(change), 100);
    scene.acts(&Action::Command(VehicleCommand::EnterLand), 100);
    scene.sent();
    scene.tick(700);
    assert_eq!(commands(&scene.sent()), [MavCmd::MAV_CMD_DO_SET_MODE]);
}

#[test]
fn answers_meant_for_others_do_not_count() {
    let mut scene = Scene::heard();
    scene.acts(&Action::Command(VehicleCommand::Arm), 0);
    let mut foreign = ack(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavResult::MAV_RESULT_ACCEPTED);
    if let MavMessage::COMMAND_ACK(data) = &mut foreign {
        data.target_system = 255;
        data.target_component = 190;
    }
    scene.hears(AUTOPILOT, foreign, 10);
    let spoofed = ack(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavResult::MAV_RESULT_ACCEPTED);
    scene.hears((9, 1), spoofed, 20);
    assert_eq!(scene.outcomes(), []);
}

#[test]
fn people_are_heard_and_answered() {
    let mut scene = Scene::heard();
    for (command, verb) in [
        (MavCmd::MAV_CMD_USER_1, OperatorVerb::Start),
        (MavCmd::MAV_CMD_USER_2, OperatorVerb::Hold),
        (MavCmd::MAV_CMD_USER_3, OperatorVerb::Resume),
        (MavCmd::MAV_CMD_USER_4, OperatorVerb::Return),
        (MavCmd::MAV_CMD_USER_5, OperatorVerb::Land),
    ] {
        scene.hears(PEOPLE, user_command((7, OWN_COMPONENT), command), 10);
        let from = OperatorRequest { system: 255, component: 190 };
        let told = Event::Operator(OperatorCommand { at: at_ms(10), verb, from });
        assert_eq!(scene.told(), [told]);
        assert!(scene.sent().is_empty(), "the brain answers");
        let answer = OperatorAnswer { verb, to: from, is_accepted: verb == OperatorVerb::Hold };
        scene.acts(&Action::Answer(answer), 20);
        let sent = scene.sent();
        let [MavMessage::COMMAND_ACK(data)] = sent.as_slice() else { panic!("{sent:?}") };
        assert_eq!(data.command, command);
        assert_eq!((data.target_system, data.target_component), (255, 190));
        assert_eq!(data.result == MavResult::MAV_RESULT_ACCEPTED, answer.is_accepted);
    }
}

#[test]
fn a_start_says_by_its_first_parameter_what_it_starts() {
    let start = |param1| {
        let mut scene = Scene::heard();
        let MavMessage::COMMAND_LONG(data) =
            user_command((7, OWN_COMPONENT), MavCmd::MAV_CMD_USER_1)
        else {
            panic!("another message")
        };
        scene.hears(
            PEOPLE,
            MavMessage::COMMAND_LONG(wire::COMMAND_LONG_DATA { param1, ..data }),
            10,
        );
        let verb = match scene.told().as_slice() {
            [Event::Operator(command)] => Some(command.verb),
            _ => None,
        };
        (verb, scene.sent().len())
    };
    assert_eq!(start(0.0), (Some(OperatorVerb::Start), 0));
    assert_eq!(start(f32::NAN), (Some(OperatorVerb::Start), 0));
    assert_eq!(start(1.0), (Some(OperatorVerb::FlyGaps), 0));
    // No motors by a number that means nothing: unsupported, and said so.
    assert_eq!(start(2.0), (None, 1));
    let gaps = OperatorAnswer {
        verb: OperatorVerb::FlyGaps,
        to: OperatorRequest { system: 255, component: 190 },
        is_accepted: true,
    };
    let mut scene = Scene::heard();
    scene.acts(&Action::Answer(gaps), 20);
    let sent = scene.sent();
    let [MavMessage::COMMAND_ACK(data)] = sent.as_slice() else { panic!("{sent:?}") };
    assert_eq!(data.command, MavCmd::MAV_CMD_USER_1);
}

#[test]
fn commands_to_others_are_ignored_and_unknown_ones_unsupported() {
    let mut scene = Scene::heard();
    for target in [(7, 1), (7, 192), (7, 0), (0, 0), (8, OWN_COMPONENT)] {
        scene.hears(PEOPLE, user_command(target, MavCmd::MAV_CMD_USER_1), 10);
    }
    assert!(scene.told().is_empty() && scene.sent().is_empty());
    assert_eq!(scene.session.stats().foreign_messages, 5);
    let arm = user_command((7, OWN_COMPONENT), MavCmd::MAV_CMD_COMPONENT_ARM_DISARM);
    scene.hears(PEOPLE, arm, 20);
    assert!(scene.told().is_empty());
    let sent = scene.sent();
    let [MavMessage::COMMAND_ACK(data)] = sent.as_slice() else { panic!("{sent:?}") };
    assert_eq!(data.result, MavResult::MAV_RESULT_UNSUPPORTED);
}

/// A brain that goes on asking must not be told that its first question was refused.
#[test]
fn what_is_under_way_is_not_asked_anew() {
    let mut scene = Scene::heard();
    let land = VehicleCommand::EnterLand;
    scene.acts(&Action::Command(land), 0);
    assert_eq!(scene.sent().len(), 1);
    scene.acts(&Action::Command(land), 100);
    assert_eq!((scene.sent().len(), scene.outcomes()), (0, Vec::new()));
    // Another mode by the same command takes its place.
    scene.acts(&Action::Command(VehicleCommand::EnterCompanionMode), 200);
    assert_eq!(scene.outcomes(), [(land, false)]);
}
