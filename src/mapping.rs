//! What the surface looks like.
