//! Camera.
