//! Bytes of the LiDAR in, records of the log out.

#![expect(clippy::expect_used, reason = "a bench stops where its premise fails")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::Vector3;
use std::hint::black_box;
use std::path::Path;
use stockpilot::lidar::ldrobot::{CLOCK_WRAP_MS, FRAME_SAMPLES, Frame, Parser, Sample, TURN_CDEG};
use stockpilot::messages::{
    Beam, CameraId, ImuSample, Scan, TagDetection, TagDetections, TagFamily,
};
use stockpilot::pilot::Event;
use stockpilot::record::{LogHeader, LogItem, LogReader, Recorder};
use stockpilot::time::{Mono, Stamp};

/// Ten seconds of an LD19: 375 frames a second.
fn lidar_bytes(n_frames: u16) -> Vec<u8> {
    let frame = |k: u16| {
        let start_cdeg = k.wrapping_mul(960) % TURN_CDEG;
        Frame {
            speed_deg_per_s: 3_600,
            start_cdeg,
            samples: [Sample { range_mm: 2_000 + k % 500, intensity: 180 }; FRAME_SAMPLES],
            end_cdeg: (start_cdeg + 880) % TURN_CDEG,
            timestamp_ms: (k * 8 / 3) % CLOCK_WRAP_MS,
        }
    };
    (0..n_frames).flat_map(|k| frame(k).to_bytes()).collect()
}

fn parser(c: &mut Criterion) {
    let bytes = lidar_bytes(3_750);
    let n_frames = |bytes: &[u8]| {
        let (mut parser, mut n) = (Parser::new(), 0);
        for chunk in bytes.chunks(512) {
            parser.feed(chunk, |_, _| n += 1);
        }
        n
    };
    assert_eq!(n_frames(&bytes), 3_750);
    let mut group = c.benchmark_group("ldrobot");
    group.throughput(Throughput::Bytes(bytes.len() as u64));
    group.bench_function("parse_10_s", |b| b.iter(|| n_frames(black_box(&bytes))));
    group.finish();
}

/// What a second of flight brings: 200 inertial samples, 20 frames of ten tags, 10 turns of 450
/// beams, 60 ticks.
fn one_second() -> Vec<(Stamp<Mono>, Event)> {
    let at = |ms: i64| Stamp::from_nanos(ms * 1_000_000);
    let mut events = Vec::new();
    for ms in 0..1_000_i64 {
        if ms % 5 == 0 {
            let accel_mps2 = Vector3::new(0.123_456_7, -0.034, 9.801_234);
            let gyro_radps = Vector3::new(0.001, 0.2, -0.03);
            events.push((at(ms), Event::Imu(ImuSample { at: at(ms), accel_mps2, gyro_radps })));
        }
        if ms % 50 == 0 {
            events.push((at(ms), Event::TagsSeen(ten_tags(at(ms)))));
        }
        if ms % 100 == 0 {
            events.push((at(ms), Event::Scanned(turn(at(ms)))));
        }
        if ms % 17 == 0 {
            events.push((at(ms), Event::Ticked(at(ms))));
        }
    }
    events
}

fn ten_tags(at: Stamp<Mono>) -> TagDetections {
    let tag = |id: u32| {
        let (u, v) = (f64::from(id) * 100.3 + 12.25, 312.75);
        TagDetection {
            id,
            family: TagFamily::Tag36h11,
            corners_px: [[u, v + 40.1], [u + 40.2, v + 40.3], [u + 40.4, v], [u, v]],
            decision_margin: 63.5,
        }
    };
    TagDetections {
        captured_at: at,
        received_at: at,
        camera: CameraId(0),
        tags: (0..10).map(tag).collect(),
        points: Vec::new(),
    }
}

#[expect(clippy::cast_precision_loss, reason = "small numbers")]
fn turn(start: Stamp<Mono>) -> Scan {
    let beam = |k: u32| Beam {
        offset_ns: k * 222_222,
        angle_rad: k as f32 * 0.013_96,
        range_m: 5.0 + k as f32 * 0.01,
        intensity: 200,
    };
    Scan { start, beams: (0..450).map(beam).collect() }
}

fn record(path: &Path, events: &[(Stamp<Mono>, Event)]) -> u64 {
    let mut recorder = Recorder::create(path, &LogHeader::default()).expect("a new log").waiting();
    for (at, event) in events {
        recorder.event(*at, event);
    }
    recorder.close().written
}

fn log(c: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("flight.mcap");
    let events = one_second();
    record(&path, &events);
    let reader = LogReader::open(&path).expect("the log");
    let n_read = reader.filter(|item| matches!(item, LogItem::Event { .. })).count();
    assert_eq!(n_read, events.len());
    let mut group = c.benchmark_group("log");
    group.sample_size(20);
    group.throughput(Throughput::Elements(events.len() as u64));
    group.bench_function("record_one_second", |b| {
        b.iter(|| {
            // A log is never overwritten.
            std::fs::remove_file(&path).expect("the last log");
            record(&path, black_box(&events))
        });
    });
    group.finish();
}

criterion_group!(benches, parser, log);
criterion_main!(benches);
