//! LiDAR.
