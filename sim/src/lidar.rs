//! A rotating 2D LiDAR in the true hall.
//!
//! [`LidarSimulator`] turns true poses into [`Packet`]s of twelve samples for campaigns, without
//! bytes. [`SerialLidar`] is the same sensor as hardware: firmware that hears commands, spins its
//! motor up and packs samples in its maker's way, a transmitter with the line's speed, and a
//! pseudo-terminal. For LDROBOT sensors both carry the very same samples.
//!
//! ```text
//! true poses ─▶ Optics ─┬▶ LidarSimulator ─ Packet ─▶ TurnAssembler ─▶ Scan
//!                       └▶ Device ─ Frame ─▶ Uart ─▶ PtyLine ◀─▶ the service's serial driver
//! ```

mod device;
mod fading;
mod frame;
mod head;
mod model;
mod pose_track;
mod pty;
mod scene;
mod serial;
mod simulator;
mod turns;
mod uart;

pub use device::{Device, Firmware, Format, Frame, Mishap, device};
pub use fading::Fading;
pub use frame::{FRAME_LEN, encode};
pub use model::LidarModel;
pub(crate) use model::hanging_mount;
pub use pose_track::PoseTrack;
pub use pty::{LineCounts, LineFaults, PtyLine};
pub use scene::{Echo, HallView, Optics, Part, Room, Scene};
pub use serial::SerialLidar;
pub use simulator::{LidarSimulator, Packet, SAMPLES_PER_PACKET, Sample};
pub use turns::TurnAssembler;

#[cfg(test)]
mod tests;
