//! Every driver understands its emulator, and the room comes out right.

use crate::support::{Bench, Clean};
use stockpilot::lidar::rplidar::{Answer, StreamParser};
use stockpilot::lidar::{Family, Model};
use stockpilot::stats::SeedBook;
use stockpilot::time::Stamp;
use stockpilot_sim::lidar::{Frame, LidarModel, Optics, Room};

#[test]
fn every_model_is_understood_and_its_room_is_right() {
    for model in Model::ALL {
        let mut bench = Bench::new(model);
        bench.run(6.0, &mut Clean);
        let counts = bench.sensor.counts();
        assert_eq!(counts.checksum_errors, 0, "{model:?}");
        assert_eq!(counts.restarts, 0, "{model:?}");
        assert_eq!(bench.sensor.identity().unwrap().model, Some(model));
        // Three seconds for questions and spin-up.
        let spec = model.spec();
        let n_in_three_s = 3 * u64::from(spec.samples_per_s);
        let is_hokuyo = model.family() == Family::Hokuyo;
        let expected = if is_hokuyo { n_in_three_s * 2 / 3 } else { n_in_three_s };
        let stats = bench.assembler.stats();
        assert!(stats.beams > expected, "{model:?}: {stats:?} of {expected}");
        let (n, median, most, _) = bench.errors_mm();
        println!("{:18} {n:6} beams, median {median:.2} mm, 99 % {most:.2} mm", model.name());
        // Steps of the range, and those of the angle at the corners, where the wall is 3.6 m away
        // and seen at 34°: 1/64° is 1.5 mm there, 1/8° is 12 mm.
        assert!(n as u64 > expected && median < 2.0 && most < 9.0, "{model:?}");
    }
}

/// Steps of the range are up to 8 mm here; rounded down anywhere on the way they would be a bias of
/// millimetres, which no number of beams takes away.
#[test]
fn no_model_measures_short_or_long_on_average() {
    for model in Model::ALL {
        let noisy = LidarModel { dropout_ratio: 0.0, ..LidarModel::of(model) };
        let far_m = 0.6 * noisy.range_max_m.min(13.0);
        let mut bench = Bench::new(model);
        let optics = Optics::new(noisy.clone(), SeedBook::new(2));
        bench.room = Room::new(optics).with_half_length_m(far_m);
        bench.run(8.0, &mut Clean);
        let (mut sum_mm, mut n) = (0.0, 0.0);
        for beam in bench.scans.iter().flat_map(|scan| &scan.beams) {
            // Square on, where an error of the angle changes nothing.
            let (wall_m, square_on) = bench.room.wall(-f64::from(beam.angle_rad).to_degrees());
            if beam.range_m > 0.0 && square_on > 0.98 {
                sum_mm += 1000.0 * (f64::from(beam.range_m) - wall_m);
                n += 1.0;
            }
        }
        let (mean_mm, sigma_mm) = (sum_mm / n, 1000.0 * noisy.range_sigma_m / f64::sqrt(n));
        println!("{:18} {mean_mm:+.3} ± {sigma_mm:.3} mm of {n} beams", model.name());
        assert!(n > 500.0 && mean_mm.abs() < 4.0 * sigma_mm + 0.05, "{model:?}: {mean_mm} mm");
    }
}

#[test]
fn beams_are_stamped_when_they_were_measured() {
    // The room does not move, so the stamps are judged by the angle: the head turns evenly.
    for model in [Model::Ld19, Model::RplidarA3, Model::RplidarS2, Model::YdlidarG4] {
        let mut bench = Bench::new(model);
        bench.run(8.0, &mut Clean);
        let full: Vec<_> = bench.scans[bench.scans.len() - 20..].iter().collect();
        for scan in &full {
            let (first, last) = (scan.beams[0], scan.beams[scan.beams.len() - 1]);
            let turned =
                f64::from(first.angle_rad - last.angle_rad).rem_euclid(std::f64::consts::TAU);
            let took_s = f64::from(last.offset_ns) * 1e-9;
            // One turn in 0.1 s; compensated angles are up to 9° off the head's.
            let expected_s =
                if turned < 1.0 { turned + std::f64::consts::TAU } else { turned } / 62.83;
            assert!((took_s - expected_s).abs() < 4e-3, "{model:?}: {took_s} s, {expected_s} s");
        }
    }
}

/// All frames of one mode of a sensor, without a driver.
fn frames_of(model: Model, mode: u8, seconds: u32) -> Vec<Frame> {
    let mut bench = Bench::new(model);
    let (device, now) = (&mut bench.device, bench.now);
    // Motor by speed or by duty, whichever it is; then an express scan in this mode.
    device.hear(&[0xA5, 0xA8, 0x02, 0x58, 0x02, 0x55], now);
    device.hear(&[0xA5, 0xF0, 0x02, 0x94, 0x02, 0xC1], now);
    let request = [0xA5, 0x82, 0x05, mode, 0, 0, 0, 0];
    let sum = request.iter().fold(0, |xor, byte| xor ^ byte);
    device.hear(&[&request[..], &[sum]].concat(), now);
    let mut frames = Vec::new();
    for step in 1..=seconds * 100 {
        let until = now.plus(std::time::Duration::from_millis(10) * step);
        bench.device.advance(until, &mut bench.room, &mut frames);
    }
    frames
}

#[test]
fn every_rplidar_format_gives_the_room_back() {
    let formats = [
        (Model::RplidarS1, 0, Answer::Standard, 1.5),
        (Model::RplidarA3, 1, Answer::Legacy, 1.5),
        (Model::RplidarS1, 3, Answer::Hq, 0.5),
        (Model::RplidarA3, 2, Answer::Ultra, 3.0),
        (Model::RplidarS1, 1, Answer::Dense, 1.5),
        (Model::RplidarS1, 2, Answer::UltraDense, 3.5),
    ];
    for (model, mode, answer, median_limit_mm) in formats {
        let frames = frames_of(model, mode, 4);
        let room = Bench::new(model).room;
        let mut parser = StreamParser::new(answer);
        let mut errors = Vec::new();
        for frame in frames.iter().filter(|frame| frame.n_samples > 0) {
            parser.feed(&frame.bytes, Stamp::ZERO, |arrived| {
                for node in arrived.nodes.iter().filter(|node| node.dist_q2 > 0) {
                    let (wall_m, _) = room.wall(f64::from(node.angle_q16) / 65_536.0);
                    errors.push((f64::from(node.dist_q2) / 4.0 - 1000.0 * wall_m).abs());
                }
            });
        }
        errors.sort_by(f64::total_cmp);
        assert_eq!(parser.refused(), 0, "{answer:?}");
        let n_sent: u64 = frames.iter().map(|frame| frame.n_samples).sum();
        // The last capsule waits for the next one.
        assert!(errors.len() as u64 + 100 >= n_sent && n_sent > 9000, "{answer:?}: {n_sent}");
        let median = errors[errors.len() / 2];
        println!("{answer:?}: {} samples, median error {median:.2} mm", errors.len());
        assert!(median < median_limit_mm, "{answer:?}: {median} mm");
    }
}

#[test]
fn old_firmware_boards_and_errors_are_coped_with() {
    // A sensor with an internal error is reset and scans again.
    let mut bench = Bench::new(Model::RplidarA1);
    bench.run(4.0, &mut Clean);
    let before = bench.scans.len();
    bench.device.suffer(stockpilot_sim::lidar::Mishap::InternalError, bench.now);
    bench.run(2.0, &mut Clean);
    assert!(bench.sensor.trouble().unwrap().text.contains("0x0042"));
    bench.run(8.0, &mut Clean);
    assert!(bench.sensor.trouble().is_none());
    assert!(bench.scans.len() > before + 20, "{} scans", bench.scans.len() - before);
}
