//! Inertial samples that stay away, and a clock that jumps.

use crate::scene::{Flight, settings};
use crate::truth::stamp;
use stockpilot::localization::{Health, Update};
use stockpilot::messages::{CameraId, Verdict};

const UPDATES: [Update; 2] = [Update::Loose, Update::Tight];

#[test]
fn a_gap_of_80_ms_is_bridged_with_grown_uncertainty() {
    for update in UPDATES {
        let mut flight = Flight::new(1, settings(update), 0.05);
        flight.fly_until(6.0, true);
        flight.deaf = 6.0025..6.08;
        let before = flight.localizer.estimate().expect("started").error_cov;
        flight.fly_until(6.08, true);
        let after = flight.localizer.estimate().expect("started").error_cov;
        // Forces of 2 m/s² unseen for 80 ms are 0.16 m/s.
        assert!(after[(6, 6)].sqrt() > 0.12 && before[(6, 6)].sqrt() < 0.05);
        assert!(flight.nees().iter().all(|nees| *nees < 11.3), "{:?}", flight.nees());
        assert_eq!(flight.health(), Health::Good);
        flight.fly_until(8.0, true);
        assert!(flight.nees().iter().all(|nees| *nees < 16.3), "{:?}", flight.nees());
        assert_eq!(flight.localizer.estimate().expect("started").reset_counter, 0);
    }
}

#[test]
fn a_longer_gap_loses_the_position_and_the_next_fix_declares_a_jump() {
    for update in UPDATES {
        let mut flight = Flight::new(2, settings(update), 0.05);
        flight.fly_until(6.0, true);
        flight.deaf = 6.0025..6.4;
        flight.fly_until(6.6, false);
        assert_eq!(flight.health(), Health::Lost);
        assert!(flight.notices.iter().any(|notice| notice.text.contains("jumped by 0.5")));
        flight.fly_until(9.0, true);
        assert_eq!(flight.health(), Health::Good);
        assert_eq!(flight.localizer.estimate().expect("started").reset_counter, 1);
        let n_started = flight.records.iter().filter(|r| r.verdict == Verdict::Initialized).count();
        assert_eq!(n_started, 2, "the start and the new one");
        // The last frame before the gap was the last that agreed.
        let since_s = flight.localizer.take_doubt().expect("a restart").seconds();
        assert!((5.9..=6.0).contains(&since_s), "{since_s}");
        assert!(flight.localizer.take_doubt().is_none(), "said once");
        assert!(flight.nees().iter().all(|nees| *nees < 16.3), "{:?}", flight.nees());
    }
}

#[test]
fn a_map_of_scans_across_a_restart_has_no_transition() {
    let mut flight = Flight::new(3, settings(Update::Tight), 0.05);
    flight.fly_until(6.0, true);
    let at = |t: f64| stamp(t);
    let chained = flight.localizer.pose_error_at(at(5.9), Some(at(5.8))).expect("inside");
    assert!(chained.from_previous.norm() > 1.0 && chained.rate_radps.norm() > 0.0);
    let single = flight.localizer.pose_error_at(at(5.9), None).expect("inside");
    assert!(single.from_previous.norm() <= 0.0);
    assert!((single.cov - chained.cov).amax() <= 0.0);
    flight.deaf = 6.0025..6.4;
    flight.fly_until(8.0, true);
    let after = flight.localizer.pose_error_at(at(7.9), Some(at(5.9))).expect("inside");
    assert!(after.from_previous.norm() <= 0.0);
}

#[test]
fn staggered_cameras_do_not_hide_that_no_sample_comes() {
    let mut settings = settings(Update::Tight);
    settings.cameras.push(settings.cameras[0].clone());
    let mut flight = Flight::new(4, settings, 0.0);
    flight.fly_until(6.0, true);
    assert_eq!(flight.health(), Health::Good);
    // Two cameras of 30 fps, half a period apart: never more than 17 ms from frame to frame.
    let mut t = 6.0;
    for k in 0..150_u8 {
        t += 1.0 / 60.0;
        let mut frame = flight.frame(t);
        frame.camera = CameraId(k % 2);
        let record = flight.localizer.on_tags(&frame);
        assert_eq!(record.verdict == Verdict::FromTheFuture, t > 6.02, "{t}: {record:?}");
    }
    assert_eq!(flight.localizer.health(stamp(t)), Health::Lost);
}
