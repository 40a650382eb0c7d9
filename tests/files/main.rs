//! Files beside the code say what the code does.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test may stop at the first surprise")]

mod container;
mod example_config;
mod ground_station;
mod install_guide;
mod printed_sheets;
mod regions;
mod safety_rules;
mod sudden_end;
