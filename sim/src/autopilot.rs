//! Stub autopilots.
