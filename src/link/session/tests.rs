//! The session with a scripted other side.
