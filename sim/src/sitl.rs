//! A flight on an autopilot's own simulator: PX4 or `ArduPilot`, in a process of its own, flies a
//! vehicle of its own, and the service flies on it as on any.
//!
//! ```text
//!   PX4 / ArduPilot ──── MAVLink ────▶ service ◀─ scans, detections ─┐
//!     its own vehicle ── truth ─▶ TruthTrack ─▶ emulated LiDAR, camera ┘  in the hall of a scenario
//! ```
//! Where its vehicle truly is, the simulator says itself: PX4 by `HIL_STATE_QUATERNION`, `ArduPilot` by
//! `SIM_STATE`, either on the service's own link or on another. Both give latitude and longitude in
//! 1e-7°, that is in steps of 1.1 cm, and no time. So arrival is the time, velocities carry the
//! track between and beyond the messages, and the places only pull at it ([`TruthTrack`]).
//!
//! The simulator knows nothing of the hall: its floor is level, and its vehicle flies through piles
//! and walls. A flight through them is told as a collision.

mod answers;
mod earth;
mod flight;
mod ground;
mod source;
mod tap;
mod track;
mod truth;

pub use earth::{Earth, Place};
pub use flight::{SitlOptions, run};
pub use source::TruthAddress;
pub use track::TruthTrack;
pub use truth::{Truth, TruthError, truth_of};
