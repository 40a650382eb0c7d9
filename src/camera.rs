#![doc = "Marker detections: from an external detector, or found in the pictures of an own camera."]
#![doc = ""]
#![doc = include_str!("camera/schema.md")]

pub mod images;
mod line;
mod listener;
pub mod picture;
mod splitter;
pub mod tag_finder;

pub use line::{Refusal, read_line};
pub use listener::{CameraStats, Listener};
pub use splitter::{LineSplitter, MAX_LINE_BYTES};

use std::net::SocketAddr;
use std::path::PathBuf;

/// Where detections come in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// Datagrams to this address; port 0 takes any free port.
    Udp(SocketAddr),
    /// Datagrams to a Unix socket at this path.
    UnixDatagram(PathBuf),
    /// Connections to a Unix socket at this path.
    UnixStream(PathBuf),
}

/// Where to listen, and what may be believed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// Where detections come in.
    pub address: Address,
    /// Width and height of each camera's images, px, by camera number.
    pub image_sizes_px: Vec<[u32; 2]>,
}
