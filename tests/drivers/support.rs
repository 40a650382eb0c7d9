//! What the tests of this binary share.

use std::io::Write;
use std::path::PathBuf;
use stockpilot::lidar::ldrobot::{Frame, Sample};

/// A real input, if this machine has it.
pub(crate) fn capture(name: &str) -> Option<Vec<u8>> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/lidar");
    // A work tree may lie one level deeper beside its siblings.
    let deeper = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/lidar");
    let path = [folder, deeper].map(|folder| PathBuf::from(folder).join(name));
    let path = path.iter().find(|path| path.exists()).unwrap_or(&path[0]);
    let bytes = std::fs::read(path).ok();
    if bytes.is_none() {
        // Straight to the standard error: what a test prints is shown only if it fails.
        let told = writeln!(std::io::stderr(), "SKIPPED: {} is not here", path.display());
        told.unwrap();
    }
    bytes
}

/// Frame number `frame_idx` of an LD19 at 10 turns/s that sees a wall at 2 m.
pub(crate) fn frame(frame_idx: u32) -> Frame {
    let cdeg = |sample: u32| u16::try_from(sample * 80 % 36_000).unwrap();
    let first = frame_idx * 12;
    Frame {
        speed_deg_per_s: 3600,
        start_cdeg: cdeg(first),
        end_cdeg: cdeg(first + 11),
        timestamp_ms: u16::try_from(u64::from(first) * 1000 / 4500 % 30_000).unwrap(),
        samples: std::array::from_fn(|i| Sample {
            range_mm: 2000,
            intensity: u8::try_from((frame_idx as usize * 12 + i) % 256).unwrap(),
        }),
    }
}

/// Frames `0..n_frames` one behind the other.
pub(crate) fn stream(n_frames: u32) -> Vec<u8> {
    (0..n_frames).flat_map(|frame_idx| frame(frame_idx).to_bytes()).collect()
}
