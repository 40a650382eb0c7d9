//! Flies stockpilot on a laptop.

fn main() {}
