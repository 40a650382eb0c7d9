use super::scene::Scene;
use super::*;
use crate::geometry::{Point, Rotation, Transform};
use crate::mapping::belief::CoarseField;
use crate::mapping::polygon::Polygon;
use crate::mapping::projection::LidarMount;
use crate::mapping::region::Rect;
use crate::mapping::solid::{Prism, Solid};
use crate::mapping::{self, Mapper, Method, settings_over};
use crate::messages::VolumeEstimate;
use crate::planning::free_space::tests::{marker_map, settings as hall_settings, space_of};
use crate::planning::planner::Belief;
use crate::planning::{PlannerKind, Settings};
use crate::stats::SeedBook;
use crate::time::Stamp;
use std::sync::Arc;

fn lidar() -> LidarMount {
    LidarMount {
        body_from_lidar: Transform::new(
            Rotation::from_euler_rad(0.0, std::f64::consts::FRAC_PI_2, 0.0),
            Point::origin(),
        ),
        range_sigma_m: 0.012,
        angle_sigma_rad: 0.002,
        min_range_m: 0.15,
        max_range_m: 12.0,
        blind_sectors_rad: Vec::new(),
    }
}

/// A map of 16 m × 12 m without a beam.
fn mapper(method: Method) -> Mapper {
    mapper_of(method, Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 16.0, y_max_m: 12.0 })
}

/// A map without a beam.
fn mapper_of(method: Method, bounds: Rect) -> Mapper {
    Mapper::new(mapping::Settings {
        cell_m: 0.5,
        max_height_m: 2.0,
        lidar: lidar(),
        ..settings_over(method, bounds)
    })
}

fn settings() -> Settings {
    Settings {
        planner: PlannerKind::Horizon,
        target_ratio: Some(0.02),
        n_steps: 40,
        yaw_rad: 0.0,
        // Nothing here asks how good the paths are: a short search, for builds that are not optimised.
        search_effort: 0.2,
        ..hall_settings()
    }
}

/// A plan from a corner of the hall, with nothing seen.
fn request(settings: Settings, obstacles: Vec<Solid>) -> PlanRequest {
    let mut settings = settings;
    settings.space.obstacles = obstacles;
    let mapper = mapper(Method::MaternField);
    let start = Waypoint { place: Point::new(2.0, 1.5, settings.height_m), yaw_rad: 0.0 };
    PlanRequest {
        n_waypoints: settings.n_steps,
        longest_m: None,
        over_home: Some(start.place),
        free_space: Arc::new(space_of(&settings, &marker_map(|_| true))),
        lidar: lidar(),
        belief: Belief::Field {
            field: Arc::new(mapper.coarse_field().expect("a prior")),
            surface: Box::new(mapper.snapshot(Stamp::ZERO, false)),
        },
        volume_m3: 192.0,
        constant_var_m6: 0.0,
        accounted: None,
        current: Vec::new(),
        pending: vec![start],
        settings,
    }
}

/// Every place of a plan, the straight ways between included, is free and the ways hold together.
fn assert_free(request: &PlanRequest, plan: &Plan) {
    let mut from = request.pending[0];
    for to in &plan.waypoints {
        assert!(request.free_space.is_free(to), "{to:?} is not free");
        assert!(request.free_space.is_way_free(&from, to), "{from:?} to {to:?} is not free");
        from = *to;
    }
}

#[test]
fn the_plan_reaches_the_target_and_is_the_same_again() {
    let request = request(settings(), Vec::new());
    let plan = request.run();
    let prediction = plan.prediction.expect("a prediction");
    assert_eq!(plan.end, PlanEnd::Target);
    assert!(prediction.sigma_end_m3 <= 0.02 * 192.0, "{prediction:?}");
    assert!(prediction.sigma_now_m3 > 50.0 * prediction.sigma_end_m3);
    assert_free(&request, &plan);
    assert_eq!(plan, request.run(), "the same request gives the same plan");
    // Steps of the greedy planner's length at most: a step is a waypoint.
    let longest_m = std::iter::zip(&request.pending, &plan.waypoints)
        .chain(std::iter::zip(&plan.waypoints, &plan.waypoints[1..]))
        .map(|(a, b)| a.distance_m(b))
        .fold(0.0, f64::max);
    assert!(longest_m <= 2.0 + 1e-9, "{longest_m} m");
}

#[test]
fn plans_one_after_another_reach_a_target_that_is_far() {
    // Half of what the plan above reaches: the first plans need not lead to it.
    let mut request = request(Settings { target_ratio: Some(0.01), ..settings() }, Vec::new());
    let mut way_m = 0.0;
    loop {
        let plan = request.run();
        let end_m3 = plan.prediction.expect("a prediction").sigma_end_m3;
        let [next, rest @ ..] = &plan.waypoints[..] else { panic!("{plan:?} after {way_m} m") };
        way_m += request.pending.last().expect("a start").distance_m(next);
        assert!(way_m < 100.0, "{end_m3} m³ after {way_m} m");
        if rest.is_empty() && end_m3 <= 0.01 * 192.0 {
            break;
        }
        request.pending.push(*next);
        request.current = rest.to_vec();
    }
}

#[test]
fn what_is_predicted_is_what_the_steps_that_are_left_reach() {
    for n_waypoints in [1, 4, 9] {
        let mut request = request(settings(), Vec::new());
        request.n_waypoints = n_waypoints;
        let plan = request.run();
        assert!((1..=n_waypoints).contains(&plan.waypoints.len()), "{}", plan.waypoints.len());
        let start = request.pending.last().unwrap();
        let before = std::iter::once(start).chain(&plan.waypoints);
        let flown_m: f64 =
            std::iter::zip(before, &plan.waypoints).map(|(from, to)| from.distance_m(to)).sum();
        let predicted_m = plan.prediction.unwrap().length_m;
        assert!((flown_m - predicted_m).abs() < 1e-9, "{flown_m} m of {predicted_m} m");
    }
}

#[test]
fn the_best_wave_is_the_same_however_few_steps_share_it() {
    let mut request = request(settings(), Vec::new());
    let many = best_square_wave(&request).expect("a wave");
    request.n_waypoints = 4;
    let few = best_square_wave(&request).expect("a wave");
    assert!(many.1.length_m > 4.0 * request.settings.step_radius_m, "{:?}", many.1);
    assert_eq!(many, few);
}

#[test]
fn the_search_is_never_worse_than_its_best_seed() {
    let request = request(settings(), Vec::new());
    let mut scene = Scene::new(&request).expect("a scene");
    let seeds = seeds::best_of_all(&mut scene);
    let best_seed = seeds.iter().map(|path| path.score).fold(f64::INFINITY, f64::min);
    for n_paths in [0, 10, 120] {
        let found = search::improve(&mut scene, seeds.clone(), n_paths).expect("a path");
        assert!(found.score <= best_seed, "{} after {n_paths} of {best_seed}", found.score);
    }
    let wave = seeds::best_square_wave(&mut scene).expect("a wave");
    let found = search::improve(&mut scene, seeds, 200).expect("a path");
    assert!(found.score < wave.score, "{} against the wave's {}", found.score, wave.score);
}

#[test]
fn more_effort_looks_at_more_paths_and_finds_better_ones() {
    // Changes are random: a single search may be lucky.
    let found = |search_effort| {
        let of_seed = |seed| {
            let settings = Settings { search_effort, seed, ..settings() };
            let request = request(settings, Vec::new());
            let mut scene = Scene::new(&request).expect("a scene");
            let best = scene.best(1.0).expect("a path");
            (scene.n_looked_at, best.score)
        };
        let of_seeds = (0..4).map(of_seed);
        of_seeds.fold((0, 0.0), |sum, found| (sum.0 + found.0, sum.1 + found.1))
    };
    let (little, much) = (found(0.05), found(0.4));
    assert!(much.0 > little.0 + 400 && much.1 < little.1, "{little:?}, {much:?}");
}

#[test]
fn legs_taken_from_another_path_score_as_fresh_ones() {
    let request = request(settings(), Vec::new());
    let mut scene = Scene::new(&request).expect("a scene");
    let at = |x, y, yaw_rad| Waypoint { place: Point::new(x, y, 5.0), yaw_rad };
    let old = scene.path(vec![at(8.0, 3.0, 0.4), at(12.0, 9.0, 1.2), at(4.0, 9.0, 2.0)], None);
    let old = old.expect("free");
    let changed = vec![at(8.0, 3.0, 0.4), at(11.0, 7.0, 0.7), at(12.0, 9.0, 1.2)];
    let cached = scene.path(changed.clone(), Some(&old)).expect("free");
    let fresh = scene.path(changed, None).expect("free");
    assert_eq!(cached.sigma_m3.to_bits(), fresh.sigma_m3.to_bits());
    assert!(cached.sigma_m3 < 0.5 * scene.sigma_now_m3());
    assert!(
        Arc::ptr_eq(&cached.legs[0], &old.legs[0]) && !Arc::ptr_eq(&fresh.legs[0], &old.legs[0])
    );
}

#[test]
fn plans_stay_in_the_free_space_among_random_columns_and_poor_fixes() {
    let mut noise = SeedBook::new(31).stream("columns");
    let mut n_with_plan = 0;
    for case in 0..6 {
        let columns = (0..3)
            .map(|_| {
                let (x, y) = (noise.between(4.0, 13.0), noise.between(3.5, 10.0));
                let side_m = noise.between(0.3, 1.2);
                let outline =
                    Rect { x_min_m: x, y_min_m: y, x_max_m: x + side_m, y_max_m: y + side_m };
                Prism::new(Polygon::from(outline), (0.0, 7.0)).into()
            })
            .collect();
        // The higher the quality that is asked for, the less of the hall is free.
        let min_fix_quality = noise.between(10.0, 40.0);
        let request = request(Settings { min_fix_quality, seed: case, ..settings() }, columns);
        let plan = request.run();
        assert_free(&request, &plan);
        n_with_plan += u32::from(!plan.waypoints.is_empty());
    }
    assert!(n_with_plan >= 3, "only {n_with_plan} plans to look at");
}

#[test]
fn nothing_is_planned_once_the_volume_is_sure_enough_or_the_battery_low() {
    let done = PlanRequest { volume_m3: 1e6, ..request(settings(), Vec::new()) };
    let plan = done.run();
    assert_eq!((plan.waypoints.len(), plan.end), (0, PlanEnd::Target));
    let mut low = request(settings(), Vec::new());
    low.longest_m = Some(14.0);
    let plan = low.run();
    let way_m: f64 = low.pending[0].distance_m(&plan.waypoints[0])
        + plan.waypoints.windows(2).map(|pair| pair[0].distance_m(&pair[1])).sum::<f64>();
    let last = plan.waypoints.last().expect("a plan");
    let home_m = last.distance_m(&low.pending[0]);
    assert!(way_m + home_m <= 14.0 + 1e-9, "{way_m} m and {home_m} m home");
    low.longest_m = Some(0.3);
    assert_eq!(low.run(), Plan::nothing(PlanEnd::Budget));
}

#[test]
fn without_a_target_more_flying_ends_where_it_hardly_pays() {
    let mut request = request(Settings { target_ratio: None, ..settings() }, Vec::new());
    let plan = request.run();
    let prediction = plan.prediction.expect("a prediction");
    assert!(plan.waypoints.len() <= 40 && prediction.sigma_end_m3 < 4.0, "{prediction:?}");
    // An account that no flight can better.
    request.constant_var_m6 = 1e8;
    assert_eq!(request.run().end, PlanEnd::SmallGain);
}

#[test]
fn where_the_steps_that_are_left_bring_nothing_the_beginning_of_a_longer_path_is_flown() {
    // All that counts is at the far end of the hall, and the LiDAR does not reach there from the two steps that are left.
    let bounds = Rect { x_min_m: 12.0, y_min_m: 0.0, x_max_m: 16.0, y_max_m: 12.0 };
    let far = mapper_of(Method::MaternField, bounds);
    let mut request = request(Settings { target_ratio: None, ..settings() }, Vec::new());
    request.lidar.max_range_m = 6.0;
    request.belief = Belief::Field {
        field: Arc::new(far.coarse_field().expect("a prior")),
        surface: Box::new(far.snapshot(Stamp::ZERO, false)),
    };
    request.n_waypoints = 2;
    let plan = request.run();
    assert_free(&request, &plan);
    assert_eq!((plan.waypoints.len(), plan.end), (2, PlanEnd::Budget));
    // Nothing is promised of what is left out.
    let prediction = plan.prediction.expect("a prediction");
    // Had these two steps been worth it, it would be below 0.973.
    assert!(prediction.sigma_end_m3 > 0.98 * prediction.sigma_now_m3, "{prediction:?}");
    assert!((3.0..4.0 + 1e-9).contains(&prediction.length_m), "{prediction:?}");
    assert!(plan.waypoints[1].place.coords.x > request.pending[0].place.coords.x + 2.0, "{plan:?}");
    // And where no path of any length brings something, the survey is over.
    request.constant_var_m6 = 1e8;
    assert_eq!(request.run().end, PlanEnd::SmallGain);
}

#[test]
fn predictions_are_held_against_the_account() {
    let mut request = request(settings(), Vec::new());
    let usual = Scene::new(&request).expect("a scene").sigma_now_m3();
    let estimate = VolumeEstimate {
        at: Stamp::ZERO,
        volume_m3: 192.0,
        sigma_m3: usual * 0.9,
        coverage_ratio: 0.0,
    };
    request.accounted = Some(estimate);
    let held = Scene::new(&request).expect("a scene").sigma_now_m3();
    assert!((held / usual - 0.9).abs() < 1e-9, "{held} against {usual}");
}

#[test]
fn the_papers_cells_give_a_belief_as_well() {
    let grid = mapper(Method::KalmanGrid);
    let field = Arc::new(grid.coarse_field().expect("a prior"));
    let surface = Box::new(grid.snapshot(Stamp::ZERO, false));
    let belief = Belief::Field { field: Arc::<CoarseField>::clone(&field), surface };
    let request = PlanRequest { belief, ..request(settings(), Vec::new()) };
    let plan = request.run();
    assert_free(&request, &plan);
    assert_eq!(plan.end, PlanEnd::Target);
}
