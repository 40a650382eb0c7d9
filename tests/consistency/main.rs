//! The filter's covariance is honest: over many runs the normalised errors lie inside their bands.

#![expect(clippy::expect_used, reason = "a helper of tests stops where its premise fails")]

mod faults;
mod ground;
mod interruptions;
mod latency;
mod nees;
mod scene;
mod truth;
