//! Bytes on the wire: what arrives, what does not, and what the service says.

#![expect(clippy::unwrap_used, clippy::panic, reason = "tests stop at the first surprise")]

mod datagrams;
mod external_planner;
mod frames;
mod guarded;
mod page;
mod params;
mod rubbish;
mod service;
mod streams;
mod support;
mod texts;
mod watchdog;
