//! Reads or writes a list of parameters; what is not answered is asked again.

use super::value::{Encoding, Kind, Value};
use crate::link::AUTOPILOT_COMPONENT;
use crate::time::{Mono, Stamp};
use mavlink::dialects::ardupilotmega::{
    MavMessage, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA,
};
use std::time::Duration;

/// An autopilot answers within a few milliseconds; a telemetry radio takes some tenths.
const ASK_AGAIN_AFTER: Duration = Duration::from_millis(700);
/// An unknown name is never answered, by PX4 and by ArduPilot alike.
const MAX_ATTEMPTS: u8 = 4;
/// Requests under way at once: few enough for a slow serial line.
const WINDOW: usize = 8;

/// What became of one parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The parameter.
    pub name: String,
    /// What the autopilot has; `None` if it never answered.
    pub found: Option<(Kind, Value)>,
}

#[derive(Debug)]
struct Item {
    name: String,
    /// What to write; `None` to read only.
    set: Option<(Kind, Value)>,
    found: Option<(Kind, Value)>,
    attempts: u8,
    asked_at: Option<Stamp<Mono>>,
    is_done: bool,
}

/// A list of parameters on its way.
#[derive(Debug)]
pub struct Exchange {
    system: u8,
    encoding: Encoding,
    items: Vec<Item>,
}

impl Exchange {
    /// Reads parameters of the autopilot with this system id.
    #[must_use]
    pub fn read(system: u8, encoding: Encoding, names: &[String]) -> Self {
        let items = names.iter().map(|name| Item::new(name.clone(), None)).collect();
        Self { system, encoding, items }
    }

    /// Writes parameters; each has to be of the autopilot's own type.
    #[must_use]
    pub fn write(system: u8, encoding: Encoding, values: Vec<(String, Kind, Value)>) -> Self {
        let item = |(name, kind, value)| Item::new(name, Some((kind, value)));
        Self { system, encoding, items: values.into_iter().map(item).collect() }
    }

    /// Takes in an answer of the autopilot.
    pub fn on_value(&mut self, data: &PARAM_VALUE_DATA) {
        let Ok(name) = data.param_id.to_str() else { return };
        let Some(item) = self.items.iter_mut().find(|item| item.name == name) else { return };
        if item.attempts == 0 {
            return;
        }
        let Some(kind) = Kind::from_wire(data.param_type) else { return };
        let Some(value) = Value::from_wire(data.param_value, kind, self.encoding) else { return };
        item.found = Some((kind, value));
        // An autopilot that refuses a value answers with the old one: ask again.
        item.is_done |= item.set.is_none_or(|wanted| wanted == (kind, value));
    }

    /// Appends what has to be asked now.
    pub fn on_time(&mut self, now: Stamp<Mono>, messages: &mut Vec<MavMessage>) {
        for item in self.items.iter_mut().filter(|item| !item.is_done).take(WINDOW) {
            if item.asked_at.is_some_and(|at| now.since(at) < ASK_AGAIN_AFTER) {
                continue;
            }
            if item.attempts == MAX_ATTEMPTS {
                item.is_done = true;
                continue;
            }
            item.attempts += 1;
            item.asked_at = Some(now);
            match item.request(self.system, self.encoding) {
                Some(message) => messages.push(message),
                None => item.is_done = true,
            }
        }
    }

    /// True once every parameter is answered or given up.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.items.iter().all(|item| item.is_done)
    }

    /// The outcomes, in the order of the request.
    #[must_use]
    pub fn outcomes(self) -> Vec<Outcome> {
        self.items.into_iter().map(|item| Outcome { name: item.name, found: item.found }).collect()
    }
}

impl Item {
    const fn new(name: String, set: Option<(Kind, Value)>) -> Self {
        Self { name, set, found: None, attempts: 0, asked_at: None, is_done: false }
    }

    /// `None` if the value cannot be sent.
    fn request(&self, system: u8, encoding: Encoding) -> Option<MavMessage> {
        let param_id = self.name.as_str().into();
        Some(match self.set {
            None => MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
                param_index: -1,
                target_system: system,
                target_component: AUTOPILOT_COMPONENT,
                param_id,
            }),
            Some((kind, value)) => MavMessage::PARAM_SET(PARAM_SET_DATA {
                param_value: value.to_wire(encoding)?,
                target_system: system,
                target_component: AUTOPILOT_COMPONENT,
                param_id,
                param_type: kind.to_wire(),
            }),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::ardupilotmega::MavParamType;

    fn at_ms(ms: i64) -> Stamp<Mono> {
        Stamp::from_nanos(ms * 1_000_000)
    }

    fn answer(name: &str, bits: u32) -> PARAM_VALUE_DATA {
        PARAM_VALUE_DATA {
            param_value: f32::from_bits(bits),
            param_count: 3,
            param_index: 0,
            param_id: name.into(),
            param_type: MavParamType::MAV_PARAM_TYPE_INT32,
        }
    }

    #[test]
    fn a_lost_answer_is_asked_for_again_and_an_unknown_name_given_up() {
        let names = ["KNOWN", "LATE", "UNKNOWN"].map(str::to_owned);
        let mut exchange = Exchange::read(1, Encoding::Bytewise, &names);
        let mut n_asked = 0;
        for ms in (0..5_000).step_by(50) {
            let mut messages = Vec::new();
            exchange.on_time(at_ms(ms), &mut messages);
            n_asked += messages.len();
            match ms {
                50 => exchange.on_value(&answer("KNOWN", 7)),
                1_000 => exchange.on_value(&answer("LATE", 8)),
                1_050 => exchange.on_value(&answer("SOMETHING_ELSE", 9)),
                _ => {}
            }
        }
        assert!(exchange.is_done());
        // 1 for the first, 2 for the second, 4 for the third.
        assert_eq!(n_asked, 7);
        let found: Vec<_> = exchange.outcomes().into_iter().map(|o| o.found).collect();
        let whole = |value| Some((Kind::Int32, Value::Whole(value)));
        assert_eq!(found, [whole(7), whole(8), None]);
    }

    #[test]
    fn a_refused_write_shows_what_the_autopilot_kept() {
        let set = vec![("A".to_owned(), Kind::Int32, Value::Whole(15))];
        let mut exchange = Exchange::write(1, Encoding::Bytewise, set);
        let mut messages = Vec::new();
        exchange.on_time(at_ms(0), &mut messages);
        let [MavMessage::PARAM_SET(data)] = messages.as_slice() else { panic!("{messages:?}") };
        assert_eq!(data.param_value.to_bits(), 15);
        exchange.on_value(&answer("A", 3));
        assert!(!exchange.is_done());
        for second in 1..5 {
            exchange.on_time(at_ms(1_000 * second), &mut messages);
        }
        assert!(exchange.is_done());
        assert_eq!(exchange.outcomes()[0].found, Some((Kind::Int32, Value::Whole(3))));
    }

    #[test]
    fn a_long_list_does_not_flood_a_slow_line() {
        let names: Vec<String> = (0..100).map(|k| format!("P{k}")).collect();
        let mut exchange = Exchange::read(1, Encoding::CCast, &names);
        let mut messages = Vec::new();
        exchange.on_time(at_ms(0), &mut messages);
        assert_eq!(messages.len(), WINDOW);
    }
}
