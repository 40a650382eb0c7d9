//! What a flight has left out, and whether another one could look at it.

use super::survey_plan::SurveyPlan;
use crate::mapping::SolvedSurface;
use crate::planning::Waypoint;
use std::sync::Arc;

/// A gap of the surface after landing, for people.
#[derive(Debug, Clone, PartialEq)]
pub struct OfferedGap {
    /// Its middle in the hall, x and y, m.
    pub centre_m: [f64; 2],
    /// Its area, m².
    pub area_m2: f64,
    /// Share of the surface's variance of the volume that goes through it, 0 to 1.
    pub share: f64,
    /// The bay that its middle lies in, if bays have names.
    pub bay: Option<String>,
    /// The vehicle may be where it could look into it.
    pub is_in_reach: bool,
}

/// The gaps of the last survey with the ways over those in reach.
#[derive(Debug, Clone, Default)]
pub(super) struct GapOffer {
    gaps: Arc<[OfferedGap]>,
    passes: Vec<Vec<Waypoint>>,
}

impl GapOffer {
    pub(super) fn new(
        solved: &SolvedSurface,
        plan: &SurveyPlan,
        bay_at: impl Fn([f64; 2]) -> Option<String>,
    ) -> Self {
        let mut all_passes = Vec::new();
        let offered = solved.gaps.iter().map(|gap| {
            let passes = plan.passes_over(gap, &solved.surface.grid);
            let is_in_reach = !passes.is_empty();
            all_passes.extend(passes);
            OfferedGap {
                centre_m: gap.centre_m,
                area_m2: gap.area_m2,
                share: gap.share,
                bay: bay_at(gap.centre_m),
                is_in_reach,
            }
        });
        Self { gaps: offered.collect(), passes: all_passes }
    }

    /// True if there is nothing that could be flown to.
    pub(super) fn is_empty(&self) -> bool {
        self.passes.is_empty()
    }

    /// All gaps, those out of reach too, the one with the largest share first.
    pub(super) fn gaps(&self) -> Arc<[OfferedGap]> {
        Arc::clone(&self.gaps)
    }

    /// Ways over the gaps in reach.
    pub(super) fn passes(&self) -> Vec<Vec<Waypoint>> {
        self.passes.clone()
    }

    /// The line for the people, if something can be flown to.
    pub(super) fn news(&self) -> Option<String> {
        let largest = self.gaps.iter().find(|gap| gap.is_in_reach)?;
        let n_in_reach = self.gaps.iter().filter(|gap| gap.is_in_reach).count();
        let [x_m, y_m] = largest.centre_m;
        let plural = if n_in_reach == 1 { "" } else { "s" };
        Some(format!(
            "{n_in_reach} gap{plural} to fly: largest {:.1} m2 at x {x_m:.1} y {y_m:.1} m, {:.0} % of the variance",
            largest.area_m2,
            100.0 * largest.share
        ))
    }
}
