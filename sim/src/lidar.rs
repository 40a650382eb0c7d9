//! A rotating 2D LiDAR in the true hall.
//!
//! [`LidarSimulator`] turns true poses into [`Packet`]s of twelve samples, as LDROBOT sensors
//! measure them. A packet becomes 47 bytes for a serial line ([`encode`], [`PtyLidar`]) or a part of
//! a turn for campaigns ([`TurnAssembler`]); both carry the very same samples.
//!
//! ```text
//! true poses ─▶ LidarSimulator ─▶ Packet ─┬▶ encode ─▶ PtyLidar ─▶ the service's serial driver
//!                                         └▶ TurnAssembler ─▶ Scan
//! ```

mod frame;
mod model;
mod pose_track;
mod pty;
mod simulator;
mod turns;

pub use frame::{FRAME_LEN, encode};
pub use model::LidarModel;
pub use pose_track::PoseTrack;
pub use pty::{LineCounts, LineFaults, PtyLidar};
pub use simulator::{LidarSimulator, Packet, SAMPLES_PER_PACKET, Sample};
pub use turns::TurnAssembler;

#[cfg(test)]
mod tests;
