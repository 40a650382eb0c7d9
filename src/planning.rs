//! Where to look next, and how to get there.
