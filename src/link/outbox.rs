//! What waits to leave, and what of it leaves first.
//!
//! A line may be slower than what is asked of it: a radio, a wrong baud rate, somebody else's
//! traffic. Then a queue in the order of arrival grows old, and the vehicle would fly setpoints of
//! long ago. So what keeps it safe leaves first, of what is sent again and again only the newest
//! waits, and nothing else gets more than its turn:
//!
//! 1. commands, answers and clock questions, in order; four at once at most while 2 or 3 wait, for who
//!    asks much is answered much;
//! 2. the heartbeat, the newest;
//! 3. the setpoint, the newest;
//! 4. ODOMETRY, the newest, in turns with texts, in order, then values and parameters, in order.

use crate::time::{Mono, Stamp};
use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage;
use std::collections::VecDeque;
use std::time::Duration;

/// Orders that wait at most; each is repeated by its sender until it is answered.
const MOST_ORDERS: usize = 64;
/// Orders that leave one after the other while a heartbeat or a setpoint waits.
const MOST_IN_A_ROW: u8 = 4;
/// Texts that wait at most.
const MOST_TEXTS: usize = 64;
/// Values and parameters that wait at most: two full lists of the own parameters.
const MOST_OTHERS: usize = 256;
/// A transmitter is kept filled for so long and no longer: what is in it cannot be overtaken.
const FILLED_FOR: Duration = Duration::from_millis(20);

/// A message to be sent; the transport sets its sequence number.
#[derive(Debug, Clone, PartialEq)]
pub struct Outgoing {
    /// Who sends it.
    pub header: MavHeader,
    /// What it says.
    pub message: MavMessage,
}

/// Messages on their way out.
#[derive(Debug, Default)]
pub struct Outbox {
    orders: VecDeque<Outgoing>,
    n_in_a_row: u8,
    heartbeat: Option<Outgoing>,
    setpoint: Option<Outgoing>,
    odometry: Option<Outgoing>,
    texts: VecDeque<Outgoing>,
    others: VecDeque<Outgoing>,
    is_turn_of_others: bool,
}

/// What became of a message that was put in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Placed {
    /// It waits.
    Waits,
    /// It waits in the place of an older one of its kind, which never left.
    Replaces,
    /// There was no room for it.
    Lost,
}

impl Outbox {
    /// Puts a message in.
    pub fn put(&mut self, outgoing: Outgoing) -> Placed {
        match outgoing.message {
            MavMessage::HEARTBEAT(_) => newest(&mut self.heartbeat, outgoing),
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(_) => newest(&mut self.setpoint, outgoing),
            MavMessage::ODOMETRY(_) => newest(&mut self.odometry, outgoing),
            MavMessage::COMMAND_LONG(_)
            | MavMessage::COMMAND_INT(_)
            | MavMessage::COMMAND_ACK(_)
            | MavMessage::TIMESYNC(_) => in_order(&mut self.orders, MOST_ORDERS, outgoing),
            MavMessage::STATUSTEXT(_) => in_order(&mut self.texts, MOST_TEXTS, outgoing),
            _ => in_order(&mut self.others, MOST_OTHERS, outgoing),
        }
    }

    /// Takes the most urgent one out.
    pub fn take(&mut self) -> Option<Outgoing> {
        if self.n_in_a_row < MOST_IN_A_ROW
            && let Some(order) = self.orders.pop_front()
        {
            self.n_in_a_row += 1;
            return Some(order);
        }
        self.n_in_a_row = 0;
        let urgent = self.heartbeat.take().or_else(|| self.setpoint.take());
        if urgent.is_some() {
            return urgent;
        }
        if let Some(order) = self.orders.pop_front() {
            return Some(order);
        }
        let is_others_first = std::mem::replace(&mut self.is_turn_of_others, false);
        if is_others_first && let Some(other) = self.other() {
            return Some(other);
        }
        let odometry = self.odometry.take();
        self.is_turn_of_others = odometry.is_some();
        odometry.or_else(|| self.other())
    }

    /// What nothing waits for; texts first, for a person reads them.
    fn other(&mut self) -> Option<Outgoing> {
        self.texts.pop_front().or_else(|| self.others.pop_front())
    }

    /// Messages that wait.
    #[must_use]
    pub fn len(&self) -> usize {
        let newest = [&self.heartbeat, &self.setpoint, &self.odometry];
        let in_order = [&self.orders, &self.texts, &self.others];
        in_order.iter().map(|queue| queue.len()).sum::<usize>()
            + newest.iter().filter(|one| one.is_some()).count()
    }

    /// True if nothing waits.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Throws away what waits, and says how much that was.
    pub fn clear(&mut self) -> usize {
        let n_waiting = self.len();
        *self = Self::default();
        n_waiting
    }
}

fn newest(place: &mut Option<Outgoing>, outgoing: Outgoing) -> Placed {
    match place.replace(outgoing) {
        Some(_) => Placed::Replaces,
        None => Placed::Waits,
    }
}

fn in_order(queue: &mut VecDeque<Outgoing>, most: usize, outgoing: Outgoing) -> Placed {
    if queue.len() >= most {
        return Placed::Lost;
    }
    queue.push_back(outgoing);
    Placed::Waits
}

/// When a line of known speed takes more.
#[derive(Debug, Clone, Copy)]
pub struct Pace {
    bytes_per_s: f64,
    free_at: Stamp<Mono>,
}

impl Pace {
    /// A free line that carries `bytes_per_s`, which is positive.
    #[must_use]
    pub const fn new(bytes_per_s: f64) -> Self {
        Self { bytes_per_s, free_at: Stamp::ZERO }
    }

    /// The line of a serial port: 8 data bits, a start and a stop bit.
    #[must_use]
    pub fn of_baud(baud: u32) -> Self {
        Self::new(f64::from(baud.max(1)) / 10.0)
    }

    /// When everything that was handed over has left.
    #[must_use]
    pub const fn free_at(&self) -> Stamp<Mono> {
        self.free_at
    }

    /// The instant from which the next message is taken.
    #[must_use]
    pub fn open_from(&self) -> Stamp<Mono> {
        self.free_at.minus(FILLED_FOR)
    }

    /// Hands `n_bytes` over at `now`; says when the last of them has left.
    pub fn hand_over(&mut self, now: Stamp<Mono>, n_bytes: usize) -> Stamp<Mono> {
        let takes = Duration::from_secs_f64(n_bytes as f64 / self.bytes_per_s);
        self.free_at = self.free_at.max(now).plus(takes);
        self.free_at
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::ardupilotmega as m;

    fn out(message: MavMessage) -> Outgoing {
        Outgoing { header: MavHeader::default(), message }
    }

    fn odometry(time_usec: u64) -> Outgoing {
        out(MavMessage::ODOMETRY(m::ODOMETRY_DATA { time_usec, ..Default::default() }))
    }

    fn setpoint(time_boot_ms: u32) -> Outgoing {
        out(MavMessage::SET_POSITION_TARGET_LOCAL_NED(m::SET_POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms,
            ..Default::default()
        }))
    }

    fn value(time_boot_ms: u32) -> Outgoing {
        let data = m::NAMED_VALUE_FLOAT_DATA { time_boot_ms, ..Default::default() };
        out(MavMessage::NAMED_VALUE_FLOAT(data))
    }

    fn command(confirmation: u8) -> Outgoing {
        let data = m::COMMAND_LONG_DATA { confirmation, ..Default::default() };
        out(MavMessage::COMMAND_LONG(data))
    }

    #[test]
    fn what_keeps_the_vehicle_safe_leaves_first_and_fresh() {
        let mut outbox = Outbox::default();
        for n in 0..3_u8 {
            outbox.put(value(n.into()));
            outbox.put(odometry(n.into()));
            outbox.put(setpoint(n.into()));
            outbox.put(command(n));
        }
        assert_eq!(outbox.len(), 3 + 1 + 1 + 3);
        let left: Vec<_> = std::iter::from_fn(|| outbox.take()).collect();
        let expected = [
            command(0),
            command(1),
            command(2),
            setpoint(2),
            odometry(2),
            value(0),
            value(1),
            value(2),
        ];
        assert_eq!(left, expected);
    }

    /// Somebody asks for the clock a thousand times a second.
    #[test]
    fn a_flood_of_answers_leaves_the_setpoint_its_turn() {
        let mut outbox = Outbox::default();
        let mut n_setpoints = 0;
        for n in 0..100 {
            (0..8).for_each(|k| {
                outbox.put(command(k));
            });
            outbox.put(setpoint(n));
            let left: Vec<_> = (0..5).filter_map(|_| outbox.take()).collect();
            let is_setpoint =
                |o: &&Outgoing| matches!(o.message, MavMessage::SET_POSITION_TARGET_LOCAL_NED(_));
            n_setpoints += left.iter().filter(is_setpoint).count();
        }
        assert_eq!(n_setpoints, 100);
    }

    #[test]
    fn texts_overtake_parameters() {
        let mut outbox = Outbox::default();
        (0..200).for_each(|n| {
            outbox.put(value(n));
        });
        let text = out(MavMessage::STATUSTEXT(m::STATUSTEXT_DATA::default()));
        outbox.put(text.clone());
        assert_eq!(outbox.take(), Some(text));
    }

    #[test]
    fn odometry_and_the_rest_take_turns() {
        let mut outbox = Outbox::default();
        for n in 0..8 {
            assert_eq!(outbox.put(value(n)), Placed::Waits);
        }
        let mut left = Vec::new();
        for n in 0..6 {
            outbox.put(odometry(n));
            left.extend(outbox.take());
        }
        let n_values =
            left.iter().filter(|o| matches!(o.message, MavMessage::NAMED_VALUE_FLOAT(_))).count();
        assert_eq!(n_values, 3);
    }

    #[test]
    fn what_does_not_fit_is_told() {
        let mut outbox = Outbox::default();
        assert_eq!(outbox.put(setpoint(0)), Placed::Waits);
        assert_eq!(outbox.put(setpoint(1)), Placed::Replaces);
        for _ in 0..MOST_OTHERS {
            assert_eq!(outbox.put(value(1)), Placed::Waits);
        }
        assert_eq!(outbox.put(value(0)), Placed::Lost);
        assert_eq!(outbox.clear(), MOST_OTHERS + 1);
        assert!(outbox.is_empty());
    }

    /// 57600 baud carry 5760 bytes in a second, less the 20 ms that may be ahead.
    #[test]
    fn a_line_takes_no_more_than_it_carries() {
        let mut pace = Pace::of_baud(57_600);
        let mut n_bytes = 0;
        for ms in 0..1_000_i64 {
            let now = Stamp::from_nanos(ms * 1_000_000);
            while pace.open_from() <= now {
                pace.hand_over(now, 64);
                n_bytes += 64;
            }
        }
        assert!((5_760..5_760 + 180).contains(&n_bytes), "{n_bytes}");
    }
}
