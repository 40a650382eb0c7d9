//! Drives parsers and whole conversations with such frames; also by the fuzz target `lidar_bytes`.

use super::lidar_frames::{Kind, SCIP_STEPS};
use std::time::Duration;
use stockpilot::lidar::hokuyo::{BlockReader, sum_of};
use stockpilot::lidar::ldrobot::Parser;
use stockpilot::lidar::rplidar::{Answer, StreamParser};
use stockpilot::lidar::ydlidar::{Geometry, PacketParser, SampleFormat};
use stockpilot::lidar::{Model, Request, ScanAssembler, Sensor, sensor};
use stockpilot::messages::Scan;
use stockpilot::time::{Mono, Stamp};

/// What comes on the line.
#[derive(Debug, Clone)]
pub(crate) enum Piece {
    /// A frame with right sums around these bytes.
    Frame(Vec<u8>),
    /// The same with one byte changed.
    Damaged(Vec<u8>, usize),
    /// No frame.
    Garbage(Vec<u8>),
}

/// Regular frames within which a parser must have found its way back, and those that it must read then.
const TO_RECOVER: u16 = 12;
const TO_READ: u16 = 6;

/// No piece makes the parser panic or gives an impossible range, and regular frames are read again
/// soon after the last of them.
///
/// # Panics
/// If not.
pub(crate) fn parse(kind: Kind, pieces: &[Piece], chunk_bytes: usize) {
    let mut parser = Parsing::new(kind);
    for chunk in line(kind, pieces).chunks(chunk_bytes.max(1)) {
        parser.feed(chunk);
    }
    for k in 0..TO_RECOVER {
        parser.feed(&kind.regular(k));
    }
    let n_before = parser.n_frames;
    for k in TO_RECOVER..TO_RECOVER + TO_READ {
        parser.feed(&kind.regular(k));
    }
    let n_read = parser.n_frames - n_before;
    assert!(n_read >= u64::from(TO_READ) - 1, "{kind:?}: {n_read} of {TO_READ} regular frames");
}

/// The bytes of the pieces.
fn line(kind: Kind, pieces: &[Piece]) -> Vec<u8> {
    let mut angle_q6 = 0;
    let bytes = |piece: &Piece| match piece {
        Piece::Frame(payload) => kind.frame(payload, &mut angle_q6),
        Piece::Damaged(payload, at) => {
            let mut frame = kind.frame(payload, &mut angle_q6);
            let at = at % frame.len();
            frame[at] ^= 1 << (at % 8);
            frame
        }
        Piece::Garbage(bytes) => bytes.clone(),
    };
    pieces.iter().flat_map(bytes).collect()
}

enum Reader {
    Rplidar(StreamParser),
    Ydlidar(PacketParser),
    Ldrobot(Parser),
    Hokuyo(BlockReader),
}

struct Parsing {
    reader: Reader,
    n_frames: u64,
}

impl Parsing {
    fn new(kind: Kind) -> Self {
        let answer = kind.answer().and_then(Answer::from_byte);
        let reader = match (kind, answer) {
            (_, Some(answer)) => Reader::Rplidar(StreamParser::new(answer)),
            (Kind::Ldrobot, _) => Reader::Ldrobot(Parser::new()),
            (Kind::Scip, _) => Reader::Hokuyo(BlockReader::new(SCIP_STEPS)),
            (Kind::Distance, _) => {
                Reader::Ydlidar(PacketParser::new(Geometry::Triangle, SampleFormat::Distance))
            }
            _ => Reader::Ydlidar(PacketParser::new(
                Geometry::TimeOfFlight,
                SampleFormat::IntensityAndDistance,
            )),
        };
        Self { reader, n_frames: 0 }
    }

    fn feed(&mut self, bytes: &[u8]) {
        let n_frames = &mut self.n_frames;
        match &mut self.reader {
            Reader::Rplidar(parser) => {
                parser.feed(bytes, Stamp::ZERO, |arrived| {
                    arrived.nodes.iter().for_each(|node| assert_sane(node.sample()));
                });
                let per_frame = if parser.answer() == Answer::Standard { 12 } else { 1 };
                *n_frames = parser.frames() / per_frame;
            }
            Reader::Ydlidar(parser) => parser.feed(bytes, |arrived| {
                arrived.samples.iter().for_each(|sample| assert_sane(*sample));
                *n_frames += 1;
            }),
            Reader::Ldrobot(parser) => parser.feed(bytes, |frame, _| {
                assert!((0..12).all(|i| (0.0..360.0).contains(&frame.angle_deg(i))), "{frame:?}");
                *n_frames += 1;
            }),
            Reader::Hokuyo(reader) => reader.feed(bytes, |_, distances_mm, _| {
                assert!(distances_mm.len() <= SCIP_STEPS);
                assert!(distances_mm.iter().all(|mm| *mm < 1 << 18));
                *n_frames += 1;
            }),
        }
    }
}

fn assert_sane(sample: stockpilot::lidar::Sample) {
    assert!(sample.range_m.is_finite() && sample.range_m >= 0.0, "{sample:?}");
    assert!((0.0..=360.0).contains(&sample.clockwise_deg), "{sample:?}");
}

/// The same through a whole conversation and its scans: none of them is impossible, stamps never go
/// back, and samples have come.
///
/// # Panics
/// If not.
pub(crate) fn converse(kind: Kind, pieces: &[Piece], chunk_bytes: usize) {
    let model = match kind {
        Kind::Distance => Model::YdlidarX4,
        Kind::IntensityAndDistance => Model::YdlidarTminiPro,
        Kind::Ldrobot => Model::Ld19,
        Kind::Scip => Model::HokuyoUrg04lx,
        _ => Model::RplidarA3,
    };
    let mut talk = Talk {
        kind,
        sensor: sensor(model),
        assembler: ScanAssembler::new(model.default_baud()),
        now: Stamp::ZERO,
        last_at: Stamp::ZERO,
    };
    talk.sensor.restart(talk.now);
    // Questions that nobody answers are given up within this time.
    for _ in 0..300 {
        talk.step(&[]);
    }
    for k in 0..TO_READ {
        talk.step(&kind.regular(k));
    }
    assert!(talk.assembler.stats().beams > 0, "{kind:?} does not begin");
    for chunk in line(kind, pieces).chunks(chunk_bytes.max(1)) {
        talk.step(chunk);
    }
}

struct Talk {
    kind: Kind,
    sensor: Box<dyn Sensor>,
    assembler: ScanAssembler,
    now: Stamp<Mono>,
    last_at: Stamp<Mono>,
}

impl Talk {
    /// Ten milliseconds in which these bytes come.
    fn step(&mut self, bytes: &[u8]) {
        self.now = self.now.plus(Duration::from_millis(10));
        let mut answers = Vec::new();
        while let Some(request) = self.sensor.poll(self.now) {
            if let Request::Send(request) = request {
                answers.extend(answer(self.kind, &request));
            }
        }
        self.feed(&answers);
        self.feed(bytes);
    }

    fn feed(&mut self, bytes: &[u8]) {
        let Self { sensor, assembler, now, last_at, .. } = self;
        sensor.feed(bytes, *now, &mut |packet| {
            packet.samples.iter().for_each(|sample| assert_sane(*sample));
            assembler.push(packet, |scan| *last_at = assert_sane_scan(&scan, *last_at));
        });
    }
}

fn assert_sane_scan(scan: &Scan, last_at: Stamp<Mono>) -> Stamp<Mono> {
    assert!(scan.start >= last_at, "a scan goes back: {:?} {last_at:?}", scan.start);
    for beam in &scan.beams {
        assert!(beam.range_m.is_finite() && beam.range_m >= 0.0);
        assert!(beam.angle_rad.abs() <= std::f32::consts::PI + 1e-6);
    }
    assert!(scan.beams.is_sorted_by_key(|beam| beam.offset_ns));
    scan.end()
}

/// What a sensor answers to a request: that all is well, that it is old, and that it scans.
fn answer(kind: Kind, request: &[u8]) -> Vec<u8> {
    const HEALTH: [u8; 10] = [0xA5, 0x5A, 3, 0, 0, 0, 0x06, 0, 0, 0];
    let info = |model: u8| {
        // Firmware 1.10: no configuration, no express scans.
        let mut bytes = vec![0xA5, 0x5A, 20, 0, 0, 0, 0x04, model, 10, 1, 2];
        bytes.extend([0; 16]);
        bytes
    };
    match (kind, kind.answer(), request) {
        (_, Some(_), [0xA5, 0x50]) => info(0x31),
        (Kind::Distance, _, [0xA5, 0x90]) => info(6),
        (Kind::IntensityAndDistance, _, [0xA5, 0x90]) => info(150),
        (_, Some(_), [0xA5, 0x52])
        | (Kind::Distance | Kind::IntensityAndDistance, _, [_, 0x92]) => HEALTH.to_vec(),
        (_, Some(answer), [0xA5, 0x20]) => vec![0xA5, 0x5A, 5, 0, 0, 0x40, answer],
        (Kind::Scip, _, request) => scip_answer(request),
        _ => Vec::new(),
    }
}

fn scip_answer(request: &[u8]) -> Vec<u8> {
    let mut bytes = request.to_vec();
    bytes.extend(b"00P\n");
    if request == b"PP\n" {
        for line in
            ["DMIN:20", "DMAX:5600", "ARES:1024", "AMIN:44", "AMAX:725", "AFRT:384", "SCAN:600"]
        {
            bytes.extend(line.as_bytes());
            bytes.extend([b';', sum_of(line.as_bytes()), b'\n']);
        }
    }
    bytes.push(b'\n');
    bytes
}
