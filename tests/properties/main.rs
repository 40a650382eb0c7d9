//! Laws that hold for every input, tried on many drawn ones.

#![expect(clippy::expect_used, reason = "a helper of tests stops where its premise fails")]

mod bays;
mod brain;
mod filter;
mod geometry;
mod outbound;
mod support;
mod surface;
mod trajectories;
mod wire_scene;
