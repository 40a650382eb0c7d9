//! Tells the program which profile it is built with: programs of both have no debug assertions.

fn main() {
    let profile = std::env::var("PROFILE").unwrap_or_else(|_| "unknown profile".to_owned());
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-env=STOCKPILOT_PROFILE={profile}");
}
