use super::frame::crc8;
use super::*;
use crate::world::{Cuboid, HeightField, Region, World};
use nalgebra::Vector3;
use rustix::io::read;
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::os::fd::OwnedFd;
use std::time::Duration;
use stockpilot::geometry::{Body, Hall, Lidar, Point, Rotation, Transform};
use stockpilot::messages::Scan;
use stockpilot::stats::SeedBook;
use stockpilot::time::Stamp;

fn still() -> Transform<Hall, Body> {
    Transform::new(Rotation::from_euler_rad(0.05, -0.04, 0.3), Point::new(9.0, 11.0, 6.5))
}

fn packets(model: LidarModel, seconds: u64) -> Vec<Packet> {
    let world = World::alps(0).unwrap();
    let mut lidar = LidarSimulator::new(model, SeedBook::new(3), Stamp::ZERO);
    lidar.advance(&world, Stamp::ZERO.plus(Duration::from_secs(seconds)), |_| still())
}

fn turns(packets: &[Packet]) -> Vec<Scan> {
    let mut assembler = TurnAssembler::default();
    packets.iter().filter_map(|packet| assembler.push(packet)).collect()
}

#[test]
fn check_byte_is_that_of_the_makers_manual() {
    let manual = "54 2C 68 08 AB 7E E0 00 E4 DC 00 E2 D9 00 E5 D5 00 E3 D3 00 E4 D0 00 E9 CD 00 \
                  E4 CA 00 E2 C7 00 E9 C5 00 E5 C2 00 E5 C0 00 E5 BE 82 3A 1A";
    let bytes: Vec<u8> =
        manual.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect();
    assert_eq!(bytes.len(), FRAME_LEN - 1);
    assert_eq!(crc8(&bytes), 0x50);
}

#[test]
fn rates_are_those_of_the_sensor() {
    for (model, per_turn) in [(LidarModel::ld19(), 450), (LidarModel::stl27l(), 2160)] {
        let per_s = usize::try_from(model.samples_per_s).unwrap();
        let packets = packets(model, 2);
        assert!((packets.len() * SAMPLES_PER_PACKET).abs_diff(2 * per_s) < 2 * SAMPLES_PER_PACKET);
        let turns = turns(&packets);
        assert!((18..=20).contains(&turns.len()), "{}", turns.len());
        for turn in &turns[1..] {
            // The speed of the head wanders by 0.2 %; allow for 5 σ.
            assert!(turn.beams.len().abs_diff(per_turn) <= per_turn / 100 + 1);
            let pairs = turn.beams.windows(2);
            assert!(pairs.into_iter().all(|pair| pair[0].offset_ns < pair[1].offset_ns));
        }
    }
}

#[test]
fn hits_lie_on_the_true_surface() {
    let world = World::alps(0).unwrap();
    let body_from_lidar = LidarModel::ld19().body_from_lidar;
    let mut n_on_terrain = 0;
    for turn in turns(&packets(LidarModel::ld19(), 1)) {
        for beam in turn.beams.iter().filter(|beam| beam.range_m > 0.0) {
            let (sin, cos) = f64::from(beam.angle_rad).sin_cos();
            let range_m = f64::from(beam.range_m);
            let in_lidar = Point::<Lidar>::new(range_m * cos, range_m * sin, 0.0);
            let hit = still() * (body_from_lidar * in_lidar);
            let [x, y, z] = hit.coords.into();
            if world.region.grown(-0.2).contains(x, y) && z < 5.0 {
                n_on_terrain += 1;
                let gap_m = world.clearance_m(&hit, 1.0);
                // 5 σ of range and half the diagonal of a cell.
                assert!(gap_m < 0.05 + 0.06, "{hit:?} is {gap_m} m off");
            }
        }
    }
    assert!(n_on_terrain > 1000, "{n_on_terrain}");
}

#[test]
fn default_mount_looks_down_at_zero_and_left_a_quarter_turn_counter_clockwise() {
    let mount = LidarModel::ld19().body_from_lidar;
    let points_to =
        |x: f64, y: f64| (mount * Point::<Lidar>::new(x, y, 0.0)).coords - mount.origin.coords;
    assert!((points_to(1.0, 0.0) + Vector3::z()).norm() < 1e-12);
    assert!((points_to(0.0, 1.0) - Vector3::y()).norm() < 1e-12);
}

/// A sensor without noise.
fn exact() -> LidarModel {
    LidarModel {
        range_sigma_m: 0.0,
        angle_sigma_rad: 0.0,
        dropout_ratio: 0.0,
        ..LidarModel::ld19()
    }
}

#[test]
fn beams_point_beside_their_angles_by_the_stated_deviation() {
    let region = Region::new(0.0, 0.0, 20.0, 20.0);
    let floor = HeightField::from_fn(&region, 0.5, |_, _| 0.0).unwrap();
    let world = World::assemble("floor", floor, Vec::new(), SeedBook::new(0));
    let level = |_: Stamp<_>| Transform::new(Rotation::identity(), Point::new(10.0, 10.0, 6.0));
    let angle_sigma_rad = LidarModel::ld19().angle_sigma_rad;
    let model = LidarModel { angle_sigma_rad, ..exact() };
    let height_m = 6.0 + model.body_from_lidar.origin.coords.z;
    let mut lidar = LidarSimulator::new(model, SeedBook::new(3), Stamp::ZERO);
    let packets = lidar.advance(&world, after_ms(4000), level);
    let samples = packets.iter().flat_map(|packet| packet.samples);
    // Where the beam that was half a quarter turn from straight down met the floor: cos α = h/d.
    let off_rad: Vec<f64> = samples
        .filter(|s| s.range_mm > 0)
        .map(|s| ((s.clockwise_cdeg + 18_000.0) % 36_000.0 - 18_000.0, f64::from(s.range_mm)))
        .filter(|(cdeg, _)| (3000.0..5500.0).contains(&cdeg.abs()))
        .map(|(cdeg, mm)| (1000.0 * height_m / mm).acos() - (cdeg.abs() / 100.0).to_radians())
        .collect();
    let n = off_rad.len() as f64;
    assert!(n > 2000.0, "{n}");
    let sigma_rad = (off_rad.iter().map(|off| off * off).sum::<f64>() / n).sqrt();
    // Five standard errors of a deviation from 2000; ranges are rounded to 0.05 mrad at most.
    assert!((sigma_rad / angle_sigma_rad - 1.0).abs() < 0.08, "{sigma_rad}");
}

#[test]
fn range_noise_has_the_stated_deviation() {
    let world = World::alps(0).unwrap();
    let quiet = LidarModel { range_sigma_m: 0.0, ..LidarModel::ld19() };
    let until = Stamp::ZERO.plus(Duration::from_secs(2));
    let run = |model| {
        let mut lidar = LidarSimulator::new(model, SeedBook::new(3), Stamp::ZERO);
        lidar.advance(&world, until, |_| still())
    };
    let (noisy, quiet) = (run(LidarModel::ld19()), run(quiet));
    let both = noisy.iter().flat_map(|p| p.samples).zip(quiet.iter().flat_map(|p| p.samples));
    let errors: Vec<f64> = both
        .filter(|(a, b)| a.range_mm > 0 && b.range_mm > 0)
        .map(|(a, b)| f64::from(a.range_mm) - f64::from(b.range_mm))
        .collect();
    let var_mm2 = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
    assert!(errors.len() > 7000);
    // 10 mm, and twice 1/12 mm² of rounding; 5 standard errors of a deviation are 4 %.
    assert!((var_mm2.sqrt() - 10.01).abs() < 0.4, "{}", var_mm2.sqrt());
    let n_lost = noisy.iter().flat_map(|p| p.samples).filter(|s| s.range_mm == 0).count();
    assert!((20..2000).contains(&n_lost), "{n_lost}");
}

/// The same samples with and without a change of the sensor, where both have a return.
fn side_by_side(world: &World, change: &LidarModel, plain: &LidarModel) -> Vec<(Sample, Sample)> {
    let run = |model: &LidarModel| {
        let mut lidar = LidarSimulator::new(model.clone(), SeedBook::new(3), Stamp::ZERO);
        lidar.advance(world, Stamp::ZERO.plus(Duration::from_secs(4)), |_| still())
    };
    let (changed, plain) = (run(change), run(plain));
    let samples = |packets: Vec<Packet>| packets.into_iter().flat_map(|p| p.samples);
    samples(changed).zip(samples(plain)).filter(|(a, b)| a.range_mm > 0 && b.range_mm > 0).collect()
}

#[test]
fn bias_and_scale_lengthen_every_range() {
    let world = World::alps(0).unwrap();
    let plain = LidarModel::ld19();
    let change = LidarModel { range_bias_m: 0.04, range_scale: -0.01, ..plain.clone() };
    let pairs = side_by_side(&world, &change, &plain);
    assert!(pairs.len() > 10_000);
    for (changed, plain) in pairs {
        let (changed_mm, plain_mm) = (f64::from(changed.range_mm), f64::from(plain.range_mm));
        // Both are rounded; the noise (5 σ: 50 mm) is not scaled.
        assert!((changed_mm - (0.99 * plain_mm + 40.0)).abs() < 1.6, "{changed:?} {plain:?}");
    }
}

#[test]
fn late_stamps_belong_to_an_earlier_pose() {
    let region = Region::new(0.0, 0.0, 20.0, 20.0);
    let floor = HeightField::from_fn(&region, 0.5, |_, _| 0.0).unwrap();
    let world = World::assemble("floor", floor, Vec::new(), SeedBook::new(0));
    let quiet = exact();
    // Straight up at 1 m/s: the range straight down grows by the offset times the speed.
    let climbing = |at: Stamp<_>| {
        Transform::new(Rotation::identity(), Point::new(9.0, 11.0, 6.0 + at.seconds()))
    };
    let down_mm = |stamp_offset_s: f64| -> Vec<f64> {
        let model = LidarModel { stamp_offset_s, ..quiet.clone() };
        let mut lidar = LidarSimulator::new(model, SeedBook::new(3), Stamp::ZERO);
        let packets = lidar.advance(&world, after_ms(2000), climbing);
        let samples = packets.iter().flat_map(|packet| packet.samples);
        samples.filter(|s| s.clockwise_cdeg < 150.0).map(|s| f64::from(s.range_mm)).collect()
    };
    let exact = down_mm(0.0);
    assert!(exact.len() > 20);
    for (offset_s, by_mm) in [(0.01, -10.0), (-0.01, 10.0)] {
        for (moved, exact) in down_mm(offset_s).iter().zip(&exact) {
            // Rounding of both.
            assert!((moved - exact - by_mm).abs() <= 1.01, "{moved} against {exact}");
        }
    }
}

fn after_ms(ms: u64) -> Stamp<stockpilot::time::Mono> {
    Stamp::ZERO.plus(Duration::from_millis(ms))
}

#[test]
fn dust_shortens_its_share_of_the_beams_and_leaves_the_others() {
    let world = World::alps(0).unwrap();
    let plain = exact();
    let dusty = LidarModel { dust_ratio: 0.05, ..plain.clone() };
    let pairs = side_by_side(&world, &dusty, &plain);
    let n = pairs.len() as f64;
    let n_short = pairs.iter().filter(|(dusty, plain)| dusty.range_mm < plain.range_mm).count();
    assert!(pairs.iter().all(|(dusty, plain)| dusty.range_mm <= plain.range_mm));
    // Four standard errors of a share of 5 % in 17 000; a grain nearer than 2 cm is no return.
    assert!(n > 15_000.0);
    assert!((n_short as f64 / n - 0.05).abs() < 0.007, "{}", n_short as f64 / n);
    let mean = pairs
        .iter()
        .filter(|(dusty, plain)| dusty.range_mm < plain.range_mm)
        .map(|(dusty, plain)| f64::from(dusty.range_mm) / f64::from(plain.range_mm))
        .sum::<f64>()
        / n_short as f64;
    // Uniform: 0.5 with a standard error of 0.29/√850 = 0.01.
    assert!((mean - 0.5).abs() < 0.04, "{mean}");
}

#[test]
fn wide_beams_mix_two_surfaces_at_edges_only() {
    // A table of 3 m height on a floor: the only edges are its rim and its foot.
    let region = Region::new(0.0, 0.0, 20.0, 20.0);
    let floor = HeightField::from_fn(&region, 0.1, |_, _| 0.0).unwrap();
    let table = Cuboid::over(&Region::new(7.0, 9.0, 11.0, 13.0), 0.0, 3.0);
    let world = World::assemble("table", floor, vec![table], SeedBook::new(0));
    let plain = exact();
    let wide = LidarModel { half_width_rad: 0.004, ..plain.clone() };
    let pairs = side_by_side(&world, &wide, &plain);
    let mixed: Vec<_> = pairs.iter().filter(|(a, b)| a.range_mm != b.range_mm).collect();
    // Two rims a turn, 40 turns, each met by half a beam on average (8 mrad wide, 14 mrad apart).
    assert!((20..100).contains(&mixed.len()), "{}", mixed.len());
    for (mixed, _) in &mixed {
        let in_lidar = {
            let (sin, cos) = (-mixed.clockwise_cdeg / 100.0).to_radians().sin_cos();
            let range_m = f64::from(mixed.range_mm) / 1000.0;
            Point::<Lidar>::new(range_m * cos, range_m * sin, 0.0)
        };
        let hit = still() * (plain.body_from_lidar * in_lidar);
        // Between the rim's height and the floor, beside the table.
        assert!((-0.01..3.01).contains(&hit.coords.z), "{hit:?}");
        assert!(world.clearance_m(&hit, 3.0) < 2.0);
    }
}

#[test]
fn same_seed_gives_the_same_bytes() {
    let bytes = || -> Vec<u8> { packets(LidarModel::ld19(), 1).iter().flat_map(encode).collect() };
    assert_eq!(bytes(), bytes());
}

#[test]
fn clock_wraps_at_thirty_seconds() {
    let packets = packets(LidarModel::ld19(), 31);
    assert!(packets.iter().all(|packet| packet.clock_ms < 30_000));
    let steps = packets
        .windows(2)
        .map(|pair| (i32::from(pair[1].clock_ms) - i32::from(pair[0].clock_ms)).rem_euclid(30_000));
    assert!(steps.into_iter().all(|step_ms| (2..=3).contains(&step_ms)));
    let n_wraps = packets.windows(2).filter(|pair| pair[1].clock_ms < pair[0].clock_ms).count();
    assert!((1..=2).contains(&n_wraps));
}

#[test]
fn poses_between_steps_are_interpolated() {
    let mut track = PoseTrack::default();
    assert!(track.at(Stamp::ZERO).is_none());
    let pose = |x: f64, yaw: f64| {
        Transform::new(Rotation::from_euler_rad(0.0, 0.0, yaw), Point::new(x, 0.0, 0.0))
    };
    track.push(Stamp::from_nanos(0), pose(0.0, 0.0));
    track.push(Stamp::from_nanos(1000), pose(1.0, 0.02));
    let quarter = track.at(Stamp::from_nanos(250)).unwrap();
    assert!((quarter.origin.coords.x - 0.25).abs() < 1e-12);
    assert!((quarter.rotation.yaw_rad() - 0.005).abs() < 1e-6);
    let ahead = track.at(Stamp::from_nanos(2500)).unwrap();
    assert!((ahead.origin.coords.x - 2.5).abs() < 1e-12);
    assert!((ahead.rotation.yaw_rad() - 0.05).abs() < 1e-4);
}

fn reader(line: &PtyLine, baud: u32) -> OwnedFd {
    let flags = rustix::fs::OFlags::RDWR | rustix::fs::OFlags::NONBLOCK;
    let slave = rustix::fs::open(line.path(), flags, rustix::fs::Mode::empty()).unwrap();
    let mut settings = tcgetattr(&slave).unwrap();
    settings.set_speed(baud).unwrap();
    tcsetattr(&slave, OptionalActions::Now, &settings).unwrap();
    slave
}

fn drain(slave: &OwnedFd) -> Vec<u8> {
    let mut all = Vec::new();
    let mut chunk = [0; 4096];
    while let Ok(n) = read(slave, &mut chunk) {
        all.extend(&chunk[..n]);
    }
    all
}

#[test]
fn line_carries_every_byte_value_unchanged() {
    let packets = packets(LidarModel::ld19(), 1);
    let mut line = PtyLine::open(230_400, LineFaults::default(), SeedBook::new(1)).unwrap();
    line.send(&encode(&packets[0]), 12).unwrap();
    let slave = reader(&line, 230_400);
    let mut received = Vec::new();
    for packet in &packets[1..] {
        line.send(&encode(packet), 12).unwrap();
        received.extend(drain(&slave));
    }
    let sent: Vec<u8> = packets[1..].iter().flat_map(encode).collect();
    // The kernel hands bytes over on its own thread; what is under way comes soon.
    for _ in 0..1_000_000 {
        if received.len() >= sent.len() {
            break;
        }
        std::thread::yield_now();
        received.extend(drain(&slave));
    }
    assert_eq!(received, sent);
    let n_sent = (packets.len() as u64 - 1) * 12;
    let counts = LineCounts { samples_sent: n_sent, samples_unheard: 12, ..LineCounts::default() };
    assert_eq!(line.counts(), counts);
}

#[test]
fn slow_reader_loses_samples_and_the_loss_is_counted() {
    let packets = packets(LidarModel::ld19(), 2);
    let mut line = PtyLine::open(230_400, LineFaults::default(), SeedBook::new(1)).unwrap();
    let _slave = reader(&line, 230_400);
    packets.iter().for_each(|packet| line.send(&encode(packet), 12).unwrap());
    let counts = line.counts();
    // 750 frames of 47 bytes do not fit into the 20 480 bytes of the line.
    assert!(counts.samples_overrun > 1000, "{counts:?}");
    assert_eq!(counts.samples_sent + counts.samples_overrun, packets.len() as u64 * 12);
}

#[test]
fn faults_damage_bytes() {
    let packets = packets(LidarModel::ld19(), 1);
    let faults =
        LineFaults { corrupt_byte_ratio: 0.01, checks_speed: true, ..LineFaults::default() };
    let mut line = PtyLine::open(230_400, faults, SeedBook::new(1)).unwrap();
    let slave = reader(&line, 230_400);
    packets[..100].iter().for_each(|packet| line.send(&encode(packet), 12).unwrap());
    // A frame of 47 bytes survives with probability 0.99⁴⁷ = 0.62.
    let n_corrupted = line.counts().samples_corrupted / 12;
    assert!((20..60).contains(&n_corrupted), "{n_corrupted}");
    drop(slave);
    let _slower = reader(&line, 115_200);
    packets[..10].iter().for_each(|packet| line.send(&encode(packet), 12).unwrap());
    assert_eq!(line.counts().samples_corrupted / 12, n_corrupted + 10, "wrong speed");
}
