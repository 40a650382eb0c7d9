//! Which build is running.

/// Version, source commit, target and profile of this program.
///
/// The commit is the value of `STOCKPILOT_COMMIT` in the environment of the build, if it was set.
#[must_use]
pub fn build_identity() -> String {
    let commit = option_env!("STOCKPILOT_COMMIT").unwrap_or("commit not stamped");
    let profile = if cfg!(debug_assertions) { "debug" } else { "release" };
    let (arch, os) = (std::env::consts::ARCH, std::env::consts::OS);
    format!("{} ({commit}, {arch}-{os}, {profile})", env!("CARGO_PKG_VERSION"))
}
