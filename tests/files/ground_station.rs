//! The buttons for QGroundControl send the commands that the service takes.

use serde_json::Value;
use stockpilot::link::OWN_COMPONENT;

const ACTIONS: &str = include_str!("../../deploy/ground-station/stockpilot-actions.json");
const README: &str = include_str!("../../README.md");

#[test]
fn each_button_is_one_of_the_five_commands() {
    let file: Value = serde_json::from_str(ACTIONS).unwrap();
    // QGroundControl refuses the whole file if a key is unknown to it.
    let keys =
        |value: &Value| -> Vec<String> { value.as_object().unwrap().keys().cloned().collect() };
    assert_eq!(keys(&file), ["actions", "fileType", "version"]);
    assert_eq!(file["fileType"], "MavlinkActions");
    let actions = file["actions"].as_array().unwrap();
    for (action, number) in actions.iter().zip(31_010..) {
        assert_eq!(keys(action), ["compId", "description", "label", "mavCmd"]);
        assert_eq!(action["mavCmd"], number);
        assert_eq!(action["compId"], OWN_COMPONENT);
        assert!(README.contains(&format!("| {number} |")), "{number} is in the README's table");
    }
    assert_eq!(actions.len(), 5);
}
