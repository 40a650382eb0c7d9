//! Whole flights in virtual time: brain, MAVLink session, stub autopilot and simulated hall.

#![expect(clippy::expect_used, reason = "a helper of tests stops where its premise fails")]

mod calibrate;
mod external_planner;
mod failed_solve;
mod fault_cases;
mod faults;
mod gaps;
mod hollows;
mod jobs;
mod merge;
mod mode_switch;
mod paper;
mod parallel;
mod serial_line;
mod support;
mod survey;
mod tracking;
