//! Sensor drivers against real captures, pseudo-terminals and sockets.

#![expect(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod detector_socket;
mod doctor;
mod images;
mod ldrobot_captures;
mod ldrobot_chunking;
mod lidar_endurance;
mod lidar_frames;
mod lidar_payloads;
mod lidar_port;
mod rplidar_captures;
mod support;
mod ydlidar_captures;
