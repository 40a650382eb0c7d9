//! Is the localisation as sure as it says? Many flights, and the errors of each beside its claims.
//!
//! ```text
//! ε = eᵀ P⁻¹ e                  NEES of a group of states, expected: its number of states n
//! e = (p − p̂, log(R̂ᵀ R), v − v̂)   hall axes, body axes on the right, hall axes
//! NIS = νᵀ S⁻¹ ν                of each attempt to fuse a frame, expected: its degrees of freedom
//! ```
//! - *At one instant* the N flights are independent, so N ε̄ is χ² with N n degrees, and the 95 %
//!   band of the mean is χ²_{N n}/N. The time series shows that one.
//! - *Over time* the errors of one flight resemble each other, so K looks at each of N flights
//!   are fewer than N K independent ones. The flights themselves are independent: the scatter of
//!   their means, against the scatter of the single looks, gives the share
//!
//! ```text
//! D = var(flight means) / var(looks), between 1/K and 1
//! N_eff = N/D,   band of the mean over flights and time: χ²_{N_eff n}/N_eff
//! ```
//!   The theory alone gives the width of the χ²; the data only say how many looks count. So a
//!   filter whose errors scatter too much does not widen its own band, and no band is wider than
//!   that of a single instant.
//!
//! Sources: Bar-Shalom, Li, Kirubarajan 2001, section 5.4 (NEES, NIS and their bands over runs);
//! the share D is the usual design effect of cluster samples (Kish 1965).
//! Checked: `band_holds_in_95_of_100_trials_of_correlated_looks`.

mod band;
mod command;
mod files;
mod flight;
mod hover;
mod plot;
mod summary;
mod update;

pub use band::{Band, design_effect, mean_band};
pub use command::{ConsistencyArgs, run};
pub use flight::{FlightPlan, FlownFlight, Look, NisLook, fly, look};
pub use hover::{HoverReport, hover};
pub use summary::{GroupSummary, Groups, NisSummary, SettingReport};
pub use update::{Update, with_update};

/// The groups whose NEES is looked at, in the order of [`Look::nees`], with their states.
pub const GROUPS: [(&str, f64); 4] =
    [("position", 3.0), ("attitude", 3.0), ("velocity", 3.0), ("pose_and_velocity", 9.0)];
