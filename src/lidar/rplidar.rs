//! Slamtec RPLIDAR (A1, A2, A3, S1, S2, S3, C1): requests, replies, and six formats of samples.
//!
//! ```text
//! Rplidar (session) ─ request ─▶ sensor ─ descriptor A5 5A … ─▶ ReplyReader ─▶ info, health, modes
//!                                       ─ nodes, capsules ────▶ StreamParser ─ Node ─▶ Packet
//! ```
//! A request is `A5 cmd`, or `A5 cmd len payload xor` if bit 7 of `cmd` is set. A reply begins with
//! `A5 5A`, a little-endian length of 30 bits with the kind of reply in the top two, and a type.
//! While the sensor scans, the payload repeats without a further descriptor:
//!
//! | type | format | bytes | samples | guarded by |
//! | --- | --- | --- | --- | --- |
//! | 81 | standard node | 5 | 1 | three check bits only |
//! | 82 | legacy capsule | 84 | 32 | XOR, 8 bit |
//! | 83 | HQ packet | 781 | 96 | CRC-32 |
//! | 84 | ultra capsule | 132 | 96 | XOR, 8 bit |
//! | 85 | dense capsule | 84 | 40 | XOR, 8 bit |
//! | 86 | ultra-dense capsule | 170 | 64 | XOR, 8 bit |
//!
//! Source: Slamtec `rplidar_sdk` 2.1.0 (`sl_lidar_cmd.h`, `sl_lidar_protocol.h`,
//! `dataunpacker/unpacker/handler_*.cpp`). The integer steps of the angles are the SDK's, so its
//! published decodings of captures come out bit for bit.

mod capsule;
mod dense;
mod hq;
mod legacy;
mod mode;
mod node;
mod query;
mod reply;
mod request;
mod session;
mod standard;
mod stream;
mod ultra;

pub use mode::Mode;
pub use node::Node;
pub use reply::{DeviceInfo, Health, HealthStatus, Reply, ReplyReader};
pub use session::Rplidar;
pub(super) use session::model_of;
pub use stream::{Answer, StreamParser};
