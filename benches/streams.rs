//! Bytes of the LiDAR in, records of the log out.

#![expect(clippy::expect_used, reason = "a bench stops where its premise fails")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::Vector3;
use std::hint::black_box;
use std::path::Path;
use stockpilot::lidar::hokuyo::{BlockReader, sum_of};
use stockpilot::lidar::ldrobot::{CLOCK_WRAP_MS, FRAME_SAMPLES, Frame, Parser, Sample, TURN_CDEG};
use stockpilot::lidar::rplidar::{Answer, Node, StreamParser};
use stockpilot::lidar::ydlidar::{Geometry, PacketParser, SampleFormat};
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

/// Ten seconds of an LD19 come in chunks of this size.
const CHUNK_BYTES: usize = 512;

fn ldrobot(c: &mut Criterion) {
    let bytes = lidar_bytes(3_750);
    let n_frames = |bytes: &[u8]| {
        let (mut parser, mut n) = (Parser::new(), 0);
        for chunk in bytes.chunks(CHUNK_BYTES) {
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

/// Numbers that look like distances of a room, without a pattern that a processor could guess.
fn scattered() -> impl Iterator<Item = u16> {
    let mut state = 0x1234_5678_u32;
    std::iter::from_fn(move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        Some(600 + u16::try_from(state >> 20).unwrap_or(0))
    })
}

/// A stream of `n` frames in a format of RPLIDAR, with good checksums and a turning head.
fn rplidar_bytes(answer: Answer, n: u32) -> Vec<u8> {
    let mut values = scattered();
    let n_bytes = answer.frame_bytes();
    let start_at = if answer == Answer::UltraDense { 8 } else { 2 };
    let frame = |k: u32| {
        let step_q6 = if answer == Answer::Standard { 46 } else { 46 * 16 };
        let start_q6 = u16::try_from(k * step_q6 % 23_040).unwrap_or(0);
        let mut frame: Vec<u8> =
            values.by_ref().take(n_bytes).flat_map(u16::to_le_bytes).take(n_bytes).collect();
        match answer {
            Answer::Standard => {
                frame[0] = 0xBE;
                frame[1..3].copy_from_slice(&(start_q6 << 1 | 1).to_le_bytes());
            }
            Answer::Hq => {
                frame[0] = 0xA5;
                for k in 0..96 {
                    frame[9 + 8 * k + 4..9 + 8 * k + 6].fill(0);
                }
                let mut crc = crc32fast::Hasher::new();
                crc.update(&frame[..777]);
                crc.update(&[0; 3]);
                frame[777..].copy_from_slice(&crc.finalize().to_le_bytes());
            }
            _ => {
                frame[start_at..start_at + 2].copy_from_slice(&start_q6.to_le_bytes());
                let sum = frame[2..].iter().fold(0, |xor, byte| xor ^ byte);
                (frame[0], frame[1]) = (0xA0 | (sum & 0xF), 0x50 | sum >> 4);
            }
        }
        frame
    };
    (0..n).flat_map(frame).collect()
}

fn rplidar(c: &mut Criterion) {
    let mut group = c.benchmark_group("rplidar");
    for (name, answer) in [
        ("standard", Answer::Standard),
        ("legacy", Answer::Legacy),
        ("hq", Answer::Hq),
        ("ultra", Answer::Ultra),
        ("dense", Answer::Dense),
        ("ultra_dense", Answer::UltraDense),
    ] {
        let n_frames = u32::try_from(200_000 / answer.frame_bytes()).expect("few");
        let bytes = rplidar_bytes(answer, n_frames);
        let n_samples = |bytes: &[u8]| {
            let (mut parser, mut packet, mut n) = (StreamParser::new(answer), Vec::new(), 0);
            for chunk in bytes.chunks(CHUNK_BYTES) {
                parser.feed(chunk, Stamp::ZERO, |arrived| {
                    packet.clear();
                    packet.extend(arrived.nodes.iter().map(Node::sample));
                    n += black_box(&packet).len();
                });
            }
            n
        };
        let waiting = if matches!(answer, Answer::Standard | Answer::Hq) { 0 } else { 1 };
        let expected = (n_frames as usize - waiting) * answer.frame_samples();
        assert_eq!(n_samples(&bytes), expected, "{name}");
        group.throughput(Throughput::Bytes(bytes.len() as u64));
        group.bench_function(name, |b| b.iter(|| n_samples(black_box(&bytes))));
    }
    group.finish();
}

/// Packets of 40 samples.
fn ydlidar_bytes(format: SampleFormat, n_packets: u16) -> Vec<u8> {
    let mut values = scattered();
    let packet = |k: u16| {
        let first = (k * 920 % 23_040) << 1 | 1;
        let last = ((k * 920 + 897) % 23_040) << 1 | 1;
        let mut sum = 0x55AA ^ first ^ last ^ u16::from_le_bytes([0, 40]);
        let mut body = Vec::new();
        for value in values.by_ref().take(40) {
            if format == SampleFormat::IntensityAndDistance {
                body.push(77);
                sum ^= 77;
            }
            body.extend((value * 4).to_le_bytes());
            sum ^= value * 4;
        }
        let head = [0xAA, 0x55, 0, 40];
        let words = [first, last, sum].map(u16::to_le_bytes).concat();
        [&head[..], &words, &body].concat()
    };
    (0..n_packets).flat_map(packet).collect()
}

fn ydlidar(c: &mut Criterion) {
    let mut group = c.benchmark_group("ydlidar");
    for (name, format, geometry) in [
        ("triangle", SampleFormat::Distance, Geometry::Triangle),
        ("time_of_flight", SampleFormat::Distance, Geometry::TimeOfFlight),
        ("intensity", SampleFormat::IntensityAndDistance, Geometry::TimeOfFlight),
    ] {
        let bytes = ydlidar_bytes(format, 2_000);
        let n_samples = |bytes: &[u8]| {
            let (mut parser, mut n) = (PacketParser::new(geometry, format), 0);
            for chunk in bytes.chunks(CHUNK_BYTES) {
                parser.feed(chunk, |arrived| n += arrived.samples.len());
            }
            n
        };
        assert_eq!(n_samples(&bytes), 2_000 * 40, "{name}");
        group.throughput(Throughput::Bytes(bytes.len() as u64));
        group.bench_function(name, |b| b.iter(|| n_samples(black_box(&bytes))));
    }
    group.finish();
}

/// Scans of a UTM-30LX: 1,081 distances of three characters in lines of 64.
fn hokuyo_bytes(n_scans: u32) -> Vec<u8> {
    let line = |text: &[u8]| [text, &[sum_of(text), b'\n']].concat();
    let mut values = scattered();
    let scan = |_| {
        let characters: Vec<u8> = values
            .by_ref()
            .take(1_081)
            .flat_map(|mm| [mm >> 12, mm >> 6 & 63, mm & 63].map(|six| six.to_le_bytes()[0] + 0x30))
            .collect();
        let data = characters.chunks(64).flat_map(line).collect::<Vec<u8>>();
        [b"MD0000108001000\n", &line(b"99")[..], &line(b"0123"), &data, b"\n"].concat()
    };
    (0..n_scans).flat_map(scan).collect()
}

fn hokuyo(c: &mut Criterion) {
    let bytes = hokuyo_bytes(60);
    let n_distances = |bytes: &[u8]| {
        let (mut reader, mut n) = (BlockReader::new(1_081), 0);
        for chunk in bytes.chunks(CHUNK_BYTES) {
            reader.feed(chunk, |_, distances_mm, _| n += distances_mm.len());
        }
        n
    };
    assert_eq!(n_distances(&bytes), 60 * 1_081);
    let mut group = c.benchmark_group("hokuyo");
    group.throughput(Throughput::Bytes(bytes.len() as u64));
    group.bench_function("scip_md", |b| b.iter(|| n_distances(black_box(&bytes))));
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

criterion_group!(benches, ldrobot, rplidar, ydlidar, hokuyo, log);
criterion_main!(benches);
