use super::*;
use crate::survey::Sample;

/// A flight with these samples: path, volume, σ.
fn run(planner: Planner, samples: &[(f64, f64, f64)], plan_ms: &[f64]) -> ComparedRun {
    let samples = samples
        .iter()
        .map(|&(path_m, volume_m3, sigma_m3)| Sample {
            at_s: 2.0 * path_m,
            path_m,
            energy_wh: 0.1 * path_m,
            n_samples: 0,
            steps: 1,
            volume_m3,
            sigma_m3,
        })
        .collect();
    let survey = Survey {
        report: None,
        samples,
        maps: Vec::new(),
        track_m: Vec::new(),
        plan_ms: plan_ms.to_vec(),
        has_collided: planner == Planner::Greedy,
        has_left_free_space: false,
        least_clearance_m: f64::INFINITY,
        final_charge_ratio: 0.5,
    };
    ComparedRun::new(("alps", 0, planner), 100.0, 0.01, survey)
}

#[test]
fn the_first_sample_within_the_target_counts_even_if_later_ones_are_not() {
    let run = run(
        Planner::SquareWave,
        &[(10.0, 100.0, 5.0), (20.0, 98.0, 0.97), (30.0, 60.0, 0.9), (40.0, 101.0, 1.0)],
        &[],
    );
    assert_eq!(run.path_to_target_m, Some(20.0));
    assert_eq!(run.time_to_target_s, Some(40.0));
    assert!((run.energy_to_target_wh.unwrap() - 2.0).abs() < 1e-12);
    // The last: 101 of 100 m³, σ 1.
    assert!((run.relative_error.unwrap() - 0.01).abs() < 1e-12);
    assert!((run.z.unwrap() - 1.0).abs() < 1e-12);
    assert!((run.final_sigma_over_volume.unwrap() - 1.0 / 101.0).abs() < 1e-12);
}

#[test]
fn nothing_and_negative_volumes_are_no_success() {
    let run = run(Planner::SquareWave, &[(10.0, -100.0, 0.1), (20.0, 0.0, 0.0)], &[]);
    assert_eq!(run.path_to_target_m, None);
    let none = self::run(Planner::SquareWave, &[], &[]);
    assert_eq!((none.path_to_target_m, none.relative_error, none.z), (None, None, None));
}

#[test]
fn an_unreached_target_is_infinite_in_the_median() {
    let inf = f64::INFINITY;
    assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
    assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), Some(2.5));
    assert_eq!(median(vec![inf, 1.0, 2.0]), Some(2.0));
    assert_eq!(median(vec![inf, 1.0, inf]), None);
    // One of the two in the middle is infinite: so is their mean.
    assert_eq!(median(vec![1.0, inf, inf, 2.0]), None);
    assert_eq!(median(Vec::new()), None);
}

#[test]
fn the_summary_is_that_of_a_calculation_by_hand() {
    let good = |path_m| vec![(path_m, 100.0, 3.0), (path_m + 5.0, 102.0, 1.0)];
    let runs = vec![
        run(Planner::SquareWave, &good(10.0), &[]),
        run(Planner::Greedy, &good(20.0), &[1.0, 9.0]),
        run(Planner::SquareWave, &good(14.0), &[]),
        run(Planner::Greedy, &[(50.0, 96.0, 3.0)], &[2.0]),
        run(Planner::SquareWave, &[], &[]),
        run(Planner::Greedy, &[(50.0, 100.0, 2.0)], &[]),
    ];
    let comparison = Comparison::new(0.01, "matern-field", 1.0, runs);
    let square = &comparison.planners["square-wave"];
    assert_eq!((square.n_runs, square.n_reached, square.collisions), (3, 2, 0));
    assert_eq!(square.median_path_to_target_m, Some(19.0));
    assert!((square.rms_relative_error.unwrap() - 0.02).abs() < 1e-12);
    assert!(square.plan_ms_median.abs() < 1e-12);
    let greedy = &comparison.planners["greedy"];
    assert_eq!((greedy.n_runs, greedy.n_reached, greedy.collisions), (3, 1, 3));
    assert_eq!(greedy.median_path_to_target_m, None, "two of three never get there");
    // Errors 2, −4 and 0 %, z = 2, −4/3 and 0: two of three inside 1.96.
    assert!((greedy.rms_relative_error.unwrap() - (20e-4_f64 / 3.0).sqrt()).abs() < 1e-12);
    assert!((greedy.coverage_95.unwrap() - 2.0 / 3.0).abs() < 1e-12);
    assert!((greedy.plan_ms_median - 2.0).abs() < 1e-12);
    let text = table::text(&comparison);
    assert!(text.lines().any(|line| line.starts_with("greedy") && line.contains('∞')), "{text}");
}

#[test]
fn json_has_the_promised_keys_and_null_for_infinity() {
    let runs = vec![run(Planner::Greedy, &[(50.0, 96.0, 3.0)], &[2.0])];
    let comparison = Comparison::new(0.01, "matern-field", 1.0, runs);
    let json: serde_json::Value =
        serde_json::from_str(&serde_json::to_string(&comparison).unwrap()).unwrap();
    let greedy = &json["planners"]["greedy"];
    for key in [
        "final_sigma_over_volume",
        "rms_relative_error",
        "coverage_95",
        "collisions",
        "left_free_space",
        "plan_ms_median",
    ] {
        assert!(greedy[key].is_number(), "{key} in {greedy}");
    }
    assert!(greedy.as_object().unwrap().contains_key("median_path_to_target_m"));
    assert!(greedy["median_path_to_target_m"].is_null());
    assert_eq!(json["runs"][0]["path_to_target_m"], serde_json::Value::Null);
}
