//! Files beside the code say what the code does.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test may stop at the first surprise")]

mod example_config;
mod ground_station;
mod regions;
mod safety_rules;
