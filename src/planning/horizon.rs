//! Looks at whole paths: short ones that make the volume sure enough or bring much on the way there, or those that make it
//! surest within the length that may be flown.
//!
//! ```text
//! cost = L + Λ max(0, ln(σ^V/σ_target))        L: metres, and a little for waiting until a turn is done
//! ```
//! Λ is the length that one e-fold of σ^V is worth. On the way to a target it is low, so that paths are short; where no path
//! is worth its length then, it is as high as any survey has it. With a gain per metre below 1/Λ more flying is not worth
//! while. Every path is scored by the σ^V that it would leave on a coarse lattice
//! ([`crate::mapping::belief`]), the fix quality on the way included.
//!
//! Seeds are square waves of many spacings, directions, margins and corners (`seeds`), single legs and the rest
//! of the present plan; the best go through a local search over their waypoints (`search`). Volume
//! variance is not submodular, so looking one step ahead has no guarantee, and measures worst.

mod path;
mod scene;
mod search;
mod seeds;

use super::Waypoint;
use super::planner::{Plan, PlanEnd, PlanRequest, Planner, Prediction};
use path::Path;
use scene::Scene;

/// Plans whole paths.
#[derive(Debug, Clone, Copy)]
pub struct Horizon;

/// Paths that are looked at when there is no plan yet.
const N_FRESH: f64 = 4000.0;
/// Going on at all is judged as if it cost this much more, m.
const LEAST_COST_M: f64 = 1.0;
/// Paths that are looked at to better the present plan, seeds included.
const N_AGAIN: f64 = 1200.0;
/// The same while so much is unknown that all of it may have to be turned over.
const N_FAR: f64 = 4000.0;

impl Planner for Horizon {
    fn plan(&self, request: &PlanRequest) -> Plan {
        let Some(mut scene) = Scene::new(request) else {
            return Plan::nothing(PlanEnd::NothingFree);
        };
        let sigma_now_m3 = scene.sigma_now_m3();
        // With a margin: the account has the last word.
        if scene.is_enough_by_account(sigma_now_m3) {
            return scene.finished(PlanEnd::Target, sigma_now_m3);
        }
        let mut best = scene.best(1.0);
        // Where the rest of the way is long for what it brings, it is flown all the same.
        let is_dear = |scene: &Scene<'_>, best: &Path| {
            !scene.pays(best) || scene.is_small_gain(best, sigma_now_m3)
        };
        if best.as_ref().is_some_and(|best| is_dear(&scene, best)) && scene.pay_most() {
            best = scene.best(0.5);
        }
        let Some(best) = best else {
            let is_out_of_reach = request.longest_m.is_some();
            return Plan::nothing(if is_out_of_reach {
                PlanEnd::Budget
            } else {
                PlanEnd::NothingFree
            });
        };
        if scene.is_small_gain(&best, sigma_now_m3) {
            // The steps that are left may be too few for what pays as a whole: they are its beginning.
            scene.ignore_step_limit();
            let whole = scene.best(0.5).filter(|whole| !scene.is_small_gain(whole, sigma_now_m3));
            return match whole {
                Some(whole) => scene.plan(&whole, sigma_now_m3),
                None => scene.finished(PlanEnd::SmallGain, sigma_now_m3),
            };
        }
        scene.plan(&best, sigma_now_m3)
    }
}

/// The corners of the square wave with the spacing, direction, margins and corner that score best,
/// cut where the target is reached; `None` if none is free.
#[must_use]
pub fn best_square_wave(request: &PlanRequest) -> Option<(Vec<Waypoint>, Prediction)> {
    let mut scene = Scene::new(request)?;
    // It is flown as it is: no later plan makes up for what it leaves.
    scene.pay_most();
    scene.ignore_step_limit();
    let sigma_now_m3 = scene.sigma_now_m3();
    let best = seeds::best_square_wave(&mut scene)?;
    let prediction =
        Prediction { sigma_now_m3, sigma_end_m3: best.sigma_m3, length_m: best.length_m };
    Some((best.waypoints, prediction))
}

impl Scene<'_> {
    /// The best path that is found, looking at this share of the usual number.
    fn best(&mut self, share: f64) -> Option<Path> {
        let request = self.request;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "thousands")]
        let paths = |usual: f64| (usual * share * request.settings.search_effort) as usize;
        if request.current.is_empty() && request.accounted.is_none() {
            let starts = seeds::best_of_all(self);
            search::improve(self, starts, paths(N_FRESH))
        } else {
            let n_before = self.n_looked_at;
            let starts = seeds::around_present(self, &request.current);
            let n_paths = if self.is_far_from_target() { N_FAR } else { N_AGAIN };
            let n_left = paths(n_paths).saturating_sub(self.n_looked_at - n_before);
            search::improve(self, starts, n_left)
        }
    }

    /// True if the path does not reach the target and brings too little for its length.
    fn is_small_gain(&self, best: &Path, sigma_now_m3: f64) -> bool {
        let gain = (sigma_now_m3 / best.sigma_m3).ln();
        !self.reaches_target(best) && gain < (LEAST_COST_M + best.cost_m) / scene::METRES_PER_E_FOLD
    }

    fn reaches_target(&self, best: &Path) -> bool {
        self.target_m3().is_some_and(|target_m3| best.sigma_m3 <= target_m3)
    }

    fn finished(&self, end: PlanEnd, sigma_m3: f64) -> Plan {
        let prediction =
            Prediction { sigma_now_m3: sigma_m3, sigma_end_m3: sigma_m3, length_m: 0.0 };
        Plan { waypoints: Vec::new(), end, prediction: Some(prediction) }
    }

    /// The path as waypoints that lie no further apart than a step, as many as may be flown.
    fn plan(&mut self, best: &Path, sigma_now_m3: f64) -> Plan {
        let mut waypoints: Vec<Waypoint> = Vec::new();
        let mut from = self.start;
        for to in &best.waypoints {
            waypoints.extend(self.steps(&from, to));
            from = *to;
        }
        let is_cut = waypoints.len() > self.request.n_waypoints;
        waypoints.truncate(self.request.n_waypoints);
        let end = if self.reaches_target(best) && !is_cut {
            PlanEnd::Target
        } else if waypoints.len() == self.request.n_waypoints {
            PlanEnd::Budget
        } else {
            PlanEnd::Open
        };
        // What is left out is not to be counted on.
        let flown = if is_cut { self.path(waypoints.clone(), None) } else { None };
        let flown = flown.as_ref().unwrap_or(best);
        let prediction =
            Prediction { sigma_now_m3, sigma_end_m3: flown.sigma_m3, length_m: flown.length_m };
        Plan { waypoints, end, prediction: Some(prediction) }
    }
}

#[cfg(test)]
mod tests;
