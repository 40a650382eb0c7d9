//! Lines that go on damaging what they carry, under the driver's thread: what still comes whole is
//! used, what no longer comes is told, and a line that is mended is used again.

use crate::rig::Rig;
use stockpilot::lidar::{LidarHealth, Model, Settings};
use stockpilot::pilot::Event;
use stockpilot_sim::lidar::LineFaults;

/// One of each family and each kind of checksum.
const GUARDED: [Model; 6] = [
    Model::Ld19,
    Model::RplidarA3,
    Model::RplidarS1,
    Model::YdlidarG4,
    Model::HokuyoUrg04lx,
    Model::HokuyoUtm30lx,
];
/// Virtual seconds on the damaged line.
const DAMAGED_S: f64 = 4.0;
/// Nothing may stay away for longer without being told.
const LIMIT_S: f64 = 2.0;

/// What a damaged line came to.
#[derive(Debug, Default)]
struct Outcome {
    n_beams: u64,
    /// Longest time without a beam.
    longest_gap_s: f64,
    /// Share of the time in which the status said that something is wrong.
    told_share: f64,
}

/// Goes on for a while and looks at every step: either beams come or the status says that none do.
async fn endure(rig: &mut Rig, what: &str) -> Outcome {
    let (begin, mut last_beam_at, mut outcome) = (rig.now(), rig.now(), Outcome::default());
    let (mut n_steps, mut n_told) = (0.0, 0.0);
    while rig.now().seconds_since(begin) < DAMAGED_S {
        rig.step().await;
        let (now, is_told) = (rig.now(), rig.status.borrow().health != LidarHealth::Streaming);
        while let Ok(Event::Scanned(scan)) = rig.events.try_recv() {
            outcome.n_beams += scan.beams.len() as u64;
            last_beam_at = now;
        }
        let gap_s = now.seconds_since(last_beam_at);
        outcome.longest_gap_s = outcome.longest_gap_s.max(gap_s);
        assert!(gap_s < LIMIT_S || is_told, "{what}: {gap_s} s and {:?}", rig.status.borrow());
        n_steps += 1.0;
        n_told += f64::from(u8::from(is_told));
    }
    outcome.told_share = n_told / n_steps;
    outcome
}

#[tokio::test]
async fn on_a_lasting_bad_line_beams_come_or_their_absence_is_told() {
    let faults = [
        ("1 % of bytes", 0.01, 0.0),
        ("20 % half frames", 0.0, 0.2),
        ("nothing but half frames", 0.0, 1.0),
    ];
    for model in GUARDED {
        let mut rig = Rig::new(model, |s| Settings { model: Some(model), ..s });
        rig.until_streaming().await;
        for (what, corrupt_byte_ratio, half_frame_ratio) in faults {
            let faults = LineFaults { corrupt_byte_ratio, half_frame_ratio, checks_speed: true };
            rig.lidar().damage(faults);
            let what = format!("{:16} {what}", model.name());
            let outcome = endure(&mut rig, &what).await;
            let counts = rig.status.borrow().stats;
            rig.lidar().damage(LineFaults { checks_speed: true, ..LineFaults::default() });
            let back_s = rig.until(LIMIT_S, |s| s.health == LidarHealth::Streaming).await;
            println!("{what}: {outcome:?}, back after {back_s:.2} s; {counts:?}");
            assert!(outcome.n_beams > 0 || outcome.told_share > 0.5, "{what}: {outcome:?}");
        }
        rig.driver.stop();
    }
}
