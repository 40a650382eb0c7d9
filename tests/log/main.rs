//! The log: what goes in comes out, from whole files and from cut ones.

#![expect(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod damaged_files;
mod every_channel;
mod replays;
mod round_trips;
mod support;
