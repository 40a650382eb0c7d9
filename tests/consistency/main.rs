//! The filter's covariance is honest: over many runs the normalised errors lie inside their bands.

#![expect(clippy::expect_used, reason = "a helper of tests stops where its premise fails")]
#![expect(clippy::print_stdout, reason = "figures that are shown when a test fails")]

mod faults;
mod ground;
mod interruptions;
mod latency;
mod nees;
mod places;
mod scene;
mod truth;
