//! What an RPLIDAR is asked before it scans.

use super::request::{self, request};

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Query {
    Health,
    Info,
    SampleRate,
    BoardFlag,
    ModeCount,
    TypicalMode,
    ModePeriod(u16),
    ModeMaxDistance(u16),
    ModeAnswer(u16),
    ModeName(u16),
}

/// The bytes of a question.
pub(super) fn question(query: Query) -> Vec<u8> {
    match query {
        Query::Health => request(request::GET_HEALTH, &[]),
        Query::Info => request(request::GET_INFO, &[]),
        Query::SampleRate => request(request::GET_SAMPLE_RATE, &[]),
        Query::BoardFlag => request(request::GET_BOARD_FLAG, &[0; 4]),
        _ => conf_item(query).map_or_else(Vec::new, |(item, mode)| request::get_conf(item, mode)),
    }
}

/// The configuration item of a question, and the mode that it is about.
pub(super) const fn conf_item(query: Query) -> Option<(u32, Option<u16>)> {
    Some(match query {
        Query::ModeCount => (request::CONF_MODE_COUNT, None),
        Query::TypicalMode => (request::CONF_TYPICAL_MODE, None),
        Query::ModePeriod(id) => (request::CONF_MODE_PERIOD, Some(id)),
        Query::ModeMaxDistance(id) => (request::CONF_MODE_MAX_DISTANCE, Some(id)),
        Query::ModeAnswer(id) => (request::CONF_MODE_ANSWER, Some(id)),
        Query::ModeName(id) => (request::CONF_MODE_NAME, Some(id)),
        Query::Health | Query::Info | Query::SampleRate | Query::BoardFlag => return None,
    })
}
