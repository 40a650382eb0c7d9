//! Drivers and emulators of scanners against each other, in virtual time.

#![expect(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod check;
mod checksums;
mod damage;
mod detection;
mod driver;
mod models;
mod support;
