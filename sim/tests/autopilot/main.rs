//! The stub autopilot in closed loop with the vehicle, against what real ones were seen to do.

mod faults;
mod flight;
mod refusals;
mod support;
