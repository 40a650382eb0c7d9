//! What leaves: setpoints, numbers, lines.

use super::*;

#[test]
fn no_broken_number_leaves() {
    let mut scene = Scene::heard();
    let good = Setpoint {
        at: at_ms(0),
        position: Point::new(1.0, 2.0, 3.0),
        velocity_mps: Direction::zero(),
        accel_mps2: Direction::zero(),
        yaw_rad: 0.0,
        yaw_rate_radps: 0.0,
    };
    // The last one is finite here but not in single precision.
    for broken in [f64::NAN, f64::INFINITY, 1e300] {
        let far = Setpoint { position: Point::new(1.0, broken, 3.0), ..good };
        scene.acts(&Action::Steer(far), 10);
        scene.acts(&Action::Steer(Setpoint { yaw_rate_radps: broken, ..good }), 10);
    }
    assert!(scene.sent().is_empty());
    assert_eq!(scene.session.stats().outbound_refused, 6);
    scene.acts(&Action::Steer(good), 20);
    assert_eq!(scene.sent().len(), 1);
}

fn volume_report(is_final: bool) -> VolumeReport {
    let estimate =
        VolumeEstimate { at: at_ms(0), volume_m3: 412.6, sigma_m3: 2.55, coverage_ratio: 0.731 };
    VolumeReport {
        estimate,
        hits: crate::messages::HitCounts::default(),
        phase: Phase::Survey,
        steps_done: 3,
        battery_ratio: None,
        position_sigma_m: Some(0.04),
        is_final,
    }
}

#[test]
fn the_volume_is_told_in_numbers_and_words() {
    let mut scene = Scene::heard();
    let mut values = Vec::new();
    let mut lines = Vec::new();
    for step in 0..=40 {
        scene.acts(&Action::ReportVolume(volume_report(step == 40)), step * 500);
        for message in scene.sent() {
            match message {
                MavMessage::NAMED_VALUE_FLOAT(data) => {
                    values.push((data.name.to_str().unwrap().to_owned(), data.value));
                }
                MavMessage::STATUSTEXT(data) => {
                    lines.push((step * 500, data.text.to_str().unwrap().to_owned()));
                }
                other => panic!("{other:?}"),
            }
        }
    }
    // 0 to 20 s at 1 Hz: 21 times four numbers.
    assert_eq!(values.len(), 21 * 4);
    let expected =
        [("VOLUME", 412.6), ("VOL_U", 5.1), ("COVERAGE", 0.731), ("POS_SIGMA", 0.04_f32)];
    for ((name, value), (expected_name, expected_value)) in values.iter().zip(expected) {
        assert_eq!(name, expected_name);
        assert!((value - expected_value).abs() < 1e-4, "{name} {value}");
    }
    let line = "volume 412.6 +- 5.1 m3, coverage 73 %".to_owned();
    let last = format!("final {line}");
    assert_eq!(lines, [(0, line.clone()), (15_000, line), (20_000, last)]);
}

#[test]
fn nothing_is_said_before_an_autopilot_is_there() {
    let mut scene = Scene::new();
    scene.acts(&Action::ReportVolume(volume_report(true)), 0);
    scene.acts(&Action::Command(VehicleCommand::Arm), 0);
    assert!(scene.sent().is_empty());
    assert_eq!(scene.outcomes(), [(VehicleCommand::Arm, false)]);
}

fn bay(name: &str, volume_m3: f64, mass_t: Option<f64>) -> VolumeAccount {
    VolumeAccount {
        name: name.to_owned(),
        estimate: VolumeEstimate { volume_m3, ..volume_report(false).estimate },
        mass: mass_t.map(|mass_t| Mass { mass_t, sigma_t: 0.5 }),
        budget: VolumeBudget::default(),
        shares: VolumeShares::default(),
    }
}

#[test]
fn bays_take_turns_in_numbers_and_each_has_a_last_line() {
    let mut scene = Scene::heard();
    let accounts =
        vec![bay("hall", 30.0, None), bay("gravel 0/32", 10.0, Some(15.0)), bay("ö", 20.0, None)];
    scene.acts(&Action::VolumesAccounted(accounts), 0);
    let mut values = Vec::new();
    let mut lines = Vec::new();
    for second in 0..=4 {
        scene.acts(&Action::ReportVolume(volume_report(second == 4)), second * 1_000);
        for message in scene.sent() {
            match message {
                MavMessage::NAMED_VALUE_FLOAT(data) => {
                    let name = data.name.to_str().unwrap().to_owned();
                    if name.as_bytes()[1].is_ascii_digit() {
                        values.push((second, name, data.value));
                    }
                }
                MavMessage::STATUSTEXT(data) => lines.push(data.text.to_str().unwrap().to_owned()),
                other => panic!("{other:?}"),
            }
        }
    }
    let of = |second| -> Vec<(&str, f32)> {
        let at = values.iter().filter(|(at, ..)| *at == second);
        at.map(|(_, name, value)| (name.as_str(), *value)).collect()
    };
    assert_eq!(of(0), [("V1_gravel_", 10.0), ("U1_gravel_", 5.1), ("T1_gravel_", 15.0)]);
    assert_eq!(of(1), [("V2__", 20.0), ("U2__", 5.1)]);
    assert_eq!(of(2), of(0));
    // Pieces of 50 bytes, each line by itself.
    let text = lines.concat();
    assert!(text.contains("final gravel 0/32 10.0 +- 5.1 m3, 15.0 +- 1.0 t"), "{text}");
    assert_eq!(text.matches("final").count(), 3, "{text}");
}
