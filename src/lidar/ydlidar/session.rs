//! The conversation: stop it, ask who it is, start it, look after it.

use super::{Arrived, Geometry, PacketParser, SampleFormat};
use crate::lidar::head_angle::{HeadAngle, Place};
use crate::lidar::rplidar::{DeviceInfo, Health, HealthStatus, Reply, ReplyReader};
use crate::lidar::{Counts, Identity, Model, Packet, Request, Sensor, Trouble};
use crate::time::{Mono, Stamp};
use std::collections::VecDeque;
use std::time::Duration;

/// Commands.
const FORCE_STOP: [u8; 2] = [0xA5, 0x00];
const STOP: [u8; 2] = [0xA5, 0x65];
const SCAN: [u8; 2] = [0xA5, 0x60];

/// After a stop old packets arrive; the SDK waits half a second.
const QUIET_TIME: Duration = Duration::from_millis(300);
/// A question that is not answered by then is asked once more, then left out.
const REPLY_TIMEOUT: Duration = Duration::from_millis(250);
const TRIES: u32 = 2;
/// From the command to the first packet; motors need up to 2 s.
const SPIN_UP_TIME: Duration = Duration::from_secs(4);
/// Packets that stop coming for this long: the conversation begins anew.
const SILENCE: Duration = Duration::from_millis(1200);

/// What is asked for. The two numbers of the health stand in the SDK and in the manuals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Query {
    Info,
    Health,
    HealthOfManuals,
    SampleRate,
}

impl Query {
    const fn bytes(self) -> [u8; 2] {
        let command = match self {
            Self::Info => 0x90,
            Self::HealthOfManuals => 0x91,
            Self::Health => 0x92,
            Self::SampleRate => 0xD1,
        };
        [0xA5, command]
    }
}

#[derive(Debug, Clone)]
enum Stage {
    Opened,
    Quieting { until: Stamp<Mono> },
    Asking { asked: Option<(Query, Stamp<Mono>)>, tries: u32 },
    Streaming { since: Stamp<Mono> },
}

/// A YDLIDAR sensor.
#[derive(Debug, Clone)]
pub struct Ydlidar {
    model: Model,
    stage: Stage,
    questions: VecDeque<Query>,
    to_send: VecDeque<Request>,
    reader: ReplyReader,
    parser: PacketParser,
    head: HeadAngle,
    packet: Packet,
    period: Duration,
    identity: Option<Identity>,
    trouble: Option<Trouble>,
    last_frame_at: Option<Stamp<Mono>>,
    counts: Counts,
}

impl Ydlidar {
    /// A sensor of this model.
    #[must_use]
    pub fn new(model: Model) -> Self {
        let format = match model {
            Model::YdlidarTminiPro => SampleFormat::IntensityAndDistance,
            _ => SampleFormat::Distance,
        };
        Self {
            model,
            stage: Stage::Opened,
            questions: VecDeque::new(),
            to_send: VecDeque::new(),
            reader: ReplyReader::default(),
            parser: PacketParser::new(Geometry::of(model), format),
            head: HeadAngle::default(),
            packet: Packet::default(),
            period: model.sample_period(),
            identity: None,
            trouble: None,
            last_frame_at: None,
            counts: Counts::default(),
        }
    }

    /// One-way models answer nothing.
    fn listens(&self) -> bool {
        self.model != Model::YdlidarX2
    }

    fn begin(&mut self, now: Stamp<Mono>) {
        self.parser.reset();
        self.head.forget();
        self.reader = ReplyReader::default();
        self.last_frame_at = None;
        self.to_send.clear();
        self.to_send.push_back(Request::SetDtr(true));
        if !self.listens() {
            self.stage = Stage::Streaming { since: now };
            return;
        }
        self.to_send.extend([FORCE_STOP, STOP].map(|bytes| Request::Send(bytes.to_vec())));
        self.questions = VecDeque::from([Query::Info, Query::Health]);
        if self.model != Model::YdlidarX4 {
            self.questions.push_back(Query::SampleRate);
        }
        self.stage = Stage::Quieting { until: now.plus(QUIET_TIME) };
    }

    fn ask(&mut self, now: Stamp<Mono>) {
        let Some(query) = self.questions.front().copied() else {
            self.to_send.push_back(Request::Send(SCAN.to_vec()));
            self.stage = Stage::Streaming { since: now };
            return;
        };
        let Stage::Asking { asked, tries } = &mut self.stage else { return };
        if asked.is_some_and(|(_, at)| now.since(at) < REPLY_TIMEOUT) {
            return;
        }
        if *tries < TRIES {
            (*asked, *tries) = (Some((query, now)), *tries + 1);
            self.to_send.push_back(Request::Send(query.bytes().to_vec()));
            return;
        }
        if query == Query::Health {
            self.questions.insert(1, Query::HealthOfManuals);
        }
        self.next_question();
    }

    fn next_question(&mut self) {
        self.questions.pop_front();
        self.stage = Stage::Asking { asked: None, tries: 0 };
    }

    fn hear(&mut self, reply: &Reply) {
        let Stage::Asking { asked: Some((query, _)), .. } = self.stage else { return };
        match (query, reply) {
            (Query::Info, Reply::Info(info)) => self.identity = Some(self.describe(info)),
            (Query::Health | Query::HealthOfManuals, Reply::Health(health)) => {
                self.trouble = complaint(*health);
            }
            (Query::SampleRate, Reply::Setting(code)) => {
                if let Some(rate_hz) = sample_rate_hz(self.model, *code) {
                    self.period = Duration::from_secs(1) / rate_hz;
                    if let Some(identity) = &mut self.identity {
                        identity.sample_period = Some(self.period);
                    }
                }
            }
            _ => return,
        }
        self.next_question();
    }

    fn describe(&self, info: &DeviceInfo) -> Identity {
        let model = model_of(info);
        let name = model.map_or_else(
            || format!("YDLIDAR model {}", info.model),
            |model| model.full_name().to_owned(),
        );
        let (major, minor) = info.firmware;
        Identity {
            model: model.or(Some(self.model)),
            name,
            firmware: Some(format!("{major}.{minor}")),
            serial: Some(info.serial.iter().map(|digit| char::from(b'0' + digit % 10)).collect()),
            mode: None,
            sample_period: None,
        }
    }

    fn stream(&mut self, bytes: &[u8], now: Stamp<Mono>, on_packet: &mut dyn FnMut(&Packet)) {
        let Self { parser, packet, head, last_frame_at, period, .. } = self;
        parser.feed(bytes, |arrived: Arrived<'_>| {
            *last_frame_at = Some(now);
            packet.begin(now, arrived.n_bytes, *period);
            packet.samples.extend_from_slice(arrived.samples);
            let n_samples = u32::try_from(arrived.samples.len()).unwrap_or(u32::MAX);
            packet.n_lost = head.n_lost(Place {
                start_deg: arrived.start_deg,
                n_samples,
                at_byte: arrived.at_byte,
                n_bytes: arrived.own_bytes as u64,
                is_guarded: true,
            });
            on_packet(packet);
        });
        if self.identity.is_none() && self.last_frame_at.is_some() {
            let name = self.model.full_name().to_owned();
            self.identity = Some(Identity { model: Some(self.model), name, ..Identity::default() });
        }
    }
}

impl Sensor for Ydlidar {
    fn restart(&mut self, _now: Stamp<Mono>) {
        self.identity = None;
        self.trouble = None;
        self.stage = Stage::Opened;
    }

    fn poll(&mut self, now: Stamp<Mono>) -> Option<Request> {
        if self.to_send.is_empty() {
            match self.stage {
                Stage::Opened => self.begin(now),
                Stage::Quieting { until } if now >= until => {
                    self.stage = Stage::Asking { asked: None, tries: 0 };
                    self.ask(now);
                }
                Stage::Asking { .. } => self.ask(now),
                Stage::Streaming { since } => {
                    let waited = now.since(self.last_frame_at.unwrap_or(since));
                    let is_started = self.last_frame_at.is_some();
                    if waited > if is_started { SILENCE } else { SPIN_UP_TIME } {
                        self.counts.restarts += 1;
                        self.begin(now);
                    }
                }
                Stage::Quieting { .. } => {}
            }
        }
        self.to_send.pop_front()
    }

    fn feed(&mut self, bytes: &[u8], now: Stamp<Mono>, on_packet: &mut dyn FnMut(&Packet)) {
        self.counts.bytes += bytes.len() as u64;
        match self.stage {
            Stage::Opened | Stage::Quieting { .. } => {
                self.counts.skipped_bytes += bytes.len() as u64;
            }
            Stage::Asking { .. } => {
                self.reader.feed(bytes);
                while let Some(reply) = self.reader.next_reply() {
                    self.hear(&reply);
                }
            }
            Stage::Streaming { .. } => self.stream(bytes, now, on_packet),
        }
    }

    fn farewell(&self) -> Vec<Request> {
        let stop = self.listens().then(|| Request::Send(STOP.to_vec()));
        stop.into_iter().chain([Request::SetDtr(false)]).collect()
    }

    fn counts(&self) -> Counts {
        Counts {
            frames: self.parser.frames(),
            checksum_errors: self.parser.refused(),
            skipped_bytes: self.counts.skipped_bytes + self.parser.skipped_bytes(),
            ..self.counts
        }
    }

    fn identity(&self) -> Option<&Identity> {
        self.identity.as_ref()
    }

    fn trouble(&self) -> Option<&Trouble> {
        self.trouble.as_ref()
    }
}

/// The model that a sensor says it is.
pub(crate) const fn model_of(info: &DeviceInfo) -> Option<Model> {
    Some(match info.model {
        // The G4PRO and the T-mini Plus have the numbers of their sisters.
        5 | 7 => Model::YdlidarG4,
        6 => Model::YdlidarX4,
        100 => Model::YdlidarTg15,
        101 => Model::YdlidarTg30,
        102 => Model::YdlidarTg50,
        150 | 151 => Model::YdlidarTminiPro,
        _ => return None,
    })
}

fn complaint(health: Health) -> Option<Trouble> {
    let code = health.error_code;
    (health.status != HealthStatus::Good).then(|| Trouble {
        text: format!(
            "the lidar reports error {code:#06x}; see whether its head turns freely and take its \
             power away for a moment"
        ),
    })
}

/// Samples per second behind a code of `A5 D1`.
fn sample_rate_hz(model: Model, code: u8) -> Option<u32> {
    let rates: [u32; 4] = match model {
        Model::YdlidarG4 => [4_000, 8_000, 9_000, 10_000],
        Model::YdlidarTg15 | Model::YdlidarTg30 | Model::YdlidarTg50 => {
            [10_000, 16_000, 18_000, 20_000]
        }
        _ => return None,
    };
    rates.get(usize::from(code)).copied()
}
