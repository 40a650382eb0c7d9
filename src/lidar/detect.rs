//! Finds out which sensor is on a line, and at which speed.
//!
//! ```text
//! for every line speed:  listen · ask as an RPLIDAR · as a YDLIDAR · as a Hokuyo
//! ```
//! Sensors that only talk are known by whole frames with good checksums, the others by their
//! answer. A sensor at another speed gives garbage, which is neither.

use super::hokuyo::{Block, BlockReader};
use super::rplidar::{Reply, ReplyReader};
use super::ydlidar::{Geometry, PacketParser, SampleFormat};
use super::{Model, ldrobot};
use crate::time::{Mono, Stamp};
use std::collections::VecDeque;
use std::time::Duration;

/// So many good frames of a sensor that only talks make it known.
const FRAMES: u64 = 4;
/// The slowest talker sends four frames in 50 ms; the rest is the system's delay.
const LISTENING: Duration = Duration::from_millis(150);
/// Time to answer.
const ANSWERING: Duration = Duration::from_millis(200);
/// Time in which a sensor that was told to stop sends what it still has.
const STOPPING: Duration = Duration::from_millis(80);
/// Between 4,500 and 5,000 samples/s: an LD06 or LD19, or an STL-19P.
const STL19P_FROM_HZ: f64 = 4_750.0;
/// The speed of the STL-27L.
const STL27L_BAUD: u32 = 921_600;

/// What is to be done on the line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Probe {
    /// Go to this line speed, bit/s.
    SetBaud(u32),
    /// Send these bytes.
    Send(Vec<u8>),
}

/// A sensor that made itself known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Found {
    /// What it is.
    pub model: Model,
    /// The speed of its line, bit/s.
    pub baud: u32,
}

/// A sensor that told a name that no driver knows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stranger {
    /// Maker and number.
    pub name: String,
    /// The speed of its line, bit/s.
    pub baud: u32,
}

#[derive(Debug, Clone)]
enum Step {
    Do(Probe),
    Wait(Duration),
    /// The question was asked; answers before it mean nothing.
    Expect(Asked),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asked {
    Nothing,
    Rplidar,
    Ydlidar,
    Hokuyo,
}

/// The search, without input and output: it says what to send and is told what came.
#[derive(Debug, Clone)]
pub struct Detector {
    steps: VecDeque<Step>,
    waits_until: Option<Stamp<Mono>>,
    baud: u32,
    asked: Asked,
    ldrobot: ldrobot::Parser,
    ydlidar: PacketParser,
    replies: ReplyReader,
    scip: BlockReader,
    stranger: Option<Stranger>,
}

impl Detector {
    /// A search at this line speed, or at all usual ones.
    #[must_use]
    pub fn new(baud: Option<u32>) -> Self {
        const USUAL: [u32; 10] = [
            230_400, 115_200, 256_000, 921_600, 460_800, 1_000_000, 128_000, 512_000, 153_600,
            19_200,
        ];
        let steps = match baud {
            Some(baud) => steps_at(baud),
            None => USUAL.into_iter().flat_map(steps_at).collect(),
        };
        Self {
            steps: steps.into(),
            waits_until: None,
            baud: 0,
            asked: Asked::Nothing,
            ldrobot: ldrobot::Parser::new(),
            ydlidar: PacketParser::new(Geometry::Triangle, SampleFormat::Distance),
            replies: ReplyReader::default(),
            scip: BlockReader::default(),
            stranger: None,
        }
    }

    /// Who has answered with a name that no driver knows; that ends the search.
    #[must_use]
    pub const fn stranger(&self) -> Option<&Stranger> {
        self.stranger.as_ref()
    }

    /// True once everything was tried or a stranger has answered.
    #[must_use]
    pub fn is_exhausted(&self) -> bool {
        self.steps.is_empty() && self.waits_until.is_none()
    }

    /// What is to be done now; called until it is `None`.
    pub fn poll(&mut self, now: Stamp<Mono>) -> Option<Probe> {
        if self.waits_until.is_some_and(|until| now < until) {
            return None;
        }
        self.waits_until = None;
        loop {
            match self.steps.pop_front()? {
                Step::Do(probe) => {
                    if let Probe::SetBaud(baud) = probe {
                        self.baud = baud;
                        self.forget();
                    }
                    return Some(probe);
                }
                Step::Expect(asked) => {
                    self.asked = asked;
                    self.replies = ReplyReader::default();
                    self.scip = BlockReader::default();
                }
                Step::Wait(time) => {
                    self.waits_until = Some(now.plus(time));
                    return None;
                }
            }
        }
    }

    /// Takes in what came; says whose it is.
    pub fn feed(&mut self, bytes: &[u8]) -> Option<Found> {
        let model = self.talker(bytes).or_else(|| match self.asked {
            Asked::Nothing => None,
            Asked::Rplidar | Asked::Ydlidar => self.answerer(bytes),
            Asked::Hokuyo => self.hokuyo(bytes),
        })?;
        Some(Found { model, baud: self.baud })
    }

    fn forget(&mut self) {
        self.asked = Asked::Nothing;
        self.ldrobot = ldrobot::Parser::new();
        self.ydlidar = PacketParser::new(Geometry::Triangle, SampleFormat::Distance);
    }

    /// A sensor that talks without being asked.
    fn talker(&mut self, bytes: &[u8]) -> Option<Model> {
        let mut samples_hz = 0.0;
        self.ldrobot.feed(bytes, |frame, _| {
            let step_deg = f64::from(frame.span_cdeg()) / 100.0 / 11.0;
            samples_hz = f64::from(frame.speed_deg_per_s) / step_deg.max(1e-3);
        });
        if self.ldrobot.stats().frames >= FRAMES && samples_hz > 0.0 {
            let slow = if samples_hz > STL19P_FROM_HZ { Model::Stl19p } else { Model::Ld19 };
            return Some(if self.baud == STL27L_BAUD { Model::Stl27l } else { slow });
        }
        self.ydlidar.feed(bytes, |_| {});
        let is_x2 = self.ydlidar.frames() >= FRAMES && self.asked == Asked::Nothing;
        // Two-way models that still scan are asked for their name.
        (is_x2 && self.baud == Model::YdlidarX2.default_baud()).then_some(Model::YdlidarX2)
    }

    /// An RPLIDAR or a YDLIDAR that was asked for its name.
    fn answerer(&mut self, bytes: &[u8]) -> Option<Model> {
        self.replies.feed(bytes);
        while let Some(reply) = self.replies.next_reply() {
            let Reply::Info(info) = reply else { continue };
            let (maker, model) = if self.asked == Asked::Rplidar {
                ("RPLIDAR", super::rplidar::model_of(&info))
            } else {
                ("YDLIDAR", super::ydlidar::model_of(&info))
            };
            if model.is_none() {
                self.give_up(format!("{maker} model {}", info.model));
            }
            return model;
        }
        None
    }

    fn hokuyo(&mut self, bytes: &[u8]) -> Option<Model> {
        let (mut model, mut product) = (None, None);
        self.scip.feed(bytes, |block, _, _| {
            if let Block::Answer { values, .. } = block {
                model = model.or_else(|| super::hokuyo::model_of(&values));
                product = values.into_iter().find(|(key, _)| key == "PROD").or(product.take());
            }
        });
        if let (None, Some((_, product))) = (model, product) {
            self.give_up(format!("Hokuyo {product}"));
        }
        model
    }

    /// Somebody has answered, and no other speed will make him known.
    fn give_up(&mut self, name: String) {
        self.stranger = Some(Stranger { name, baud: self.baud });
        self.steps.clear();
        self.waits_until = None;
    }
}

/// What is done at one line speed.
fn steps_at(baud: u32) -> Vec<Step> {
    let send = |bytes: &[u8]| Step::Do(Probe::Send(bytes.to_vec()));
    let mut steps = vec![Step::Do(Probe::SetBaud(baud)), Step::Wait(LISTENING)];
    let models = || Model::ALL.into_iter().filter(|model| model.default_baud() == baud);
    let has = |family| baud == 19_200 || models().any(|model| model.family() == family);
    if has(super::Family::Rplidar) {
        steps.extend([
            send(&[0xA5, 0x25]),
            Step::Wait(STOPPING),
            Step::Expect(Asked::Rplidar),
            send(&[0xA5, 0x50]),
            Step::Wait(ANSWERING),
        ]);
    }
    if has(super::Family::Ydlidar) {
        steps.extend([
            send(&[0xA5, 0x00]),
            send(&[0xA5, 0x65]),
            Step::Wait(STOPPING),
            Step::Expect(Asked::Ydlidar),
            send(&[0xA5, 0x90]),
            Step::Wait(ANSWERING),
        ]);
    }
    if has(super::Family::Hokuyo) {
        steps.extend([
            send(b"\nQT\n"),
            Step::Wait(STOPPING),
            Step::Expect(Asked::Hokuyo),
            send(b"VV\n"),
            Step::Wait(ANSWERING),
        ]);
    }
    steps
}
