//! News in, pictures out.

use super::*;
use crate::camera::CameraStats;
use crate::geometry::{Direction, Point, Rotation, Transform};
use crate::lidar::LidarStatus;
use crate::messages::{
    GridGeometry, NavEstimate, StatusText, VolumeAccount, VolumeBudget, VolumeEstimate,
    VolumeShares,
};
use crate::pilot::{OfferedGap, PhaseChange, PlanChoice};
use crate::planning::planner::{PlanEnd, Prediction};
use crate::web::state::Viewers;
use nalgebra::{SMatrix, Vector3};
use std::time::Duration;

/// A hall of 6 m × 4 m without anything in it.
pub(in crate::web) fn scene() -> Scene {
    Scene {
        region_m: [0.0, 0.0, 6.0, 4.0],
        bays: Vec::new(),
        exclusions: Vec::new(),
        walls_m: Vec::new(),
        ceiling_m: None,
        obstacles: Vec::new(),
        fence_m: Vec::new(),
        fence_heights_m: None,
        tags_m: Vec::new(),
        flight_height_m: 5.0,
        survey_yaw_rad: 0.0,
        min_fix_quality: 8.0,
        max_speed_mps: 2.0,
        target_sigma_ratio: None,
        grid: GridGeometry { x_min_m: 0.0, y_min_m: 0.0, cell_m: 1.0, n_cols: 6, n_rows: 4 },
    }
}

fn collector() -> Collector {
    Collector::new(scene(), Maps::default(), 2.0, "flight.mcap".to_owned())
}

fn beside(now: Instant) -> Beside {
    Beside {
        lidar: LidarStatus::default(),
        camera: CameraStats::default(),
        viewers: Viewers::default(),
        has_token: false,
        free_bytes: None,
        news_lost: 0,
        now,
    }
}

fn outlook(at_s: i64, phase: Phase) -> Outlook {
    Outlook {
        at: Stamp::from_nanos(at_s * 1_000_000_000),
        phase,
        checks: Vec::new(),
        has_position: true,
        disagreement_m: None,
        has_lidar: true,
        estimate: None,
        vehicle: None,
        is_autopilot_lost: false,
        battery: None,
        turns_home_at_ratio: 0.25,
        until_turn_home_s: None,
        way_home_ratio: None,
        steps_done: 0,
        ahead_m: Vec::new(),
        flown_m: 0.0,
        hits: crate::messages::HitCounts::default(),
        storage: None,
        gaps: std::sync::Arc::default(),
        is_into_gaps: false,
    }
}

fn account(name: &str, volume_m3: f64, sigma_m3: f64) -> VolumeAccount {
    let shares = VolumeShares { measured_ratio: 1.0, ..VolumeShares::default() };
    VolumeAccount {
        name: name.to_owned(),
        estimate: VolumeEstimate { at: Stamp::ZERO, volume_m3, sigma_m3, coverage_ratio: 0.5 },
        mass: None,
        budget: VolumeBudget::default(),
        shares,
    }
}

fn change(from: Phase, to: Phase, at_s: i64) -> News {
    let at = Stamp::from_nanos(at_s * 1_000_000_000);
    News::Action(at, Action::PhaseChanged(PhaseChange { at, from, to, reason: "asked".to_owned() }))
}

#[tokio::test]
async fn a_silent_brain_is_told_and_nothing_else() {
    let mut collector = collector();
    let now = Instant::now();
    let never = collector.picture(&beside(now));
    assert!(!never.is_brain_alive && never.warnings.len() == 1);
    collector.take(News::Outlook(Box::new(outlook(1, Phase::Survey)), Box::default()), now);
    assert!(collector.picture(&beside(now + Duration::from_millis(900))).is_brain_alive);
    let late = collector.picture(&beside(now + Duration::from_millis(1_100)));
    assert!(!late.is_brain_alive);
    assert!(late.warnings[0].todo.contains("mode switch"), "{:?}", late.warnings);
}

#[tokio::test]
async fn volumes_are_stated_as_the_gum_wants_and_the_whole_is_not_told_twice() {
    let mut collector = collector();
    let now = Instant::now();
    let told = |accounts| News::Action(Stamp::ZERO, Action::VolumesAccounted(accounts));
    // One bay is the whole.
    collector.take(told(vec![account("hall", 1203.6, 9.0), account("salt", 1203.6, 9.0)]), now);
    collector.take(told(vec![account("hall", 1203.6, 7.0), account("salt", 1203.6, 7.0)]), now);
    let picture = collector.picture(&beside(now));
    assert_eq!(picture.volumes.len(), 1);
    let salt = &picture.volumes[0];
    // U = 14 m³: y is rounded to whole m³. JCGM 100:2008, 7.2.6.
    assert_eq!(
        (salt.name.as_str(), salt.stated_m3.each_ref().map(String::as_str)),
        ("salt", ["1204", "14"])
    );
    assert_eq!(salt.trend, -1);
    assert!((salt.expanded_percent.unwrap() - 100.0 * 14.0 / 1203.6).abs() < 1e-9);
    assert_eq!(picture.n_points, 2);
    let three = vec![account("hall", 9.0, 1.0), account("a", 4.0, 0.5), account("b", 5.0, 0.9)];
    collector.take(told(three), now);
    assert_eq!(collector.picture(&beside(now)).volumes.len(), 3);
}

#[tokio::test]
async fn a_flight_into_the_gaps_keeps_the_page_and_the_decision_until_it_takes_off() {
    let mut collector = collector();
    let now = Instant::now();
    let told = vec![account("hall", 10.0, 1.0)];
    collector.take(change(Phase::Preflight, Phase::TakeOff, 10), now);
    collector.take(News::Action(Stamp::ZERO, Action::VolumesAccounted(told.clone())), now);
    let summary = FlightSummary {
        at: Stamp::ZERO,
        volume: told[0].estimate,
        accounts: told,
        hits: crate::messages::HitCounts::default(),
        steps_done: 3,
        path_length_m: 20.0,
        is_complete: true,
        is_final: true,
    };
    collector.take(News::Action(Stamp::ZERO, Action::Ended(Box::new(summary))), now);
    let gap = OfferedGap {
        centre_m: [3.0, 4.0],
        area_m2: 2.5,
        share: 0.4,
        bay: Some("salt".to_owned()),
        is_in_reach: true,
    };
    let landed = Outlook { gaps: [gap].into(), ..outlook(50, Phase::Idle) };
    collector.take(News::Outlook(Box::new(landed.clone()), Box::default()), now);
    let review = collector.picture(&beside(now)).review;
    assert!(review.is_due && review.gaps[0].is_in_reach && review.gaps[0].area_m2 > 2.4);
    let checking = Outlook { is_into_gaps: true, phase: Phase::Preflight, ..landed };
    collector.take(News::Outlook(Box::new(checking), Box::default()), now);
    collector.take(change(Phase::Idle, Phase::Preflight, 60), now);
    let picture = collector.picture(&beside(now));
    // Called off now, it would still wait for a decision.
    assert!(picture.is_into_gaps && picture.review.is_due && picture.volumes.len() == 1);
    collector.take(change(Phase::Preflight, Phase::TakeOff, 70), now);
    let picture = collector.picture(&beside(now));
    assert!(!picture.review.is_due && picture.volumes.len() == 1 && picture.n_points == 1);
}

#[tokio::test]
async fn the_next_flight_begins_with_an_empty_page() {
    let mut collector = collector();
    let now = Instant::now();
    let told = vec![account("hall", 10.0, 1.0)];
    collector.take(change(Phase::Preflight, Phase::TakeOff, 10), now);
    collector.take(News::Action(Stamp::ZERO, Action::VolumesAccounted(told)), now);
    let line = StatusText { severity: Severity::Warning, text: "markers lost: holding".to_owned() };
    collector.take(News::Action(Stamp::ZERO, Action::Say(line)), now);
    collector.take(News::Outlook(Box::new(outlook(25, Phase::Survey)), Box::default()), now);
    let flying = collector.picture(&beside(now));
    assert_eq!((flying.flight_s, flying.volumes.len()), (Some(15.0), 1));
    assert_eq!(flying.lines[0].level, Level::Degraded);
    collector.take(change(Phase::Idle, Phase::Preflight, 60), now);
    let next = collector.picture(&beside(now));
    assert_eq!((next.flight_s, next.volumes.len(), next.n_points), (None, 0, 0));
    assert_eq!(next.lines.len(), 1, "what was said stays readable");
}

fn estimate(place_m: [f64; 3]) -> NavEstimate {
    NavEstimate {
        at: Stamp::ZERO,
        hall_from_body: Transform::new(
            Rotation::identity(),
            Point::new(place_m[0], place_m[1], place_m[2]),
        ),
        velocity_mps: Direction::new(0.0, 0.0, 0.0),
        gyro_radps: Vector3::zeros(),
        gyro_bias_radps: Vector3::zeros(),
        accel_bias_mps2: Vector3::zeros(),
        error_cov: SMatrix::zeros(),
        reset_counter: 0,
    }
}

fn plan(end: PlanEnd, sigma_end_m3: Option<f64>) -> News {
    let prediction = sigma_end_m3.map(|sigma_end_m3| Prediction {
        sigma_now_m3: 9.0,
        sigma_end_m3,
        length_m: 11.0,
    });
    let choice = PlanChoice { at: Stamp::ZERO, ahead: Vec::new(), end, prediction };
    News::Action(Stamp::ZERO, Action::PlanChosen(Box::new(choice)))
}

#[tokio::test]
async fn the_way_ahead_is_told_where_it_is_that_of_the_whole_survey() {
    let mut collector = collector();
    let now = Instant::now();
    let told = vec![account("hall", 200.0, 4.0)];
    collector.take(News::Action(Stamp::ZERO, Action::VolumesAccounted(told)), now);
    // 10 m in 20 s, then 5 m and 6 m to go.
    for (at_s, flown_m) in [(100, 30.0), (120, 40.0)] {
        let flying = Outlook {
            steps_done: 3,
            flown_m,
            estimate: Some(estimate([1.0, 2.0, 5.0])),
            ahead_m: vec![[4.0, 6.0, 5.0], [4.0, 12.0, 5.0]],
            ..outlook(at_s, Phase::Survey)
        };
        collector.take(News::Outlook(Box::new(flying), Box::default()), now);
    }
    let target = |collector: &Collector| collector.picture(&beside(now)).target;
    assert_eq!(target(&collector).left_s, None, "no plan is known");
    for end in [PlanEnd::Open, PlanEnd::Budget, PlanEnd::NothingFree] {
        collector.take(plan(end, Some(1.5)), now);
        let seen = target(&collector);
        assert_eq!((seen.left_s, seen.end_percent), (None, None), "{end:?}");
    }
    for end in [PlanEnd::Complete, PlanEnd::Target, PlanEnd::SmallGain] {
        collector.take(plan(end, None), now);
        // 11 m at 0.5 m/s.
        assert!((target(&collector).left_s.unwrap() - 22.0).abs() < 1e-9, "{end:?}");
        assert_eq!(target(&collector).end_percent, None);
    }
    collector.take(plan(PlanEnd::Target, Some(1.5)), now);
    // 2 · 1.5 m³ of 200 m³.
    assert!((target(&collector).end_percent.unwrap() - 1.5).abs() < 1e-9);
}
