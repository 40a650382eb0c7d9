//! The conversation: quiet it, ask for its numbers, light the laser, measure without end.

use super::{Block, BlockReader};
use crate::lidar::{Counts, Identity, Model, Packet, Request, Sample, Sensor, Trouble};
use crate::time::{Mono, Stamp};
use std::collections::VecDeque;
use std::time::Duration;

/// After QT the rest of a scan arrives; `urg_library` waits 140 ms.
const QUIET_TIME: Duration = Duration::from_millis(150);
/// A command that is not answered by then is sent again.
const REPLY_TIMEOUT: Duration = Duration::from_millis(400);
const TRIES: u32 = 2;
/// From the command to the first scan; the motor may have to start.
const SPIN_UP_TIME: Duration = Duration::from_secs(4);
/// Scans that stop coming for this long: the conversation begins anew.
const SILENCE: Duration = Duration::from_millis(1000);
/// So many bad replies in a row: the conversation begins anew.
const MOST_REFUSED: u32 = 3;
/// The sensor's clock has 24 bits, ms.
const CLOCK_WRAP_MS: u32 = 1 << 24;

/// What the sensor says of its geometry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Geometry {
    nearest_mm: u32,
    farthest_mm: u32,
    steps_per_turn: u32,
    first_step: u32,
    last_step: u32,
    front_step: u32,
    turns_per_min: u32,
}

/// Steps have four digits in a command.
const LAST_STEP: u32 = 9_999;
/// As many distances fit into the longest reply that is waited for.
const MOST_STEPS: u32 = 3_200;

impl Geometry {
    /// From the answer to PP.
    fn from_values(values: &[(String, String)]) -> Option<Self> {
        let value = |key: &str| {
            let found = values.iter().find(|(name, _)| name == key);
            found.and_then(|(_, value)| value.trim().parse::<u32>().ok())
        };
        let geometry = Self {
            nearest_mm: value("DMIN")?,
            farthest_mm: value("DMAX")?,
            steps_per_turn: value("ARES")?,
            first_step: value("AMIN")?,
            last_step: value("AMAX")?,
            front_step: value("AFRT")?,
            turns_per_min: value("SCAN")?,
        };
        geometry.is_possible().then_some(geometry)
    }

    fn is_possible(&self) -> bool {
        (100..=10_000).contains(&self.steps_per_turn)
            && self.first_step < self.last_step
            && self.last_step <= LAST_STEP
            && self.last_step - self.first_step < self.steps_per_turn.min(MOST_STEPS)
            && (60..=12_000).contains(&self.turns_per_min)
            && self.nearest_mm < self.farthest_mm
    }

    const fn n_steps(&self) -> u32 {
        self.last_step - self.first_step + 1
    }

    fn sample_period(&self) -> Duration {
        Duration::from_secs(60) / (self.turns_per_min * self.steps_per_turn)
    }

    /// Device angles of all steps, °: the sensor counts them counter-clockwise.
    #[expect(clippy::cast_possible_truncation, reason = "single precision is what a sample holds")]
    fn clockwise_deg(&self) -> Vec<f32> {
        let deg = |step: u32| {
            let from_front = f64::from(self.front_step) - f64::from(step);
            (from_front * 360.0 / f64::from(self.steps_per_turn)).rem_euclid(360.0) as f32
        };
        (self.first_step..=self.last_step).map(deg).collect()
    }
}

/// Commands that are answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Command {
    LeaveTimeMode,
    Version,
    Parameters,
    LaserOn,
}

impl Command {
    const fn text(self) -> &'static str {
        match self {
            Self::LeaveTimeMode => "TM2",
            Self::Version => "VV",
            Self::Parameters => "PP",
            Self::LaserOn => "BM",
        }
    }
}

#[derive(Debug, Clone)]
enum Stage {
    Opened,
    Quieting { until: Stamp<Mono> },
    Asking { asked: Option<Stamp<Mono>>, tries: u32 },
    Streaming { since: Stamp<Mono> },
}

/// A Hokuyo sensor.
#[derive(Debug, Clone)]
pub struct Hokuyo {
    model: Model,
    stage: Stage,
    commands: VecDeque<Command>,
    to_send: VecDeque<Request>,
    reader: BlockReader,
    geometry: Option<Geometry>,
    clockwise_deg: Vec<f32>,
    packet: Packet,
    previous_time_ms: Option<u32>,
    identity: Option<Identity>,
    trouble: Option<Trouble>,
    last_frame_at: Option<Stamp<Mono>>,
    counts: Counts,
}

impl Hokuyo {
    /// A sensor that should be of this model; its own numbers count.
    #[must_use]
    pub fn new(model: Model) -> Self {
        Self {
            model,
            stage: Stage::Opened,
            commands: VecDeque::new(),
            to_send: VecDeque::new(),
            reader: BlockReader::default(),
            geometry: None,
            clockwise_deg: Vec::new(),
            packet: Packet::default(),
            previous_time_ms: None,
            identity: None,
            trouble: None,
            last_frame_at: None,
            counts: Counts::default(),
        }
    }

    fn begin(&mut self, now: Stamp<Mono>) {
        self.reader.reset();
        self.previous_time_ms = None;
        self.last_frame_at = None;
        self.to_send.clear();
        // A line feed ends whatever half command the sensor has heard.
        self.to_send.push_back(Request::Send(b"\nQT\n".to_vec()));
        self.commands = VecDeque::from([
            Command::LeaveTimeMode,
            Command::Version,
            Command::Parameters,
            Command::LaserOn,
        ]);
        self.stage = Stage::Quieting { until: now.plus(QUIET_TIME) };
    }

    fn begin_anew(&mut self, now: Stamp<Mono>) {
        self.counts.restarts += 1;
        self.begin(now);
    }

    fn ask(&mut self, now: Stamp<Mono>) {
        let Some(command) = self.commands.front().copied() else {
            self.measure(now);
            return;
        };
        let Stage::Asking { asked, tries } = &mut self.stage else { return };
        if asked.is_some_and(|at| now.since(at) < REPLY_TIMEOUT) {
            return;
        }
        if *tries < TRIES {
            (*asked, *tries) = (Some(now), *tries + 1);
            self.to_send.push_back(Request::Send(format!("{}\n", command.text()).into_bytes()));
        } else if command == Command::LeaveTimeMode {
            self.next_command();
        } else {
            self.begin_anew(now);
        }
    }

    fn next_command(&mut self) {
        self.commands.pop_front();
        self.stage = Stage::Asking { asked: None, tries: 0 };
    }

    fn measure(&mut self, now: Stamp<Mono>) {
        let Some(geometry) = self.geometry else {
            self.begin_anew(now);
            return;
        };
        self.reader.expect(geometry.n_steps() as usize);
        self.clockwise_deg = geometry.clockwise_deg();
        let (first, last) = (geometry.first_step, geometry.last_step);
        let command = format!("MD{first:04}{last:04}01000\n");
        self.to_send.push_back(Request::Send(command.into_bytes()));
        self.stage = Stage::Streaming { since: now };
    }

    /// Takes in the answer to a command.
    fn hear(&mut self, echo: &str, state: [u8; 2], values: &[(String, String)]) {
        if matches!(self.stage, Stage::Streaming { .. }) {
            self.judge(state);
            return;
        }
        let Some(command) = self.commands.front().copied() else { return };
        if !matches!(self.stage, Stage::Asking { .. }) || echo != command.text() {
            return;
        }
        let is_done = match command {
            Command::LeaveTimeMode => true,
            Command::Version => {
                self.identity = Some(self.describe(values));
                true
            }
            Command::Parameters => {
                self.geometry = Geometry::from_values(values);
                self.geometry.is_some()
            }
            // 02: the laser is on already.
            Command::LaserOn => {
                self.judge(state);
                matches!(&state, b"00" | b"02")
            }
        };
        if is_done {
            self.next_command();
        }
    }

    /// States that say what is wrong.
    fn judge(&mut self, state: [u8; 2]) {
        let text = match &state {
            b"00" | b"02" | b"98" | b"99" => None,
            b"10" => Some("the lidar does not light its laser".to_owned()),
            [b'2'..=b'4', _] => {
                Some("the lidar has stopped its scan; see whether its head turns freely".to_owned())
            }
            [b'5'..=b'9', _] => Some(
                "the lidar reports a fault; take its power away for a moment, then have it \
                 repaired"
                    .to_owned(),
            ),
            _ => None,
        };
        self.trouble = text.map(|text| {
            let [a, b] = state.map(char::from);
            Trouble { text: format!("{text} (state {a}{b})") }
        });
    }

    fn describe(&self, values: &[(String, String)]) -> Identity {
        let value = |key: &str| {
            let found = values.iter().find(|(name, _)| name == key);
            found.map(|(_, value)| value.trim().to_owned())
        };
        let product = value("PROD").unwrap_or_default();
        let model = model_of(values);
        Identity {
            model: model.or(Some(self.model)),
            name: format!("Hokuyo {product}"),
            firmware: value("FIRM"),
            serial: value("SERI"),
            mode: Some("MD".to_owned()),
            // It looks through a part of the turn only.
            sample_period: None,
        }
    }

    fn push_scan(
        &mut self,
        time_ms: u32,
        n_bytes: usize,
        distances_mm: &[u32],
        now: Stamp<Mono>,
    ) -> bool {
        let Some(geometry) = self.geometry else { return false };
        if !matches!(self.stage, Stage::Streaming { .. }) {
            return false;
        }
        self.last_frame_at = Some(now);
        self.trouble = None;
        let packet = &mut self.packet;
        packet.begin(now, n_bytes, geometry.sample_period());
        packet.ends_turn = true;
        packet.n_idle = geometry.steps_per_turn - geometry.n_steps();
        let is_range = |mm: u32| (geometry.nearest_mm..=geometry.farthest_mm).contains(&mm);
        packet.samples.extend(self.clockwise_deg.iter().zip(distances_mm).map(|(deg, mm)| {
            // Below the least distance stand numbers of errors.
            let range_mm = if is_range(*mm) { *mm } else { 0 };
            Sample { clockwise_deg: *deg, range_m: metres(range_mm), intensity: 0 }
        }));
        if let Some(previous_ms) = self.previous_time_ms {
            let elapsed_ms = time_ms.wrapping_sub(previous_ms) % CLOCK_WRAP_MS;
            let turn_ms = 60_000 / geometry.turns_per_min.max(1);
            let n_turns = (elapsed_ms + turn_ms / 2) / turn_ms.max(1);
            packet.n_lost = n_turns.saturating_sub(1).saturating_mul(geometry.steps_per_turn);
            packet.device_elapsed_s = Some(f64::from(elapsed_ms) * 1e-3);
        }
        self.previous_time_ms = Some(time_ms);
        true
    }
}

/// The model that a sensor says it is.
pub(crate) fn model_of(values: &[(String, String)]) -> Option<Model> {
    let value = |key: &str| values.iter().find(|(name, _)| name == key).map(|(_, value)| value);
    let product = value("PROD")?;
    let names = [("UTM-30LX", Model::HokuyoUtm30lx), ("URG-04LX", Model::HokuyoUrg04lx)];
    let known = names.into_iter().find(|(name, _)| product.contains(name)).map(|(_, model)| model);
    // Whatever else speaks this protocol tells its geometry and its rate.
    let speaks_scip2 = value("PROT").is_some_and(|protocol| protocol.contains("SCIP 2"));
    known.or(speaks_scip2.then_some(Model::HokuyoScip2))
}

#[expect(clippy::cast_precision_loss, reason = "eighteen bits fit single precision")]
fn metres(mm: u32) -> f32 {
    mm as f32 * 1e-3
}

impl Sensor for Hokuyo {
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
                    self.reader.reset();
                    self.stage = Stage::Asking { asked: None, tries: 0 };
                    self.ask(now);
                }
                Stage::Asking { .. } => self.ask(now),
                Stage::Streaming { since } => {
                    let waited = now.since(self.last_frame_at.unwrap_or(since));
                    let is_started = self.last_frame_at.is_some();
                    let is_silent = waited > if is_started { SILENCE } else { SPIN_UP_TIME };
                    if is_silent || self.reader.refused_in_a_row() >= MOST_REFUSED {
                        self.begin_anew(now);
                    }
                }
                Stage::Quieting { .. } => {}
            }
        }
        self.to_send.pop_front()
    }

    fn feed(&mut self, bytes: &[u8], now: Stamp<Mono>, on_packet: &mut dyn FnMut(&Packet)) {
        self.counts.bytes += bytes.len() as u64;
        let mut reader = std::mem::take(&mut self.reader);
        reader.feed(bytes, |block, distances_mm, n_bytes_after| match block {
            Block::Scan { time_ms, n_bytes } => {
                if self.push_scan(time_ms, n_bytes + n_bytes_after, distances_mm, now) {
                    on_packet(&self.packet);
                }
            }
            Block::Answer { echo, state, values } => self.hear(&echo, state, &values),
        });
        self.reader = reader;
        if let Some(geometry) = self.geometry {
            self.reader.expect(geometry.n_steps() as usize);
        }
    }

    fn farewell(&self) -> Vec<Request> {
        vec![Request::Send(b"QT\n".to_vec())]
    }

    fn counts(&self) -> Counts {
        Counts {
            frames: self.reader.scans(),
            checksum_errors: self.reader.refused(),
            skipped_bytes: self.reader.skipped_bytes(),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_geometry_that_no_command_can_ask_for_is_refused() {
        // A URG-04LX: steps of the turn, first, last, front.
        let geometry = |[steps_per_turn, first_step, last_step]: [u32; 3]| Geometry {
            nearest_mm: 20,
            farthest_mm: 5600,
            steps_per_turn,
            first_step,
            last_step,
            front_step: 384,
            turns_per_min: 600,
        };
        assert!(geometry([1024, 44, 725]).is_possible());
        for wrong in [
            [100, u32::MAX - 5, u32::MAX],
            [1024, 20_000, 20_500],
            [10_000, 0, 9_000],
            [1024, 0, 1024],
            [1024, 725, 44],
        ] {
            assert!(!geometry(wrong).is_possible(), "{wrong:?}");
        }
    }
}
