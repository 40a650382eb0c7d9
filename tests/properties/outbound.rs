//! Nothing that leaves holds a NaN or an infinity, whatever comes in from wire, sensors and brain.

use crate::brain::Source;
use crate::support::settings;
use crate::wire_scene::{WireScene, frame};
use mavlink::Message as _;
use mavlink::dialects::ardupilotmega::MavMessage;
use std::time::Duration;
use stockpilot::geometry::{Direction, Point};
use stockpilot::pilot::{Action, Event};
use stockpilot::stats::{Noise, SeedBook};

/// Floats whose bits are NaN, infinite, huge, tiny or anything.
fn payload(noise: &mut Noise) -> Vec<u8> {
    let mut bytes = Vec::new();
    while bytes.len() < 255 {
        let word = match noise.bits() % 8 {
            0 => f32::NAN.to_bits(),
            1 => f32::INFINITY.to_bits(),
            2 => f32::NEG_INFINITY.to_bits(),
            3 => f32::MAX.to_bits(),
            4 => 0,
            5 => 1.0_f32.to_bits(),
            _ => u32::try_from(noise.bits() >> 32).unwrap_or(0),
        };
        bytes.extend_from_slice(&word.to_le_bytes());
    }
    bytes
}

/// The same action with a number that cannot be sent.
fn poisoned(action: &Action, noise: &mut Noise) -> Option<Action> {
    let broken = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300]
        [usize::try_from(noise.bits() % 5).expect("small")];
    let axis = usize::try_from(noise.bits() % 3).expect("small");
    match action {
        Action::Steer(setpoint) => {
            let mut setpoint = *setpoint;
            match noise.bits() % 5 {
                0 => setpoint.yaw_rad = broken,
                1 => setpoint.yaw_rate_radps = broken,
                2 => setpoint.velocity_mps.coords[axis] = broken,
                3 => {
                    setpoint.accel_mps2 = Direction::from_coords(nalgebra::Vector3::repeat(broken))
                }
                _ => setpoint.position = Point::new(broken, 0.0, 0.0),
            }
            Some(Action::Steer(setpoint))
        }
        Action::PublishOdometry(estimate) => {
            let mut estimate = estimate.clone();
            match noise.bits() % 4 {
                0 => estimate.error_cov[(axis, axis + 3)] = broken,
                1 => estimate.error_cov[(axis + 3, axis + 3)] = broken,
                2 => estimate.velocity_mps.coords[axis] = broken,
                _ => estimate.gyro_radps[axis] = broken,
            }
            Some(Action::PublishOdometry(estimate))
        }
        Action::ReportVolume(report) => {
            let mut report = *report;
            match axis {
                0 => report.estimate.volume_m3 = broken,
                1 => report.estimate.sigma_m3 = broken,
                _ => report.position_sigma_m = Some(broken),
            }
            Some(Action::ReportVolume(report))
        }
        _ => None,
    }
}

/// All messages of the dialect.
fn ids() -> Vec<u32> {
    (0..70_000).filter(|id| MavMessage::default_message_from_id(*id).is_some()).collect()
}

fn hear_something(scene: &mut WireScene, ids: &[u32], noise: &mut Noise) {
    let pick = |noise: &mut Noise, n: usize| usize::try_from(noise.bits() % n as u64).unwrap_or(0);
    let id = ids[pick(noise, ids.len())];
    let from = [(1, 1), (255, 190), (1, 191), (0, 0), (7, 1), (1, 51)][pick(noise, 6)];
    // The autopilot's own heartbeat would end the flight at once.
    if id != 0 || from != (1, 1) {
        let payload = payload(noise);
        scene.hear(&frame(from, id, &payload));
    }
}

#[test]
fn no_message_that_leaves_holds_what_is_not_a_number() {
    let ids = ids();
    assert!(ids.len() > 200, "{} messages", ids.len());
    let mut sent = std::collections::BTreeMap::new();
    let (mut n_poisoned, mut n_refused) = (0_u32, 0);
    for seed in 0..3 {
        println!("seed {seed}");
        let mut noise = SeedBook::new(seed).stream("outbound");
        let mut source = Source::new(seed, [0.0, 0.02, 0.3][usize::try_from(seed).expect("small")]);
        let mut scene = WireScene::new(settings());
        for step in 0..4_000 {
            let mut wanted = Vec::new();
            for event in source.events() {
                scene.now = source.now().max(scene.now);
                match event {
                    Event::Ticked(_) => wanted.extend(scene.tick(Duration::ZERO)),
                    event => wanted.extend(scene.tell(event)),
                }
            }
            if step % 100 == 0 {
                scene.hear(&frame((1, 1), 0, &source.heartbeat()));
            }
            if step % 5 == 0 && seed > 0 {
                hear_something(&mut scene, &ids, &mut noise);
            }
            for action in wanted {
                if let Some(broken) = poisoned(&action, &mut noise) {
                    scene.act(&broken);
                    n_poisoned += 1;
                }
                source.obey(&action);
            }
        }
        for (name, n) in scene.sent {
            *sent.entry(name).or_insert(0) += n;
        }
        n_refused += scene.n_refused;
    }
    println!("{sent:?}, {n_poisoned} poisoned, {n_refused} refused");
    // The premise: everything that carries a measured number did leave, and was poisoned too.
    for name in ["ODOMETRY", "SET_POSITION_TARGET_LOCAL_NED", "NAMED_VALUE_FLOAT", "STATUSTEXT"] {
        assert!(sent.get(name).is_some_and(|n| *n > 20), "{name}: {sent:?}");
    }
    assert!(n_poisoned > 500 && n_refused > 500, "{n_poisoned}, {n_refused}");
}
