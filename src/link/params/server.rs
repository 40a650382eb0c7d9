//! The few parameters of this service, for ground stations to show.
//!
//! They are what the configuration says and cannot be changed from outside: the log has to hold
//! the configuration that was flown. All of them are REAL32, which reads the same in both
//! encodings. The set never changes while the service runs, as the protocol demands.

use mavlink::dialects::ardupilotmega::{MavMessage, MavParamType, PARAM_VALUE_DATA};

/// Sent at each tick while a list is asked for: 120 a second, 4.4 kB/s.
const PER_TICK: usize = 2;

/// A parameter that is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Published {
    /// Its name, 16 letters at most.
    pub name: &'static str,
    /// Its value.
    pub value: f32,
}

/// Answers the parameter protocol.
#[derive(Debug, Clone)]
pub(crate) struct ParamServer {
    params: Vec<Published>,
    /// The next one of a list that is under way.
    next: Option<usize>,
}

impl ParamServer {
    /// Shows `params`; those without a number are left out.
    pub(crate) fn new(params: &[Published]) -> Self {
        let params = params.iter().copied().filter(|param| param.value.is_finite()).collect();
        Self { params, next: None }
    }

    /// Takes in a message; true if it was about parameters of `own` system and component.
    ///
    /// A wish to set one is answered with the value that stays.
    pub(crate) fn on_message(
        &mut self,
        message: &MavMessage,
        own: (u8, u8),
        messages: &mut Vec<MavMessage>,
    ) -> bool {
        let (target, wish) = match message {
            MavMessage::PARAM_REQUEST_LIST(data) => {
                ((data.target_system, data.target_component), None)
            }
            MavMessage::PARAM_REQUEST_READ(data) => {
                let index = usize::try_from(data.param_index).ok();
                let name = data.param_id.to_str().unwrap_or("");
                let index = index.or_else(|| self.index_of(name));
                ((data.target_system, data.target_component), Some(index))
            }
            MavMessage::PARAM_SET(data) => {
                let index = self.index_of(data.param_id.to_str().unwrap_or(""));
                ((data.target_system, data.target_component), Some(index))
            }
            _ => return false,
        };
        let is_mine = [0, own.0].contains(&target.0) && [0, own.1].contains(&target.1);
        match wish {
            _ if !is_mine => return false,
            None => self.next = Some(0),
            Some(index) => messages.extend(index.and_then(|index| self.value(index))),
        }
        true
    }

    /// Goes on with a list.
    pub(crate) fn on_time(&mut self, messages: &mut Vec<MavMessage>) {
        let Some(next) = self.next else { return };
        let end = next + PER_TICK;
        messages.extend((next..end).filter_map(|index| self.value(index)));
        self.next = (end < self.params.len()).then_some(end);
    }

    fn index_of(&self, name: &str) -> Option<usize> {
        self.params.iter().position(|param| param.name == name)
    }

    fn value(&self, index: usize) -> Option<MavMessage> {
        let param = self.params.get(index)?;
        Some(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: param.value,
            param_count: u16::try_from(self.params.len()).ok()?,
            param_index: u16::try_from(index).ok()?,
            param_id: param.name.into(),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::ardupilotmega as m;

    const OWN: (u8, u8) = (7, 191);

    fn server() -> ParamServer {
        let param = |name, value| Published { name, value };
        ParamServer::new(&[
            param("SP_A", 1.5),
            param("SP_NAN", f32::NAN),
            param("SP_B", -2.0),
            param("SP_C", 3.0),
        ])
    }

    fn names(messages: &[MavMessage]) -> Vec<String> {
        let name = |message: &MavMessage| match message {
            MavMessage::PARAM_VALUE(data) => {
                assert_eq!(
                    (data.param_count, data.param_type),
                    (3, MavParamType::MAV_PARAM_TYPE_REAL32)
                );
                data.param_id.to_str().unwrap().to_owned()
            }
            other => panic!("{other:?}"),
        };
        messages.iter().map(name).collect()
    }

    fn list(system: u8, component: u8) -> MavMessage {
        MavMessage::PARAM_REQUEST_LIST(m::PARAM_REQUEST_LIST_DATA {
            target_system: system,
            target_component: component,
        })
    }

    #[test]
    fn a_list_comes_in_pieces_and_once() {
        let mut server = server();
        let mut messages = Vec::new();
        // A ground station asks all components at once.
        assert!(server.on_message(&list(7, 0), OWN, &mut messages));
        server.on_time(&mut messages);
        assert_eq!(names(&messages), ["SP_A", "SP_B"]);
        for _ in 0..5 {
            server.on_time(&mut messages);
        }
        assert_eq!(names(&messages), ["SP_A", "SP_B", "SP_C"]);
        for (system, component) in [(7, 1), (8, 191), (8, 0)] {
            assert!(!server.on_message(&list(system, component), OWN, &mut messages));
        }
    }

    #[test]
    fn a_wish_to_set_one_is_answered_with_what_stays() {
        let mut server = server();
        let mut messages = Vec::new();
        let set = MavMessage::PARAM_SET(m::PARAM_SET_DATA {
            param_value: 99.0,
            target_system: 7,
            target_component: 191,
            param_id: "SP_B".into(),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        });
        assert!(server.on_message(&set, OWN, &mut messages));
        let [MavMessage::PARAM_VALUE(data)] = messages.as_slice() else { panic!("{messages:?}") };
        assert_eq!((data.param_value, data.param_index), (-2.0, 1));
    }

    #[test]
    fn single_ones_go_by_index_or_name_and_unknown_ones_unanswered() {
        let mut server = server();
        let mut messages = Vec::new();
        for (index, name) in [(2, ""), (-1, "SP_A"), (9, ""), (-1, "EKF2_EV_CTRL")] {
            let read = MavMessage::PARAM_REQUEST_READ(m::PARAM_REQUEST_READ_DATA {
                param_index: index,
                target_system: 7,
                target_component: 191,
                param_id: name.into(),
            });
            assert!(server.on_message(&read, OWN, &mut messages));
        }
        assert_eq!(names(&messages), ["SP_C", "SP_A"]);
    }
}
