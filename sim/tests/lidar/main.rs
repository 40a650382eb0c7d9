//! Drivers and emulators of scanners against each other, in virtual time.

#![expect(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod bad_line;
mod check;
mod checksums;
mod damage;
mod detection;
mod driver;
mod models;
mod rig;
mod speeds;
mod stamps;
mod support;
