//! Where the vehicle is.
