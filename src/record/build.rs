//! Which build is running.

/// The source commit of this program, if the build was told it.
#[must_use]
pub const fn build_commit() -> Option<&'static str> {
    option_env!("STOCKPILOT_COMMIT")
}

/// What stands in [`build_identity`] where the commit is not known.
pub const COMMIT_NOT_STAMPED: &str = "commit not stamped";

/// Version, source commit, target and profile of this program.
///
/// The commit is the value of `STOCKPILOT_COMMIT` in the environment of the build, if it was set.
#[must_use]
pub fn build_identity() -> String {
    let commit = build_commit().unwrap_or(COMMIT_NOT_STAMPED);
    let profile = env!("STOCKPILOT_PROFILE");
    let (arch, os) = (std::env::consts::ARCH, std::env::consts::OS);
    format!("{} ({commit}, {arch}-{os}, {profile})", env!("CARGO_PKG_VERSION"))
}
