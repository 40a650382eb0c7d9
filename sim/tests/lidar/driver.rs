//! The driver's thread over pseudo-terminals: unplugged, with a held head, unknown.

use crate::rig::Rig;
use crate::support::exact;
use stockpilot::lidar::{LidarHealth, Model, Settings};
use stockpilot_sim::lidar::{Firmware, LidarModel, Mishap};

const ONE_OF_EACH: [Model; 4] =
    [Model::Ld19, Model::RplidarA3, Model::YdlidarG4, Model::HokuyoUrg04lx];

#[tokio::test]
async fn a_held_head_is_told_within_two_seconds_and_forgotten_when_it_turns() {
    for model in ONE_OF_EACH {
        let mut rig = Rig::new(model, |s| Settings { model: Some(model), ..s });
        rig.until_streaming().await;
        for _ in 0..60 {
            rig.step().await;
        }
        let now = rig.now();
        rig.lidar().suffer(Mishap::HeadHeld(true), now);
        let told_s = rig.until(2.0, |s| s.health != LidarHealth::Streaming).await;
        println!("{:18} told after {told_s:.2} s", model.name());
        let now = rig.now();
        rig.lidar().suffer(Mishap::HeadHeld(false), now);
        rig.until_streaming().await;
        rig.driver.stop();
    }
}

#[tokio::test]
async fn an_unplugged_sensor_is_told_at_once_and_streams_again_after_it_is_plugged_in() {
    for model in ONE_OF_EACH {
        let mut rig = Rig::new(model, |s| Settings { model: Some(model), ..s });
        rig.until_streaming().await;
        rig.unplug();
        rig.wait_for(|s| matches!(s.health, LidarHealth::Disconnected { .. })).await;
        rig.plug_in();
        let n_events = rig.events.len();
        rig.wait_for(|s| s.stats.reconnects == 1).await;
        rig.until_streaming().await;
        for _ in 0..12 {
            rig.step().await;
        }
        assert!(rig.events.len() > n_events);
        rig.driver.stop();
    }
}

#[tokio::test]
async fn an_unknown_sensor_is_found_and_streams() {
    for model in [Model::RplidarS1, Model::YdlidarX4, Model::HokuyoScip2] {
        let mut rig = Rig::new(model, |s| s);
        rig.until_streaming().await;
        assert_eq!(rig.status.borrow().identity.as_ref().unwrap().model, Some(model));
        rig.driver.stop();
    }
}

#[tokio::test]
async fn a_sensor_that_cannot_be_chosen_is_told_by_name_and_streams_once_it_is_configured() {
    let g1 = LidarModel { firmware: Firmware::Ydlidar(19), ..exact(Model::YdlidarG4) };
    let mut rig = Rig::with(g1.clone(), |s| s);
    let told = LidarHealth::Unknown { name: "YDLIDAR model 19".into(), baud: 230_400 };
    rig.until(12.0, |s| s.health == told).await;
    // It stays told while the search goes on.
    for _ in 0..400 {
        rig.step().await;
        assert_eq!(rig.status.borrow().health, told);
    }
    rig.driver.stop();
    let mut rig = Rig::with(g1, |s| Settings { model: Some(Model::YdlidarG4), ..s });
    rig.until_streaming().await;
    assert_eq!(rig.status.borrow().identity.as_ref().unwrap().name, "YDLIDAR model 19");
    rig.driver.stop();
}
