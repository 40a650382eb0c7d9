//! People's commands that come again because their answer was lost.
//!
//! A ground station repeats a command until it hears an answer. The mission takes most repetitions
//! for what they are (a hold in a hold is a hold), but two cases need a memory:
//!
//! - what a command has done may be over when it comes again: a `return` that called off a start,
//!   a `resume` into the take-off. Refusing it then would tell the person that nothing happened;
//! - a `start` whose answer was lost may come again after the person has called it off. It must
//!   not start the motors.
//!
//! Every other command reaches the mission each time: a hold always holds.

use crate::messages::{OperatorAnswer, OperatorRequest, OperatorVerb};
use crate::time::{Mono, Stamp};
use std::time::Duration;

/// Ground stations repeat for some seconds: QGroundControl three times, 3 s apart.
const REPEATED_WITHIN: Duration = Duration::from_secs(10);

/// What was accepted last.
#[derive(Debug, Clone, Default)]
pub(crate) struct OperatorDesk {
    accepted: Option<Accepted>,
    /// The last accepted start, if another wish has been accepted since.
    called_off: Option<Accepted>,
    /// The service ends: a flight that begins now would be left alone in the air.
    refuses_starts: bool,
}

#[derive(Debug, Clone, Copy)]
struct Accepted {
    verb: OperatorVerb,
    from: OperatorRequest,
    at: Stamp<Mono>,
}

impl Accepted {
    fn is_repeated_by(&self, verb: OperatorVerb, from: OperatorRequest, now: Stamp<Mono>) -> bool {
        self.verb == verb && self.from == from && now.since(self.at) <= REPEATED_WITHIN
    }
}

impl OperatorDesk {
    /// From now on no start passes.
    pub(crate) const fn refuse_starts(&mut self) {
        self.refuses_starts = true;
    }

    /// False for a start that was called off meanwhile, or that comes too late: it must be refused.
    pub(crate) fn passes(
        &self,
        verb: OperatorVerb,
        from: OperatorRequest,
        now: Stamp<Mono>,
    ) -> bool {
        let is_too_late = self.refuses_starts && verb.is_start();
        !is_too_late && self.called_off.is_none_or(|start| !start.is_repeated_by(verb, from, now))
    }

    /// The answer to give for what the mission says: yes, too, to what was done a moment ago.
    pub(crate) fn answer(&mut self, answer: &OperatorAnswer, now: Stamp<Mono>) -> bool {
        let OperatorAnswer { verb, to, is_accepted } = *answer;
        if !is_accepted {
            return self.accepted.is_some_and(|last| last.is_repeated_by(verb, to, now));
        }
        if let Some(last) = self.accepted
            && last.verb.is_start()
            && verb != last.verb
        {
            self.called_off = Some(last);
        }
        if verb.is_start() {
            self.called_off = None;
        }
        self.accepted = Some(Accepted { verb, from: to, at: now });
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERSON: OperatorRequest = OperatorRequest { system: 255, component: 190 };
    const OTHER: OperatorRequest = OperatorRequest { system: 254, component: 190 };

    fn at_s(seconds: i64) -> Stamp<Mono> {
        Stamp::from_nanos(seconds * 1_000_000_000)
    }

    fn answer(verb: OperatorVerb, is_accepted: bool) -> OperatorAnswer {
        OperatorAnswer { verb, to: PERSON, is_accepted }
    }

    #[test]
    fn no_start_passes_while_the_service_ends() {
        let mut desk = OperatorDesk::default();
        assert!(desk.answer(&answer(OperatorVerb::Start, true), at_s(0)));
        desk.refuse_starts();
        for verb in [OperatorVerb::Start, OperatorVerb::FlyGaps] {
            assert!(!desk.passes(verb, PERSON, at_s(1)) && !desk.passes(verb, OTHER, at_s(1)));
        }
        assert!(desk.passes(OperatorVerb::Land, PERSON, at_s(1)));
    }

    #[test]
    fn what_was_done_a_moment_ago_is_accepted_again() {
        let mut desk = OperatorDesk::default();
        assert!(desk.answer(&answer(OperatorVerb::Start, true), at_s(0)));
        // The person calls the start off; the mission is idle now and would refuse the repetition.
        assert!(desk.answer(&answer(OperatorVerb::Return, true), at_s(2)));
        assert!(desk.answer(&answer(OperatorVerb::Return, false), at_s(5)));
        // Not another wish, not another person, not for ever.
        assert!(!desk.answer(&answer(OperatorVerb::Resume, false), at_s(5)));
        let other = OperatorAnswer { to: OTHER, ..answer(OperatorVerb::Return, false) };
        assert!(!desk.answer(&other, at_s(5)));
        assert!(!desk.answer(&answer(OperatorVerb::Return, false), at_s(13)));
    }

    #[test]
    fn a_start_that_was_called_off_does_not_come_back() {
        let mut desk = OperatorDesk::default();
        assert!(desk.passes(OperatorVerb::Start, PERSON, at_s(0)));
        desk.answer(&answer(OperatorVerb::Start, true), at_s(0));
        assert!(desk.passes(OperatorVerb::Start, PERSON, at_s(3)), "a repetition under way");
        desk.answer(&answer(OperatorVerb::Hold, true), at_s(4));
        assert!(!desk.passes(OperatorVerb::Start, PERSON, at_s(6)));
        // Holding, resuming and landing go through all the same, and so does somebody else.
        assert!(desk.passes(OperatorVerb::Hold, PERSON, at_s(6)));
        assert!(desk.passes(OperatorVerb::Start, OTHER, at_s(6)));
        // Later it is a new wish.
        assert!(desk.passes(OperatorVerb::Start, PERSON, at_s(11)));
        desk.answer(&answer(OperatorVerb::Start, true), at_s(11));
        assert!(desk.passes(OperatorVerb::Start, PERSON, at_s(12)));
    }

    #[test]
    fn a_flight_into_the_gaps_that_was_called_off_does_not_come_back_either() {
        let mut desk = OperatorDesk::default();
        desk.answer(&answer(OperatorVerb::FlyGaps, true), at_s(0));
        assert!(desk.passes(OperatorVerb::FlyGaps, PERSON, at_s(1)), "a repetition under way");
        desk.answer(&answer(OperatorVerb::Land, true), at_s(2));
        assert!(!desk.passes(OperatorVerb::FlyGaps, PERSON, at_s(4)));
        assert!(desk.passes(OperatorVerb::Start, PERSON, at_s(4)), "another wish");
    }

    #[test]
    fn a_refused_wish_is_not_remembered() {
        let mut desk = OperatorDesk::default();
        assert!(!desk.answer(&answer(OperatorVerb::Start, false), at_s(0)));
        assert!(!desk.answer(&answer(OperatorVerb::Start, false), at_s(1)));
        assert!(desk.answer(&answer(OperatorVerb::Start, true), at_s(2)));
    }
}
