//! The conversation: quiet it, ask who it is and how it scans, spin it up, scan, look after it.

use super::mode::usual_period;
use super::query::{Query, conf_item, question};
use super::request::{self, request};
use super::stream::{Answer, Arrived, StreamParser};
use super::{DeviceInfo, Health, HealthStatus, Mode, Reply, ReplyReader};
use crate::lidar::head_angle::{HeadAngle, Place};
use crate::lidar::{Counts, Identity, Model, Packet, Request, Sensor, Trouble};
use crate::time::{Mono, Stamp};
use std::collections::VecDeque;
use std::time::Duration;

/// After STOP up to a kernel queue of old samples arrives.
const QUIET_TIME: Duration = Duration::from_millis(100);
/// A request that is not answered by then is sent again.
const REPLY_TIMEOUT: Duration = Duration::from_millis(250);
/// So often is a request sent.
const TRIES: u32 = 2;
/// A reset takes 0.7 s on an A1; the manual says 2 s.
const RESET_TIME: Duration = Duration::from_secs(2);
/// From the request to scan to the first samples; the slowest motors need 2 s.
const SPIN_UP_TIME: Duration = Duration::from_secs(4);
/// Samples that stop coming for this long: the conversation begins anew.
const SILENCE: Duration = Duration::from_millis(1200);
/// The descriptor of a scan may be damaged; after this long samples are looked for without it.
const DESCRIPTOR_TIMEOUT: Duration = Duration::from_millis(300);
/// Duty of the motor, of 1023: about 10 turns/s. The SDK's default.
const MOTOR_PWM: u16 = 660;
/// Speed of the motor, turns/min.
const MOTOR_RPM: u16 = 600;
/// Firmware of the A series from which `GET_LIDAR_CONF` and scan modes exist; later series count
/// their firmware anew and always had them.
const CONF_FIRMWARE: (u8, u8) = (1, 24);
const FIRST_SERIES_WITH_CONF: u8 = 4;
/// Firmware from which express scans exist.
const EXPRESS_FIRMWARE: (u8, u8) = (1, 17);
/// No sensor has more modes; a damaged count is not followed further.
const MOST_MODES: u16 = 16;
/// Sample periods that a sensor can have, µs.
const PERIODS_US: std::ops::RangeInclusive<f64> = 10.0..=2000.0;
/// The SDK's model of the delay: a filter of one sample, and half a sample of measuring.
const DELAY_SAMPLES: f64 = 1.5;

#[derive(Debug, Clone)]
enum Stage {
    /// The port was opened, or the conversation failed: stop whatever runs.
    Opened,
    /// Old samples are thrown away until then.
    Quieting { until: Stamp<Mono> },
    /// Questions, one after the other.
    Asking { asked: Option<(Query, Stamp<Mono>)>, tries: u32 },
    /// The sensor reboots until then.
    Resetting { until: Stamp<Mono> },
    /// A scan was asked for; its descriptor is awaited.
    Scanning { since: Stamp<Mono> },
    /// Samples come, or should.
    Streaming { since: Stamp<Mono> },
}

/// An RPLIDAR of any series.
#[derive(Debug, Clone)]
pub struct Rplidar {
    configured: Model,
    stage: Stage,
    questions: VecDeque<Query>,
    to_send: VecDeque<Request>,
    reader: ReplyReader,
    parser: StreamParser,
    head: HeadAngle,
    packet: Packet,
    info: Option<DeviceInfo>,
    modes: Vec<Mode>,
    typical: Option<u16>,
    mode: Mode,
    identity: Option<Identity>,
    trouble: Option<Trouble>,
    last_frame_at: Option<Stamp<Mono>>,
    counts: Counts,
}

impl Rplidar {
    /// A sensor that should be of this model; what it says itself counts more.
    #[must_use]
    pub fn new(model: Model) -> Self {
        Self {
            configured: model,
            stage: Stage::Opened,
            questions: VecDeque::new(),
            to_send: VecDeque::new(),
            reader: ReplyReader::default(),
            parser: StreamParser::new(Answer::Standard),
            head: HeadAngle::default(),
            packet: Packet::default(),
            info: None,
            modes: Vec::new(),
            typical: None,
            mode: Mode::default(),
            identity: None,
            trouble: None,
            last_frame_at: None,
            counts: Counts::default(),
        }
    }

    /// The ways to scan that the sensor lists; empty for firmware that lists none.
    #[must_use]
    pub fn modes(&self) -> &[Mode] {
        &self.modes
    }

    fn begin_anew(&mut self) {
        self.counts.restarts += 1;
        self.stage = Stage::Opened;
    }

    /// Series of the sensor: what it said, else what was configured.
    fn series(&self) -> u8 {
        let configured = match self.configured {
            Model::RplidarA1 => 1,
            Model::RplidarA2 | Model::RplidarA2m12 => 2,
            Model::RplidarS1 => 6,
            Model::RplidarS2 => 7,
            Model::RplidarS3 => 8,
            Model::RplidarC1 => 4,
            _ => 3,
        };
        self.info.map_or(configured, |info| info.model >> 4)
    }

    fn quiet(&mut self, now: Stamp<Mono>) {
        self.to_send.clear();
        // DTR stops the motor of an A1, and of some A2 adapters, while it is asserted.
        self.to_send.push_back(Request::SetDtr(false));
        self.to_send.push_back(Request::Send(request(request::STOP, &[])));
        self.reader = ReplyReader::default();
        self.questions = VecDeque::from([Query::Health, Query::Info]);
        (self.modes, self.typical, self.mode) = (Vec::new(), None, Mode::default());
        self.stage = Stage::Quieting { until: now.plus(QUIET_TIME) };
    }

    /// The next question, or the scan.
    fn ask(&mut self, now: Stamp<Mono>) {
        let Some(query) = self.questions.front().copied() else {
            self.begin_scan(now);
            return;
        };
        let Stage::Asking { asked, tries } = &mut self.stage else { return };
        if asked.is_some_and(|(_, at)| now.since(at) < REPLY_TIMEOUT) {
            return;
        }
        if *tries < TRIES {
            (*asked, *tries) = (Some((query, now)), *tries + 1);
            self.to_send.push_back(Request::Send(question(query)));
            return;
        }
        // Nobody answers. What is optional is left out.
        if matches!(query, Query::Info | Query::Health) {
            self.begin_anew();
        } else {
            self.next_question();
        }
    }

    fn next_question(&mut self) {
        self.questions.pop_front();
        self.stage = Stage::Asking { asked: None, tries: 0 };
    }

    fn hear(&mut self, reply: Reply, now: Stamp<Mono>) {
        let Stage::Asking { asked: Some((query, _)), .. } = self.stage else { return };
        let is_answer = match (query, reply) {
            (Query::Health, Reply::Health(health)) => {
                if self.judge_health(health, now) {
                    return;
                }
                true
            }
            (Query::Info, Reply::Info(info)) => {
                self.learn(info);
                true
            }
            (Query::SampleRate, Reply::SampleRate { standard_us, express_us }) => {
                let is_express = self.mode.answer == Some(Answer::Legacy);
                let period_us = if is_express { express_us } else { standard_us };
                // The answer has no checksum.
                let is_possible = PERIODS_US.contains(&f64::from(period_us));
                if is_possible {
                    self.mode.sample_period = Duration::from_micros(u64::from(period_us));
                }
                is_possible
            }
            (Query::BoardFlag, Reply::BoardFlag { .. }) => true,
            (query, Reply::Conf { item, value }) => self.configure(query, item, &value),
            _ => false,
        };
        if is_answer {
            self.next_question();
        }
    }

    /// Notes a complaint; true if the sensor must be reset first.
    fn judge_health(&mut self, health: Health, now: Stamp<Mono>) -> bool {
        let code = health.error_code;
        self.trouble = match health.status {
            HealthStatus::Good => None,
            HealthStatus::Warning => Some(format!("the lidar warns of error {code:#06x}")),
            HealthStatus::Error => Some(format!(
                "the lidar reports error {code:#06x} and is being reset; if it does not recover, \
                 see whether its head turns freely and take its power away for a moment"
            )),
        }
        .map(|text| Trouble { text });
        let must_reset = health.status == HealthStatus::Error;
        if must_reset {
            self.counts.restarts += 1;
            self.to_send.push_back(Request::Send(request(request::RESET, &[])));
            self.stage = Stage::Resetting { until: now.plus(RESET_TIME) };
        }
        must_reset
    }

    fn learn(&mut self, info: DeviceInfo) {
        self.info = Some(info);
        // At once: to list the modes takes seconds on a slow line, and whoever waits must know that it is the right one.
        self.identity = Some(self.describe());
        if info.firmware >= CONF_FIRMWARE || info.model >> 4 >= FIRST_SERIES_WITH_CONF {
            self.questions.extend([Query::ModeCount, Query::TypicalMode]);
        } else {
            let is_express = info.firmware >= EXPRESS_FIRMWARE;
            let (answer, name) = if is_express {
                (Answer::Legacy, "Express")
            } else {
                (Answer::Standard, "Standard")
            };
            self.mode = Mode { answer: Some(answer), name: name.into(), ..Mode::default() };
            if is_express {
                self.questions.push_back(Query::SampleRate);
            }
        }
        if (2..=4).contains(&self.series()) {
            self.questions.push_back(Query::BoardFlag);
        }
    }

    /// Takes in an item of the configuration; false if it is not the one that was asked for.
    fn configure(&mut self, query: Query, item: u32, value: &[u8]) -> bool {
        if Some(item) != conf_item(query).map(|(item, _)| item) {
            return false;
        }
        let u16_of = |value: &[u8]| value.first_chunk::<2>().map(|b| u16::from_le_bytes(*b));
        let u32_of = |value: &[u8]| value.first_chunk::<4>().map(|b| u32::from_le_bytes(*b));
        let mode = |modes: &mut Vec<Mode>, id: u16| modes.iter().position(|mode| mode.id == id);
        match query {
            Query::ModeCount => {
                let Some(n) = u16_of(value).filter(|n| (1..=MOST_MODES).contains(n)) else {
                    return false;
                };
                self.modes = (0..n).map(|id| Mode { id, ..Mode::default() }).collect();
                self.questions.extend((0..n).flat_map(|id| {
                    [
                        Query::ModePeriod(id),
                        Query::ModeMaxDistance(id),
                        Query::ModeAnswer(id),
                        Query::ModeName(id),
                    ]
                }));
                true
            }
            Query::TypicalMode => {
                self.typical = u16_of(value);
                true
            }
            Query::ModePeriod(id) => {
                let period_us = u32_of(value).map(|q8| f64::from(q8) / 256.0);
                let Some(us) = period_us.filter(|us| PERIODS_US.contains(us)) else { return false };
                let Some(k) = mode(&mut self.modes, id) else { return true };
                self.modes[k].sample_period = Duration::from_secs_f64(us * 1e-6);
                true
            }
            Query::ModeMaxDistance(id) => {
                let Some(k) = mode(&mut self.modes, id) else { return true };
                self.modes[k].max_distance_m =
                    u32_of(value).map_or(0.0, |q8| f64::from(q8) / 256.0);
                true
            }
            Query::ModeAnswer(id) => {
                let Some(k) = mode(&mut self.modes, id) else { return true };
                self.modes[k].answer = value.first().and_then(|byte| Answer::from_byte(*byte));
                true
            }
            Query::ModeName(id) => {
                let Some(k) = mode(&mut self.modes, id) else { return true };
                let text = value.split(|byte| *byte == 0).next().unwrap_or_default();
                self.modes[k].name = String::from_utf8_lossy(text).into_owned();
                true
            }
            _ => false,
        }
    }

    /// Chooses the mode, starts motor and scan.
    fn begin_scan(&mut self, now: Stamp<Mono>) {
        let usable = |mode: &&Mode| mode.answer.is_some() && !mode.sample_period.is_zero();
        let typical = self.modes.iter().filter(usable).find(|mode| Some(mode.id) == self.typical);
        if let Some(mode) = typical.or_else(|| self.modes.iter().find(usable)) {
            self.mode = mode.clone();
        }
        let answer = *self.mode.answer.get_or_insert(Answer::Standard);
        if self.mode.sample_period.is_zero() {
            let usual = usual_period(answer, self.series());
            self.mode.sample_period = usual.unwrap_or_else(|| self.configured.sample_period());
        }
        self.identity = Some(self.describe());
        match self.series() {
            1 => {}
            2..=5 => self.send(request(request::MOTOR_PWM, &MOTOR_PWM.to_le_bytes())),
            _ => self.send(request(request::MOTOR_SPEED, &MOTOR_RPM.to_le_bytes())),
        }
        let is_plain = answer == Answer::Standard && self.mode.id == 0;
        let scan = if is_plain {
            request(request::SCAN, &[])
        } else {
            request::express_scan(self.mode.id)
        };
        self.send(scan);
        self.reader = ReplyReader::default();
        self.last_frame_at = None;
        self.stage = Stage::Scanning { since: now };
    }

    fn send(&mut self, bytes: Vec<u8>) {
        self.to_send.push_back(Request::Send(bytes));
    }

    fn describe(&self) -> Identity {
        let model = self.info.and_then(|info| model_of(&info)).unwrap_or(self.configured);
        Identity {
            model: Some(model),
            name: model.full_name().to_owned(),
            firmware: self.info.map(|info| format!("{}.{:02}", info.firmware.0, info.firmware.1)),
            serial: self
                .info
                .map(|info| info.serial.iter().map(|byte| format!("{byte:02X}")).collect()),
            mode: Some(self.mode.name.clone()).filter(|name| !name.is_empty()),
            sample_period: Some(self.mode.sample_period).filter(|period| !period.is_zero()),
        }
    }

    fn begin_stream(&mut self, answer: Answer, since: Stamp<Mono>) {
        self.note_parser();
        self.parser = StreamParser::new(answer);
        self.head.forget();
        self.stage = Stage::Streaming { since };
    }

    /// Keeps the counts of a parser that is given up.
    fn note_parser(&mut self) {
        self.counts.frames += self.parser.frames();
        self.counts.checksum_errors += self.parser.refused();
        self.counts.skipped_bytes += self.parser.skipped_bytes();
        self.parser = StreamParser::new(self.parser.answer());
    }

    fn stream(&mut self, bytes: &[u8], now: Stamp<Mono>, on_packet: &mut dyn FnMut(&Packet)) {
        let Self { parser, packet, head, mode, last_frame_at, .. } = self;
        let period = mode.sample_period;
        let answer = parser.answer();
        parser.feed(bytes, now, |arrived: Arrived<'_>| {
            *last_frame_at = Some(now);
            packet.begin(arrived.at, arrived.n_bytes, period);
            packet.delay = period.mul_f64(DELAY_SAMPLES);
            packet.samples.extend(arrived.nodes.iter().map(super::Node::sample));
            let n_samples = u32::try_from(arrived.nodes.len()).unwrap_or(u32::MAX);
            let n_frames = arrived.nodes.len() / answer.frame_samples();
            packet.n_lost = head.n_lost(Place {
                start_deg: arrived.start_deg,
                n_samples,
                at_byte: arrived.at_byte,
                n_bytes: (n_frames * answer.frame_bytes()) as u64,
                is_guarded: answer != Answer::Standard,
            });
            on_packet(packet);
        });
    }

    /// Looks after a scan that does not begin or has ended.
    fn look_after(&mut self, now: Stamp<Mono>) {
        let (since, is_scanning) = match self.stage {
            Stage::Scanning { since } => (since, true),
            Stage::Streaming { since } => (since, false),
            _ => return,
        };
        let waited = now.since(self.last_frame_at.unwrap_or(since));
        let patience = if self.last_frame_at.is_some() { SILENCE } else { SPIN_UP_TIME };
        if waited > patience {
            self.begin_anew();
        } else if is_scanning && waited > DESCRIPTOR_TIMEOUT {
            // The descriptor may have been damaged. Samples are found without it.
            self.begin_stream(self.mode.answer.unwrap_or(Answer::Standard), since);
        }
    }
}

impl Sensor for Rplidar {
    fn restart(&mut self, _now: Stamp<Mono>) {
        self.identity = None;
        self.info = None;
        self.trouble = None;
        self.stage = Stage::Opened;
    }

    fn poll(&mut self, now: Stamp<Mono>) -> Option<Request> {
        if self.to_send.is_empty() {
            self.look_after(now);
            match self.stage {
                Stage::Opened => self.quiet(now),
                Stage::Quieting { until } if now >= until => {
                    self.stage = Stage::Asking { asked: None, tries: 0 };
                    self.ask(now);
                }
                Stage::Resetting { until } if now >= until => self.stage = Stage::Opened,
                Stage::Asking { .. } => self.ask(now),
                _ => {}
            }
        }
        self.to_send.pop_front()
    }

    fn feed(&mut self, bytes: &[u8], now: Stamp<Mono>, on_packet: &mut dyn FnMut(&Packet)) {
        self.counts.bytes += bytes.len() as u64;
        match self.stage {
            Stage::Opened | Stage::Quieting { .. } | Stage::Resetting { .. } => {
                self.counts.skipped_bytes += bytes.len() as u64;
            }
            Stage::Asking { .. } => {
                self.reader.feed(bytes);
                while let Some(reply) = self.reader.next_reply() {
                    self.hear(reply, now);
                }
            }
            Stage::Scanning { since } => {
                self.reader.feed(bytes);
                let Some(Reply::Scan { answer }) = self.reader.next_reply() else { return };
                let answer = Answer::from_byte(answer).unwrap_or(Answer::Standard);
                self.begin_stream(answer, since);
                let rest = self.reader.take_rest();
                self.stream(&rest, now, on_packet);
            }
            Stage::Streaming { .. } => self.stream(bytes, now, on_packet),
        }
    }

    fn farewell(&self) -> Vec<Request> {
        let motor = match self.series() {
            1 => Request::SetDtr(true),
            2..=5 => Request::Send(request(request::MOTOR_PWM, &[0, 0])),
            _ => Request::Send(request(request::MOTOR_SPEED, &[0, 0])),
        };
        vec![Request::Send(request(request::STOP, &[])), motor]
    }

    fn counts(&self) -> Counts {
        Counts {
            frames: self.counts.frames + self.parser.frames(),
            checksum_errors: self.counts.checksum_errors + self.parser.refused(),
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
pub(crate) fn model_of(info: &DeviceInfo) -> Option<Model> {
    /// An A2 with this hardware or later talks at 256,000 bit/s (the SDK's rule).
    const FAST_HARDWARE: u8 = 6;
    Some(match info.model >> 4 {
        1 => Model::RplidarA1,
        2 if info.hardware >= FAST_HARDWARE => Model::RplidarA2m12,
        2 => Model::RplidarA2,
        3 => Model::RplidarA3,
        4 => Model::RplidarC1,
        6 => Model::RplidarS1,
        7 => Model::RplidarS2,
        8 => Model::RplidarS3,
        _ => return None,
    })
}
