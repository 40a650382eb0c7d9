//! Ports that are set to another speed than the sensor's.

use crate::rig::Rig;
use stockpilot::lidar::{LidarHealth, Model, Settings};

/// Settings that name the model and insist on a speed.
fn insisting(model: Model, baud: u32) -> impl FnOnce(Settings) -> Settings {
    move |settings| Settings { model: Some(model), baud: Some(baud), ..settings }
}

#[tokio::test]
async fn a_wrong_speed_is_told_within_two_seconds() {
    // Sensors that talk by themselves: what comes makes no sense.
    for (model, baud) in [(Model::Ld19, 115_200), (Model::YdlidarX2, 230_400)] {
        let mut rig = Rig::new(model, insisting(model, baud));
        let told = LidarHealth::NoFrames { baud };
        rig.until(2.0, |status| status.health == told).await;
        rig.driver.stop();
    }
    // Sensors that must be asked: they do not understand the question.
    for (model, baud) in [
        (Model::RplidarA1, 256_000),
        (Model::RplidarA3, 115_200),
        (Model::RplidarS2, 256_000),
        (Model::RplidarC1, 1_000_000),
        (Model::YdlidarG4, 115_200),
        (Model::YdlidarTg15, 230_400),
    ] {
        let mut rig = Rig::new(model, insisting(model, baud));
        let told_s = rig.until(2.0, |status| status.health == LidarHealth::Silent).await;
        println!("{:18} at {baud} bit/s: told after {told_s:.2} s", model.name());
        assert!(rig.status.borrow().stats.frames == 0 && rig.events.is_empty());
        rig.driver.stop();
    }
}

/// A sensor that still scans for a host that died sends to whatever speed the port has now.
#[tokio::test]
async fn an_rplidar_that_scans_at_another_speed_is_told_within_two_seconds() {
    for model in [Model::RplidarA3, Model::RplidarC1] {
        let baud = 115_200;
        let mut rig = Rig::new(model, insisting(model, baud));
        let now = rig.now();
        // Motor by duty, then a scan.
        rig.lidar().hear(&[0xA5, 0xF0, 0x02, 0x94, 0x02, 0xC1, 0xA5, 0x20], now);
        let told = LidarHealth::NoFrames { baud };
        let told_s = rig.until(6.0, |status| status.health == told).await;
        println!("{:18} told after {told_s:.2} s", model.name());
        assert!(rig.status.borrow().stats.frames == 0 && rig.events.is_empty());
        rig.driver.stop();
    }
}

#[tokio::test]
async fn an_rplidar_with_another_speed_than_its_model_is_told_and_found() {
    // An A2 sold with the faster interface.
    let mut rig =
        Rig::new(Model::RplidarA2m12, |s| Settings { model: Some(Model::RplidarA2), ..s });
    rig.until(2.0, |status| status.health == LidarHealth::Silent).await;
    rig.until_streaming().await;
    let status = rig.status.borrow().clone();
    assert_eq!(status.baud, 256_000);
    assert_eq!(status.identity.unwrap().model, Some(Model::RplidarA2m12));
    rig.driver.stop();
}

/// On USB (CDC-ACM) the port takes any speed and the sensor never hears of it: no speed is wrong.
#[tokio::test]
async fn a_hokuyo_on_usb_streams_at_whatever_speed_is_set() {
    for model in [Model::HokuyoUrg04lx, Model::HokuyoUtm30lx] {
        for baud in [19_200, 115_200, 1_000_000] {
            let mut rig = Rig::new(model, insisting(model, baud));
            let took_s = rig.until(2.0, |s| s.health == LidarHealth::Streaming).await;
            println!("{:18} at {baud} bit/s: streams after {took_s:.2} s", model.name());
            assert_eq!(rig.status.borrow().stats.checksum_errors, 0);
            rig.driver.stop();
        }
    }
}
