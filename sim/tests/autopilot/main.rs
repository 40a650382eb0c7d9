//! The stub autopilot in closed loop with the vehicle, against what real ones were seen to do.

#![expect(clippy::expect_used, reason = "a helper of tests stops where its premise fails")]

mod ardupilot;
mod faults;
mod flight;
mod refusals;
mod support;
