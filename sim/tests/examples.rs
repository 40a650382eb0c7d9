//! The example halls load and fly in the simulator.

#![expect(clippy::expect_used, reason = "a test may stop at the first surprise")]

use std::path::{Path, PathBuf};
use stockpilot::config::{self, Config};
use stockpilot::messages::VolumeAccount;
use stockpilot_sim::autopilot::Flavour;
use stockpilot_sim::camera::CameraModel;
use stockpilot_sim::campaign::DirectFlight;
use stockpilot_sim::scenario::{Conditions, Lidar, Planner, Scenario, Surface};
use stockpilot_sim::world::World;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples")
}

fn load(name: &str) -> Config {
    config::load(&folder().join(name).join("hall.toml"), &[]).expect("an example")
}

/// Flies an example in its world.
fn fly(config: &Config, world: World, seed: u64) -> (f64, Vec<VolumeAccount>) {
    let scenario = Scenario {
        world,
        planner: Planner::SquareWave,
        surface: Surface::MaternField,
        variance: None,
        lidar: Lidar::Ld19,
        autopilot: Flavour::Px4,
        camera: CameraModel::ahead(),
        n_steps: 50,
        seed,
        conditions: Conditions::default(),
    };
    let mut config = config.clone();
    // The result after landing is what counts here.
    config.surface.solve_interval_s = Some(60.0);
    let mut flight = DirectFlight::with_config(&scenario, &config).expect("a flight");
    while flight.summary().is_none() && flight.rig.now().seconds() < 400.0 {
        flight.step(&mut |_, _| {});
    }
    let summary = flight.summary().expect("an end");
    assert!(summary.is_complete, "cut short: {:?}", flight.texts());
    (scenario.world.volume_m3(), summary.accounts.clone())
}

/// The truth lies within four σ: one flight must not fail by chance.
fn assert_honest(true_m3: f64, account: &VolumeAccount) {
    let estimate = &account.estimate;
    let off_sigmas = (estimate.volume_m3 - true_m3).abs() / estimate.sigma_m3;
    assert!(off_sigmas < 4.0, "{estimate:?}, truth {true_m3}");
    assert!(estimate.volume_m3 > 100.0);
}

#[test]
fn every_example_is_tested() {
    let entries = std::fs::read_dir(folder()).expect("the examples");
    let mut names: Vec<String> = entries
        .map(|entry| entry.expect("an example"))
        .filter(|entry| entry.path().is_dir())
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(names, ["fertiliser-hall", "paper", "salt-shed"]);
}

#[test]
fn the_salt_shed_flies() {
    let (true_m3, accounts) = fly(&load("salt-shed"), World::alps(1).expect("a world"), 1);
    let salt = accounts.iter().find(|account| account.name == "salt").expect("the bay");
    assert_honest(true_m3, salt);
    assert!(salt.mass.is_some());
}

#[test]
fn the_fertiliser_hall_flies() {
    let (true_m3, accounts) = fly(&load("fertiliser-hall"), World::piles(3).expect("a world"), 3);
    assert_honest(true_m3, &accounts[0]);
    let names: Vec<&str> = accounts.iter().map(|account| account.name.as_str()).collect();
    assert_eq!(names, ["hall", "urea", "DAP", "potash", "NPK"]);
    assert!(accounts[0].mass.is_none(), "four densities make no common one");
    assert!(accounts[1..].iter().all(|account| account.mass.is_some()));
}

/// The paper's σ is not honest, its volume is near all the same: the paper's own error is 2.5 %.
#[test]
fn the_papers_set_up_flies() {
    let (true_m3, accounts) = fly(&load("paper"), World::alps(1).expect("a world"), 1);
    let volume_m3 = accounts[0].estimate.volume_m3;
    assert!((volume_m3 - true_m3).abs() < 0.05 * true_m3, "{volume_m3}, truth {true_m3}");
}
