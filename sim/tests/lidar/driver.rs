//! The driver's thread over pseudo-terminals: unplugged, with a held head, unknown.

use crate::rig::Rig;
use stockpilot::lidar::{LidarHealth, Model, Settings};
use stockpilot_sim::lidar::Mishap;

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
    for model in [Model::RplidarS1, Model::YdlidarX4] {
        let mut rig = Rig::new(model, |s| s);
        rig.until_streaming().await;
        assert_eq!(rig.status.borrow().identity.as_ref().unwrap().model, Some(model));
        rig.driver.stop();
    }
}
