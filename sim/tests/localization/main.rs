//! The localisation in closed loop: what a wrong detector does to it, and whether it is as sure as
//! it says.

#![expect(clippy::expect_used, reason = "a helper of tests stops where its premise fails")]

mod command;
mod faults;
mod support;
