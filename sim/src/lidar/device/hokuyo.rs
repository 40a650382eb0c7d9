//! Hokuyo: SCIP 2.0 as a URG-04LX, a UTM-30LX or one of their sisters speaks it.

#[cfg(test)]
mod oracle;

use super::{Device, Frame, Mishap, whole};
use crate::lidar::{LidarModel, Scene};
use std::time::Duration;
use stockpilot::stats::SeedBook;
use stockpilot::time::{Mono, Stamp};

const THINKING: Duration = Duration::from_millis(1);
/// Characters of a data line before its sum.
const LINE_CHARS: usize = 64;

/// The sensor's geometry, as PP tells it.
#[derive(Debug, Clone, Copy)]
struct Geometry {
    product: &'static str,
    nearest_mm: u32,
    farthest_mm: u32,
    steps_per_turn: u32,
    last_step: u32,
    front_step: u32,
    first_step: u32,
    turns_per_min: u32,
}

const URG_04LX: Geometry = Geometry {
    product: "SOKUIKI Sensor URG-04LX-UG01(Simple-URG)",
    nearest_mm: 20,
    farthest_mm: 5600,
    steps_per_turn: 1024,
    first_step: 44,
    last_step: 725,
    front_step: 384,
    turns_per_min: 600,
};
/// One whose name the service does not know, with the steps of a UHG-08LX: it must be believed.
const SISTER: Geometry = Geometry {
    product: "SOKUIKI Sensor UHG-08LX",
    nearest_mm: 30,
    farthest_mm: 11_000,
    steps_per_turn: 1024,
    first_step: 0,
    last_step: 768,
    front_step: 384,
    turns_per_min: 900,
};
const UTM_30LX: Geometry = Geometry {
    product: "SOKUIKI Sensor TOP-URG UTM-30LX",
    nearest_mm: 23,
    farthest_mm: 60_000,
    steps_per_turn: 1440,
    first_step: 0,
    last_step: 1080,
    front_step: 540,
    turns_per_min: 2400,
};

/// A measurement that was asked for.
#[derive(Debug, Clone)]
struct Measuring {
    /// The command without its count.
    command: String,
    first_step: u32,
    last_step: u32,
    /// Scans that are still to come; 0 for no end.
    n_left: u32,
    next_at: Stamp<Mono>,
}

/// The firmware.
#[derive(Debug)]
pub(super) struct Hokuyo {
    geometry: Geometry,
    booted: Stamp<Mono>,
    inbox: Vec<u8>,
    answers: Vec<Frame>,
    is_lit: bool,
    has_time_mode: bool,
    measuring: Option<Measuring>,
    is_held: bool,
    /// State that it answers with once something inside has failed.
    fault: Option<&'static str>,
}

impl Hokuyo {
    pub(super) fn new(_model: &LidarModel, steps: u32, seeds: SeedBook, now: Stamp<Mono>) -> Self {
        let before = seeds.stream("lidar.power_up").between(0.0, 3600.0);
        Self {
            geometry: match steps {
                682 => URG_04LX,
                1081 => UTM_30LX,
                _ => SISTER,
            },
            booted: now.minus(Duration::from_secs_f64(before)),
            inbox: Vec::new(),
            answers: Vec::new(),
            is_lit: false,
            has_time_mode: false,
            measuring: None,
            is_held: false,
            fault: None,
        }
    }

    fn turn(&self) -> Duration {
        Duration::from_secs(60) / self.geometry.turns_per_min
    }

    fn act(&mut self, line: &str, now: Stamp<Mono>) {
        if line.is_empty() {
            return;
        }
        let state = if self.has_time_mode && !line.starts_with("TM") {
            "0E"
        } else {
            self.carry_out(line, now)
        };
        let mut text = format!("{line}\n{state}{}\n", sum(state));
        if state == "00" {
            self.add_values(line, &mut text);
        }
        if line == "TM1" {
            push_line(&mut text, &coded(self.time_ms(now), 4));
        }
        text.push('\n');
        self.answers.push(Frame::answer(text.into_bytes(), now.plus(THINKING)));
    }

    /// Does what a command says; gives its state.
    fn carry_out(&mut self, line: &str, now: Stamp<Mono>) -> &'static str {
        match line {
            "VV" | "PP" | "II" | "TM1" => "00",
            "BM" if self.is_held => "27",
            "BM" if self.fault.is_some() => self.fault.unwrap_or("50"),
            "BM" if self.is_lit => "02",
            "BM" => {
                self.is_lit = true;
                "00"
            }
            "QT" | "RS" => {
                (self.is_lit, self.measuring) = (false, None);
                "00"
            }
            "TM0" if self.measuring.is_some() => "10",
            "TM0" => {
                self.has_time_mode = true;
                "00"
            }
            "TM2" if self.has_time_mode => {
                self.has_time_mode = false;
                "00"
            }
            "TM2" => "03",
            _ if line.starts_with("MD") => self.begin(line, now),
            _ => "0E",
        }
    }

    fn begin(&mut self, line: &str, now: Stamp<Mono>) -> &'static str {
        let field = |from: usize, to: usize| line.get(from..to).and_then(|f| f.parse::<u32>().ok());
        let (Some(first_step), Some(last_step), Some(n_left)) =
            (field(2, 6), field(6, 10), field(13, 15))
        else {
            return "0C";
        };
        if first_step > last_step {
            return "05";
        }
        if last_step > self.geometry.last_step {
            return "04";
        }
        self.is_lit = true;
        let next_at = now.plus(self.turn());
        let command = line[..13].to_owned();
        self.measuring = Some(Measuring { command, first_step, last_step, n_left, next_at });
        "00"
    }

    fn add_values(&self, line: &str, text: &mut String) {
        let g = &self.geometry;
        let mut value = |name: &str, value: &str| {
            let said = format!("{name}:{value}");
            text.push_str(&format!("{said};{}\n", sum(&said)));
        };
        match line {
            "VV" => {
                value("VEND", "Hokuyo Automatic Co., Ltd.");
                value("PROD", g.product);
                value("FIRM", "1.18.01");
                value("PROT", "SCIP 2.0");
                value("SERI", "H1234567");
            }
            "PP" => {
                value("MODL", g.product);
                for (name, number) in [
                    ("DMIN", g.nearest_mm),
                    ("DMAX", g.farthest_mm),
                    ("ARES", g.steps_per_turn),
                    ("AMIN", g.first_step),
                    ("AMAX", g.last_step),
                    ("AFRT", g.front_step),
                    ("SCAN", g.turns_per_min),
                ] {
                    value(name, &number.to_string());
                }
            }
            "II" => {
                value("MODL", g.product);
                value("LASR", if self.is_lit { "ON" } else { "OFF" });
                value(
                    "STAT",
                    if self.fault.is_some() { "Sensor fault" } else { "Sensor works well." },
                );
            }
            _ => {}
        }
    }

    fn time_ms(&self, at: Stamp<Mono>) -> u32 {
        u32::try_from(at.since(self.booted).as_millis() % (1 << 24)).unwrap_or(0)
    }

    /// One scan, if it is complete by `until`.
    fn scan(&mut self, until: Stamp<Mono>, scene: &mut dyn Scene) -> Option<Frame> {
        let turn = self.turn();
        let g = self.geometry;
        let measuring = self.measuring.as_mut()?;
        let began = measuring.next_at;
        let step_time = turn.as_secs_f64() / f64::from(g.steps_per_turn);
        let after = |step: u32| Duration::from_secs_f64(step_time * f64::from(step));
        let ready_at = began.plus(after(measuring.last_step));
        if ready_at > until {
            return None;
        }
        let mut values = String::new();
        for step in measuring.first_step..=measuring.last_step {
            let counter_clockwise = f64::from(step) - f64::from(g.front_step);
            let clockwise_deg = -counter_clockwise * 360.0 / f64::from(g.steps_per_turn);
            let echo = scene.echo(began.plus(after(step)), clockwise_deg.rem_euclid(360.0));
            // 1 stands for "nothing came back".
            let mm = echo.map_or(1, |echo| whole(1000.0 * echo.range_m));
            values.push_str(&coded(mm, 3));
        }
        measuring.next_at = began.plus(turn);
        let (command, n_left) = (measuring.command.clone(), measuring.n_left);
        let n_samples = u64::from(measuring.last_step - measuring.first_step + 1);
        if n_left == 1 {
            self.measuring = None;
        } else if let Some(measuring) = &mut self.measuring {
            measuring.n_left = n_left.saturating_sub(1);
        }
        let remaining = n_left.saturating_sub(1);
        let time = coded(self.time_ms(began), 4);
        let mut text = format!("{command}{remaining:02}\n99b\n{time}{}\n", sum(&time));
        let characters: Vec<char> = values.chars().collect();
        for line in characters.chunks(LINE_CHARS) {
            let line: String = line.iter().collect();
            push_line(&mut text, &line);
        }
        text.push('\n');
        Some(Frame { bytes: text.into_bytes(), n_samples, ready_at })
    }
}

impl Device for Hokuyo {
    fn hear(&mut self, bytes: &[u8], now: Stamp<Mono>) {
        for byte in bytes {
            match byte {
                b'\n' | b'\r' => {
                    let line = std::mem::take(&mut self.inbox);
                    self.act(&String::from_utf8_lossy(&line), now);
                }
                _ if self.inbox.len() < LINE_CHARS => self.inbox.push(*byte),
                _ => {}
            }
        }
    }

    fn advance(&mut self, until: Stamp<Mono>, scene: &mut dyn Scene, out: &mut Vec<Frame>) {
        out.append(&mut self.answers);
        if self.is_held
            && let Some(measuring) = self.measuring.take()
        {
            // The firmware stops measuring and says so.
            self.is_lit = false;
            let text = format!("{}00\n27{}\n\n", measuring.command, sum("27"));
            out.push(Frame::answer(text.into_bytes(), until));
        }
        while let Some(frame) = self.scan(until, scene) {
            out.push(frame);
        }
    }

    fn suffer(&mut self, mishap: Mishap, _now: Stamp<Mono>) {
        match mishap {
            Mishap::HeadHeld(is_held) => self.is_held = is_held,
            Mishap::InternalError => (self.fault, self.measuring) = (Some("50"), None),
        }
    }
}

/// A line with its sum.
fn push_line(text: &mut String, line: &str) {
    text.push_str(line);
    text.push(sum(line));
    text.push('\n');
}

/// The sum character of a line.
fn sum(line: &str) -> char {
    let sum: u32 = line.bytes().map(u32::from).sum();
    char::from(u8::try_from(sum % 64).unwrap_or(0) + b'0')
}

/// A number in so many characters of six bits, most significant first.
fn coded(number: u32, n_chars: u32) -> String {
    (0..n_chars)
        .rev()
        .map(|k| char::from(u8::try_from(number >> (6 * k) & 63).unwrap_or(0) + b'0'))
        .collect()
}
