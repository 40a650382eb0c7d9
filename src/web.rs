//! The live page: what people see of a flight, and the few things that they may ask for there.
//!
//! ```text
//!  brain ── Feed: facts, moved, never waited for ──▶ thread `page`: Collector ─▶ Picture, 5 Hz
//!    ▲                                                                │             │
//!    └── Wish ◀── POST, token, origin, freshness ◀── axum ◀───────────┴─▶ state, maps, metrics
//! ```
//! The brain hands over what it has decided anyway; counting, scaling and encoding happen in a
//! thread of its own with a lower priority, so that no number of viewers slows a flight. A state is
//! encoded once and sent to all; a viewer that does not keep up is dropped and counted.
//!
//! Anybody who reaches the address may look. Only who shows the token in a header may ask for
//! something, from a page of the same origin, with a fresh picture before the eyes where motors
//! could start, and then with a name and four declarations, which the log keeps. Not here: TLS, users, anything from the internet. Every byte is part of the program.

mod access;
mod advice;
mod assets;
mod collector;
mod earlier;
mod feed;
mod maps;
mod metrics;
mod openapi;
mod review;
mod scene;
mod series;
mod server;
mod settings;
mod shared;
mod socket;
mod state;
mod verdict;
mod wish;

pub use access::{Token, TokenError};
pub use feed::{BrainEnd, Feed, Pulse};
pub use openapi::openapi_json;
pub use scene::Scene;
pub use server::{Floor, RunningPage, Sensors, Surroundings, start};
pub use settings::Settings;
pub use wish::{Wish, WishAnswer};
