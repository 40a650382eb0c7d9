//! Everything that a careful tester would do to a flight, and the judgement of what follows.
//!
//! Each case flies the brain and the MAVLink session against a stub autopilot in virtual time,
//! breaks something, and demands: nothing is touched, the vehicle goes nowhere that it was not
//! asked to, the expected state is reached within the stated time, no broken number leaves, and
//! every event is in the log. Cases 1 to 33 are those of the fault matrix, 34 is the loss of one way, 101 to 108 the hazards
//! that were observed on real autopilots.
//!
//! Not here: what lies below the messages. Half frames of the LiDAR, broken serial ports, full
//! disks and killed processes are tests of their own, beside the drivers, the recorder and the
//! programs.

mod bench;
mod cases;
mod command;
mod expectations;
mod link_layer;

pub use bench::{Bench, Verdict};
pub use cases::{CASES, Case};
pub use command::{CaseReport, FaultsArgs, FaultsReport, run, run_case};
pub use link_layer::{LinkLayer, Way};
