//! On the ground: alignment without a tag, the declared pad, standstill.

use crate::scene::{Flight, settings};
use nalgebra::Vector3;
use stockpilot::geometry::Point;
use stockpilot::localization::{Health, PadPose, Settings, Update};
use stockpilot::messages::{FixSource, Verdict};

/// A flight that stands for ten seconds, and knows it.
fn standing(seed: u64, settings: Settings) -> Flight {
    let mut flight = Flight::new(seed, settings, 0.05).standing_until(10.0);
    flight.localizer.set_on_ground(true);
    flight
}

/// A pad declared with an error of one σ on each axis.
fn pad(flight: &Flight) -> PadPose {
    let truth = flight.motion.pose(0.0);
    PadPose {
        position: Point::from_coords(truth.origin.coords + Vector3::new(0.1, -0.1, 0.1)),
        yaw_rad: truth.rotation.yaw_rad() + 0.03,
        position_sigma_m: 0.1,
        yaw_sigma_rad: 0.03,
    }
}

#[test]
fn gravity_aligns_without_a_tag_and_says_nothing_of_the_position() {
    let mut flight = standing(1, settings(Update::Tight));
    flight.fly_until(5.0, false);
    assert_eq!(flight.health(), Health::Aligned);
    assert!(flight.localizer.estimate().is_none() && flight.localizer.position_sigma_m().is_none());
    let aligned = flight.localizer.alignment().expect("aligned");
    assert!(aligned.position_sigma_m().min() > 50.0);
    let up = |rotation: nalgebra::Matrix3<f64>| rotation.transpose() * Vector3::z();
    let truth = flight.motion.pose(0.0).rotation.matrix();
    // An accelerometer bias of 0.15 m/s² per axis tilts by 0.015 rad; three of that on two axes.
    let tilt = up(truth).angle(&up(aligned.hall_from_body.rotation.matrix()));
    assert!(tilt < 0.06, "{tilt}");
    // 5e-4 rad/s/√Hz over five seconds, twice three σ.
    let bias_error = (aligned.gyro_bias_radps - flight.sensors.gyro_bias_radps).norm();
    assert!(bias_error < 1.5e-3, "{bias_error}");
    flight.fly_until(14.0, true);
    assert_eq!(flight.health(), Health::Good);
    assert!(flight.error()[0].norm() < 0.05, "{:?}", flight.error());
    assert_eq!(flight.localizer.estimate().expect("started").reset_counter, 0);
}

#[test]
fn nobody_is_aligned_without_the_word_that_it_is_on_the_ground() {
    let mut flight = standing(1, settings(Update::Tight));
    flight.localizer.set_on_ground(false);
    flight.fly_until(5.0, false);
    assert_eq!(flight.health(), Health::Uninitialized);
    assert!(flight.records.is_empty());
}

#[test]
fn a_declared_pad_is_good_on_the_ground_and_lost_in_flight() {
    let declared = pad(&Flight::new(2, settings(Update::Tight), 0.05));
    let settings = Settings { pad: Some(declared), ..settings(Update::Tight) };
    let mut flight = standing(2, settings);
    flight.fly_until(9.0, false);
    assert_eq!(flight.health(), Health::Good);
    let [position, attitude, velocity] = flight.nees();
    // One σ per axis was declared; 11.3 is the 99 % quantile of χ² with 3 degrees of freedom.
    assert!(position < 11.3 && attitude < 11.3 && velocity < 11.3);
    assert!((position - 3.0).abs() < 1.0, "{position}");
    flight.localizer.set_on_ground(false);
    flight.fly_until(12.0, false);
    assert_eq!(flight.health(), Health::Lost);
    flight.fly_until(15.0, true);
    assert_eq!(flight.health(), Health::Good);
}

#[test]
fn a_wrong_pad_gives_way_to_the_tags_with_a_declared_jump() {
    let flight = Flight::new(3, settings(Update::Tight), 0.05);
    let mut declared = pad(&flight);
    declared.position.coords += Vector3::new(3.0, 0.0, 0.0);
    let settings = Settings { pad: Some(declared), ..settings(Update::Tight) };
    let mut flight = standing(3, settings);
    flight.fly_until(3.0, false);
    assert_eq!(flight.health(), Health::Good, "it cannot know better");
    flight.fly_until(6.0, true);
    assert_eq!(flight.localizer.estimate().expect("started").reset_counter, 1);
    assert!(flight.error()[0].norm() < 0.05, "{:?}", flight.error());
    assert!(flight.notices.iter().any(|notice| notice.text.starts_with("position found anew")));
}

#[test]
fn a_standstill_is_fused_on_the_ground_and_recorded_once_a_second() {
    let mut flight = standing(4, settings(Update::Tight));
    flight.fly_until(8.0, true);
    let stands: Vec<_> =
        flight.records.iter().filter(|record| record.source == FixSource::Standstill).collect();
    assert!((6..=7).contains(&stands.len()), "{}", stands.len());
    assert!(stands.iter().all(|record| record.n_points == 10 && record.n_points_used >= 9));
    assert!(stands.iter().all(|record| record.verdict == Verdict::Fused));
    // The accelerometer's bias is told from the tilt by the tags alone; the velocity is known.
    let estimate = flight.localizer.estimate().expect("started");
    assert!(estimate.error_cov[(6, 6)].sqrt() < 0.01);
    assert!(flight.nees().iter().all(|nees| *nees < 16.3), "{:?}", flight.nees());
    // It moves although the word still stands: the samples contradict the word.
    flight.fly_until(18.0, true);
    let n_moving = flight
        .records
        .iter()
        .filter(|record| record.source == FixSource::Standstill && record.at.seconds() > 11.0)
        .map(|record| record.n_points_used)
        .sum::<usize>();
    assert!(n_moving <= 1, "{n_moving} standstills fused in motion");
    assert!(flight.nees().iter().all(|nees| *nees < 16.3), "{:?}", flight.nees());
}
