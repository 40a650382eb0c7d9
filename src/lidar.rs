//! lidar
