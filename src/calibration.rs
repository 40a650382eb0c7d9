//! Where the LiDAR sits on the vehicle, found out from a flight in a hall whose floor and walls are known.
//!
//! ```text
//! beams with the pose at their own time ─▶ planes (which face of the hall) ─▶ mount (least squares)
//!                                                                             ─▶ place, direction, σ, what was not seen
//! ```
//! Not done here: reading logs (`survey`), and writing the configuration (`config`).

pub mod mount;
pub mod planes;
pub mod range;
