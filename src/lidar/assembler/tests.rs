use super::*;
use crate::lidar::ldrobot::{CLOCK_WRAP_MS, Frame, Ldrobot, Sample, TURN_CDEG};
use crate::lidar::{Model, Sensor};

const PERIOD_NS: f64 = 1e9 / 4500.0;
const LINE_NS: f64 = 47.0 * 10.0 / 230_400.0 * 1e9;

/// An LD19 at 10 turns/s whose range encodes the sample's number, starting near 350°.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small test numbers")]
fn frame(frame_idx: u32) -> Frame {
    let cdeg = |sample: u32| ((35_000.0 + f64::from(sample) * 80.0) % 36_000.0) as u16;
    let first = frame_idx * 12;
    Frame {
        speed_deg_per_s: 3600,
        start_cdeg: cdeg(first) % TURN_CDEG,
        end_cdeg: cdeg(first + 11) % TURN_CDEG,
        timestamp_ms: ((f64::from(first) / 4.5 + 29_900.0) as u32 % u32::from(CLOCK_WRAP_MS))
            as u16,
        samples: std::array::from_fn(|i| Sample {
            range_mm: (first as usize + i) as u16,
            intensity: 9,
        }),
    }
}

/// When the last byte of the frame arrives on an undisturbed line.
#[expect(clippy::cast_possible_truncation, reason = "small test numbers")]
fn arrival(frame_idx: u32) -> Stamp<Mono> {
    let last_sample = f64::from(frame_idx * 12 + 11);
    Stamp::from_nanos((last_sample * PERIOD_NS + LINE_NS) as i64)
}

fn true_time_s(beam: &Beam) -> f64 {
    f64::from((beam.range_m * 1000.0).round()) * PERIOD_NS * 1e-9
}

fn worst_stamp_error_s(scans: &[Scan]) -> f64 {
    let error = |scan: &Scan, beam| (scan.beam_at(beam).seconds() - true_time_s(beam)).abs();
    scans.iter().flat_map(|s| s.beams.iter().map(move |b| error(s, b))).fold(0.0, f64::max)
}

fn assemble(arrivals: impl Iterator<Item = (u32, Stamp<Mono>)>) -> (Vec<Scan>, AssemblerStats) {
    let mut assembler = ScanAssembler::new(230_400);
    let mut sensor = Ldrobot::new(Model::Ld19);
    let mut scans = Vec::new();
    for (frame_idx, at) in arrivals {
        sensor.feed(&frame(frame_idx).to_bytes(), at, &mut |packet| {
            assembler.push(packet, |scan| scans.push(scan));
        });
    }
    assembler.reset(|scan| scans.push(scan));
    (scans, assembler.stats())
}

#[test]
fn one_scan_per_turn_and_every_beam_in_it() {
    let (scans, stats) = assemble((0..150).map(|i| (i, arrival(i))));
    assert_eq!(stats.beams, 1800);
    assert_eq!(stats.missing_samples, 0);
    // From 350° it takes 13 samples of 0.8° to pass north; then 450 to a turn.
    let sizes: Vec<usize> = scans.iter().map(|scan| scan.beams.len()).collect();
    assert_eq!(sizes, [13, 450, 450, 450, 437]);
}

#[test]
fn device_angles_turn_round() {
    let (scans, _) = assemble((0..40).map(|i| (i, arrival(i))));
    // The first sample lies at device 350°, 10° to the left of the front mark seen from above.
    assert!((scans[0].beams[0].angle_rad - 10_f32.to_radians()).abs() < 1e-6);
    assert!(scans[1].beams[200].angle_rad < scans[1].beams[100].angle_rad);
}

#[test]
fn stamps_meet_the_true_times_on_a_quiet_line() {
    let (scans, _) = assemble((0..400).map(|i| (i, arrival(i))));
    // The line's byte time is cut to whole nanoseconds: 47 of them at most.
    assert!(worst_stamp_error_s(&scans) < 2e-7);
}

#[test]
fn a_stalled_reader_bends_no_stamps() {
    // The reader sleeps from 0.5 s to 0.7 s; what came meanwhile is read at once.
    let wake = Stamp::from_nanos(700_000_000);
    let stalled = |i| {
        let at = arrival(i);
        if at.seconds() > 0.5 { at.max(wake) } else { at }
    };
    let (scans, stats) = assemble((0..400).map(|i| (i, stalled(i))));
    assert_eq!(stats.clock_restarts, 0);
    // The allowed drift is 1 % of 0.2 s.
    assert!(worst_stamp_error_s(&scans) < 2.1e-3, "{}", worst_stamp_error_s(&scans));
}

#[test]
fn stamps_never_go_back() {
    // Every fifth frame comes 2 ms late, every seventh chunk 40 ms.
    let late = |i: u32| {
        arrival(i).plus(Duration::from_millis(match (i % 5, i % 7) {
            (_, 0) => 40,
            (0, _) => 2,
            _ => 0,
        }))
    };
    let (scans, _) = assemble((0..400).map(|i| (i, late(i))));
    let stamps: Vec<_> = scans.iter().flat_map(|s| s.beams.iter().map(|b| s.beam_at(b))).collect();
    assert!(stamps.is_sorted());
    assert_eq!(stamps.len(), 4800);
}

#[test]
fn lost_frames_are_counted_within_and_beyond_a_turn() {
    for lost in [1_u32, 5, 20, 37, 38, 90] {
        let kept = (0..200).filter(|i| !(60..60 + lost).contains(i));
        let (scans, stats) = assemble(kept.map(|i| (i, arrival(i))));
        assert_eq!(stats.missing_samples, u64::from(lost) * 12, "{lost} frames lost");
        assert_eq!(stats.gaps, 1);
        assert!(worst_stamp_error_s(&scans) < 1e-6);
    }
}

#[test]
fn a_part_of_a_turn_is_handed_on_when_it_is_old() {
    let mut assembler = ScanAssembler::new(230_400);
    let mut scans = Vec::new();
    Ldrobot::new(Model::Ld19).feed(&frame(3).to_bytes(), arrival(3), &mut |packet| {
        assembler.push(packet, |scan| scans.push(scan));
    });
    let start = arrival(3);
    assembler.flush_if_old(start.plus(Duration::from_millis(100)), |scan| scans.push(scan));
    assert_eq!(scans.len(), 0);
    assembler.flush_if_old(start.plus(Duration::from_millis(151)), |scan| scans.push(scan));
    assert_eq!(scans[0].beams.len(), 12);
}

#[test]
fn a_sensor_that_pauses_starts_a_new_clock() {
    let late = |i: u32| arrival(i).plus(Duration::from_secs(if i < 50 { 0 } else { 3 }));
    let (scans, stats) = assemble((0..60).map(|i| (i, late(i))));
    assert_eq!(stats.clock_restarts, 1);
    let last = scans.last().unwrap();
    assert!((last.end().seconds() - 3.0 - 719.0 * PERIOD_NS * 1e-9).abs() < 1e-3);
}

#[expect(clippy::cast_possible_truncation, reason = "degrees")]
fn single(deg: f64) -> f32 {
    deg as f32
}

/// A triangulating sensor whose samples jump back by 9° where nothing came back.
fn jumpy_packet(k: u32) -> Packet {
    let head_deg = |i: u32| f64::from(350 + 2 * (k * 10 + i)).rem_euclid(360.0);
    let jump_deg = |i: u32| if (k * 10 + i).is_multiple_of(3) { -9.0 } else { 0.0 };
    let sample = |i| crate::lidar::Sample {
        clockwise_deg: single((head_deg(i) + jump_deg(i)).rem_euclid(360.0)),
        ..crate::lidar::Sample::default()
    };
    Packet {
        samples: (0..10).map(sample).collect(),
        received_at: Stamp::ZERO.plus(Duration::from_micros(500 * 10) * (k + 1)),
        sample_period: Duration::from_micros(500),
        ..Packet::default()
    }
}

#[test]
fn angles_that_jump_back_at_the_front_mark_end_one_turn_only() {
    let mut assembler = ScanAssembler::new(0);
    let mut scans = Vec::new();
    // 180 samples to a turn, 18 packets; five turns and the 5 samples before the mark.
    for k in 0..90 {
        assembler.push(&jumpy_packet(k), |scan| scans.push(scan));
    }
    assert_eq!(assembler.stats().turns, 5);
    assert!(scans[1..].iter().all(|scan| scan.beams.len().abs_diff(180) <= 5), "{scans:?}");
}
