//! A frame with a wrong bit gives nothing: not one range of it, in any format with a checksum.

use crate::support::Bench;
use std::time::Duration;
use stockpilot::lidar::Model;
use stockpilot::lidar::hokuyo::BlockReader;
use stockpilot::lidar::ldrobot::Parser;
use stockpilot::lidar::rplidar::{Answer, StreamParser};
use stockpilot::lidar::ydlidar::{Geometry, PacketParser, SampleFormat};
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::Stamp;

/// Ranges of one packet, mm or what the parser has.
type Ranges = Vec<u32>;
/// Takes a chunk and appends what it completes.
type Feed = Box<dyn FnMut(&[u8], &mut Vec<Ranges>)>;

fn ldrobot() -> Feed {
    let mut parser = Parser::new();
    Box::new(move |bytes, out| {
        parser.feed(bytes, |frame, _| {
            out.push(frame.samples.iter().map(|s| u32::from(s.range_mm)).collect());
        });
    })
}

fn rplidar(answer: Answer) -> Feed {
    let mut parser = StreamParser::new(answer);
    Box::new(move |bytes, out| {
        parser.feed(bytes, Stamp::ZERO, |arrived| {
            out.push(arrived.nodes.iter().map(|node| node.dist_q2).collect());
        });
    })
}

fn ydlidar(geometry: Geometry, format: SampleFormat) -> Feed {
    let mut parser = PacketParser::new(geometry, format);
    Box::new(move |bytes, out| {
        parser.feed(bytes, |arrived| {
            out.push(arrived.samples.iter().map(|s| s.range_m.to_bits()).collect());
        });
    })
}

fn hokuyo() -> Feed {
    let mut reader = BlockReader::new(1081);
    Box::new(move |bytes, out| {
        reader.feed(bytes, |_, distances_mm, _| out.push(distances_mm.to_vec()));
    })
}

/// Frames with samples that the emulator sends after these requests.
fn frames(model: Model, requests: &[&[u8]]) -> Vec<Vec<u8>> {
    let mut bench = Bench::new(model);
    let start = bench.now;
    for request in requests {
        bench.device.hear(request, start);
    }
    let mut frames = Vec::new();
    for step in 1..=400 {
        let until = start.plus(Duration::from_millis(10) * step);
        bench.device.advance(until, &mut bench.room, &mut frames);
    }
    let with_samples = frames.into_iter().filter(|frame| frame.n_samples > 0);
    with_samples.map(|frame| frame.bytes).take(300).collect()
}

/// Motor on by speed or by duty, then an express scan in a mode.
fn express(model: Model, mode: u8) -> Vec<Vec<u8>> {
    let mut scan = vec![0xA5, 0x82, 0x05, mode, 0, 0, 0, 0];
    scan.push(scan.iter().fold(0, |xor, byte| xor ^ byte));
    let motor: [&[u8]; 2] =
        [&[0xA5, 0xA8, 0x02, 0x58, 0x02, 0x55], &[0xA5, 0xF0, 0x02, 0x94, 0x02, 0xC1]];
    frames(model, &[motor[0], motor[1], &scan])
}

/// Flips one bit in a fifth of the frames, cuts the stream anywhere, and gives what comes out, with
/// the number of the frames that were spared.
fn damaged(frames: &[Vec<u8>], mut feed: Feed, noise: &mut Noise) -> (Vec<Ranges>, usize) {
    let (mut bytes, mut n_spared) = (Vec::new(), 0);
    for frame in frames {
        let from = bytes.len();
        bytes.extend(frame);
        if noise.chance(0.2) {
            let at = from + below(noise, frame.len());
            bytes[at] ^= 1 << below(noise, 8);
        } else {
            n_spared += 1;
        }
    }
    let mut out = Vec::new();
    while !bytes.is_empty() {
        let chunk: Vec<u8> = bytes.drain(..(1 + below(noise, 700)).min(bytes.len())).collect();
        feed(&chunk, &mut out);
    }
    (out, n_spared)
}

fn below(noise: &mut Noise, n: usize) -> usize {
    usize::try_from(noise.bits() % n as u64).unwrap()
}

/// Everything that comes out of the damaged stream comes out of the clean one too, in this order.
fn judge(name: &str, frames: &[Vec<u8>], parser: impl Fn() -> Feed) {
    let mut clean = Vec::new();
    let mut feed = parser();
    for frame in frames {
        feed(frame, &mut clean);
    }
    assert!(frames.len() > 40 && clean.len() + 2 >= frames.len(), "{name}: {}", clean.len());
    for seed in 0..20 {
        let mut noise = SeedBook::new(seed).stream("bits");
        let (out, n_spared) = damaged(frames, parser(), &mut noise);
        let mut rest = clean.iter();
        let n_false = out.iter().filter(|ranges| !rest.any(|good| good == *ranges)).count();
        assert_eq!(n_false, 0, "{name}, seed {seed}: of {}", out.len());
        // A capsule needs its neighbour, so two are lost with each; a false start costs another.
        assert!(2 * out.len() > n_spared, "{name}, seed {seed}: {} of {n_spared}", out.len());
    }
}

#[test]
fn a_frame_with_a_wrong_bit_gives_not_one_range() {
    judge("ldrobot", &frames(Model::Ld19, &[]), ldrobot);
    for (model, mode, answer) in [
        (Model::RplidarA3, 1, Answer::Legacy),
        (Model::RplidarS1, 3, Answer::Hq),
        (Model::RplidarA3, 2, Answer::Ultra),
        (Model::RplidarS1, 1, Answer::Dense),
        (Model::RplidarS1, 2, Answer::UltraDense),
    ] {
        judge(&format!("{answer:?}"), &express(model, mode), || rplidar(answer));
    }
    let scan: &[&[u8]] = &[&[0xA5, 0x60]];
    let triangle = || ydlidar(Geometry::Triangle, SampleFormat::Distance);
    judge("ydlidar", &frames(Model::YdlidarX4, scan), triangle);
    let of_flight = || ydlidar(Geometry::TimeOfFlight, SampleFormat::IntensityAndDistance);
    judge("ydlidar with intensity", &frames(Model::YdlidarTminiPro, scan), of_flight);
    let scip: &[&[u8]] = &[b"BM\n", b"MD0000108000000\n"];
    judge("hokuyo", &frames(Model::HokuyoUtm30lx, scip), hokuyo);
}
