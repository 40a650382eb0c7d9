//! What stays the same while paths are compared: the map, the free space, the target.

use super::path::Path;
use crate::mapping::KnownHeights;
use crate::mapping::belief::{CoarseField, Sightings};
use crate::planning::Waypoint;
use crate::planning::planner::{Belief, PlanRequest};
use crate::planning::sight::Sight;
use crate::planning::way::way;
use crate::units::wrapped_rad;
use std::sync::Arc;

/// Λ: metres that one e-fold of σ^V is worth at most.
pub(super) const METRES_PER_E_FOLD: f64 = 150.0;
/// The same on the way to a target: low enough that the length is felt.
const METRES_PER_E_FOLD_TO_TARGET: f64 = 40.0;
/// The plan aims this far below the target: of thousands of paths the best is mostly one that is thought too well of.
const AIM_SHARE: f64 = 0.75;
/// σ^V of accounts over that of the coarse lattice before there is an account.
const USUAL_SCALE: f64 = 1.15;
/// Bounds of that ratio: beyond them the lattice says nothing of this map.
const SCALES: (f64, f64) = (0.5, 10.0);
/// Waiting for a turn costs this share of the metres that would be flown meanwhile: what counts is the way, but nobody hovers
/// for it without end.
const WAITING_SHARE: f64 = 0.15;
/// With a σ^V so many times the target's, paths are looked for that have nothing in common with the present plan.
const FAR_TARGETS: f64 = 4.0;
/// Turning costs a little even where it takes no time, m/rad: of equal paths the calmer one.
const TURN_COST_M: f64 = 0.05;
/// A waypoint costs a little, m.
const WAYPOINT_COST_M: f64 = 0.05;

/// By how much the heading changes, rad.
fn turn_rad(from: &Waypoint, to: &Waypoint) -> f64 {
    wrapped_rad(to.yaw_rad - from.yaw_rad).abs()
}

/// The request with what follows from it.
pub(super) struct Scene<'a> {
    pub(super) request: &'a PlanRequest,
    field: &'a CoarseField,
    sight: Sight,
    heights: Option<KnownHeights>,
    /// The map, and what each leg along the pending waypoints will see.
    known: Vec<Sightings>,
    seen_var_m6: f64,
    /// The same after the pending waypoints, m⁶.
    pending_var_m6: f64,
    /// σ^V of the account over that of the coarse lattice for the same data.
    scale: f64,
    /// Where the plan begins.
    pub(super) start: Waypoint,
    /// Λ, m.
    e_fold_m: f64,
    /// Steps that a path may have.
    most_steps: f64,
    /// Paths looked at.
    pub(super) n_looked_at: usize,
}

impl<'a> Scene<'a> {
    /// None if the request has no place to start from, no field, or a field that cannot be solved.
    #[expect(clippy::cast_precision_loss, reason = "thousands of steps")]
    pub(super) fn new(request: &'a PlanRequest) -> Option<Self> {
        let Belief::Field { field, surface } = &request.belief else { return None };
        let start = *request.pending.last()?;
        let settings = &request.settings;
        let drop_m = settings.height_m - settings.nominal_height_m;
        let sight = Sight::new(
            &request.lidar,
            drop_m,
            settings.nominal_height_m,
            settings.slope_sigma,
            settings.fix_var_share,
        )
        .among(&settings.space);
        let heights = settings.sees_shadows.then(|| surface.known_heights()).flatten();
        let mut known = vec![field.seen(surface, None)];
        let seen_var_m6 = field.volume_var(&[&known[0]]).ok()?.total_m6();
        let scale = request.accounted.map_or(USUAL_SCALE, |account| {
            let then = field.volume_var(&[&field.seen(surface, Some(account.at))]);
            let flown_m6 = account.sigma_m3.powi(2) - request.constant_var_m6;
            let scale = then.map(|then| (flown_m6 / then.total_m6()).sqrt());
            scale
                .ok()
                .filter(|s| s.is_finite())
                .map_or(USUAL_SCALE, |s| s.clamp(SCALES.0, SCALES.1))
        });
        for pair in request.pending.windows(2) {
            let leg =
                sight.on_way(field, &request.free_space, heights.as_ref(), (&pair[0], &pair[1]));
            known.push(leg);
        }
        let pending_var_m6 = field.volume_var(&known.iter().collect::<Vec<_>>()).ok()?.total_m6();
        Some(Self {
            request,
            field,
            sight,
            heights,
            known,
            seen_var_m6,
            pending_var_m6,
            scale,
            start,
            e_fold_m: if settings.target_ratio.is_some() {
                METRES_PER_E_FOLD_TO_TARGET
            } else {
                METRES_PER_E_FOLD
            },
            most_steps: request.n_waypoints as f64,
            n_looked_at: 0,
        })
    }

    /// From now on an e-fold is worth as much as it is at most: paths have other scores. False if it is already.
    pub(super) fn pay_most(&mut self) -> bool {
        std::mem::replace(&mut self.e_fold_m, METRES_PER_E_FOLD) < METRES_PER_E_FOLD
    }

    /// From now on paths may have any number of steps: who asks stretches them, or flies the beginning.
    pub(super) fn ignore_step_limit(&mut self) {
        self.most_steps = f64::INFINITY;
    }

    /// True if flying this path is better than ending at the last pending waypoint.
    pub(super) fn pays(&self, path: &Path) -> bool {
        path.score < self.score(0.0, self.sigma_of_m3(self.pending_var_m6))
    }

    /// σ^V of what is seen already, m³.
    pub(super) fn sigma_now_m3(&self) -> f64 {
        self.sigma_of_m3(self.seen_var_m6)
    }

    /// σ^V to reach, m³.
    pub(super) fn target_m3(&self) -> Option<f64> {
        self.request.settings.target_ratio.map(|ratio| ratio * self.request.volume_m3.abs())
    }

    /// The lowest and the highest level that fixes are known for, m.
    pub(super) fn heights_m(&self) -> (f64, f64) {
        let z = self.request.free_space.quality().axes().z;
        (z.first, z.last())
    }

    /// True if there is a choice of heights.
    pub(super) fn has_heights(&self) -> bool {
        self.request.free_space.quality().axes().z.n > 1
    }

    /// Metres at cruise in the time that a turn takes longer than the leg.
    fn waiting_m(&self, from: &Waypoint, to: &Waypoint) -> f64 {
        let limits = &self.request.settings.limits;
        let turn_m = limits.speed_mps * turn_rad(from, to) / limits.yaw_rate_radps;
        (turn_m - from.distance_m(to)).max(0.0)
    }

    /// What a leg costs in metres.
    fn leg_cost_m(&self, from: &Waypoint, to: &Waypoint) -> f64 {
        from.distance_m(to)
            + WAITING_SHARE * self.waiting_m(from, to)
            + TURN_COST_M * turn_rad(from, to)
            + WAYPOINT_COST_M
    }

    /// The waypoints of a straight leg, no further apart than a step.
    pub(super) fn steps(&self, from: &Waypoint, to: &Waypoint) -> Vec<Waypoint> {
        from.steps_to(to, self.request.settings.step_radius_m)
    }

    /// True if their steps are no more than may still be flown.
    fn is_within_steps(&self, waypoints: &[Waypoint]) -> bool {
        let step_m = self.request.settings.step_radius_m;
        self.sum_of_legs(waypoints, |from, to| from.n_steps_to(to, step_m)) <= self.most_steps
    }

    /// As far on the straight way there as the steps last that may still be flown.
    pub(super) fn within_steps(&self, to: &Waypoint) -> Waypoint {
        let longest_m = self.most_steps * self.request.settings.step_radius_m;
        let share = longest_m / self.start.distance_m(to);
        if share < 1.0 { self.start.towards(to, share) } else { *to }
    }

    /// True if one may fly straight from one to the other, step by step as it will be flown.
    pub(super) fn is_open(&self, from: &Waypoint, to: &Waypoint) -> bool {
        let free_space = &self.request.free_space;
        let mut before = *from;
        self.steps(from, to).iter().all(|step| {
            let is_open = free_space.is_free(step) && free_space.is_way_free(&before, step);
            before = *step;
            is_open
        })
    }

    /// The waypoints with ways around what stands between them; those that cannot be reached are left
    /// out.
    pub(super) fn joined(&self, waypoints: &[Waypoint]) -> Vec<Waypoint> {
        let mut joined = Vec::with_capacity(waypoints.len());
        let mut from = self.start;
        for to in waypoints.iter().filter(|to| self.request.free_space.is_free(to)) {
            if self.is_open(&from, to) {
                joined.push(*to);
            } else if let Some(corners) = way(&self.request.free_space, &from, to) {
                joined.extend(corners);
            } else {
                continue;
            }
            from = *to;
        }
        joined
    }

    /// Metres from a waypoint to where the way home ends; ways around are not looked for.
    pub(super) fn way_home_m(&self, from: &Waypoint) -> f64 {
        self.request.over_home.map_or(0.0, |home| (home - from.place).coords.norm())
    }

    /// What would be seen on a leg.
    pub(super) fn look(&self, from: &Waypoint, to: &Waypoint) -> Arc<Sightings> {
        let free_space = &self.request.free_space;
        Arc::new(self.sight.on_way(self.field, free_space, self.heights.as_ref(), (from, to)))
    }

    /// True if the battery lasts for these waypoints, the last of which is given, and the way home, and they come to no more
    /// steps than are left.
    pub(super) fn is_within_reach(&self, waypoints: &[Waypoint], last: &Waypoint) -> bool {
        if !self.is_within_steps(waypoints) {
            return false;
        }
        // Hovering empties the battery as flying does.
        let flown_m =
            self.sum_of_legs(waypoints, |from, to| from.distance_m(to) + self.waiting_m(from, to));
        let needed_m = flown_m + self.way_home_m(last);
        self.request.longest_m.is_none_or(|longest_m| needed_m <= longest_m)
    }

    /// The path of these waypoints; legs that it shares with `like` are taken from there. None if it
    /// leaves the free space or is too long.
    pub(super) fn path(&mut self, waypoints: Vec<Waypoint>, like: Option<&Path>) -> Option<Path> {
        self.path_below(f64::INFINITY, waypoints, like)
    }

    /// The same, if it scores less than this.
    pub(super) fn path_below(
        &mut self,
        score: f64,
        waypoints: Vec<Waypoint>,
        like: Option<&Path>,
    ) -> Option<Path> {
        let length_m = self.length_m(&waypoints);
        if !self.is_within_reach(&waypoints, waypoints.last()?) {
            return None;
        }
        let mut from = self.start;
        let mut legs = Vec::with_capacity(waypoints.len());
        for to in &waypoints {
            let known = like.and_then(|like| self.same_leg(like, &from, to));
            if known.is_none() && !self.is_open(&from, to) {
                return None;
            }
            legs.push(known.unwrap_or_else(|| self.look(&from, to)));
            from = *to;
        }
        let cost_m = self.cost_m(&waypoints);
        if score < f64::INFINITY && self.score(cost_m, self.least_sigma_m3(&legs)) >= score {
            return None;
        }
        let sigma_m3 = self.sigma_m3(&legs)?;
        let path = Path {
            score: self.score(cost_m, sigma_m3),
            waypoints,
            legs,
            length_m,
            cost_m,
            sigma_m3,
        };
        (path.score < score).then_some(path)
    }

    fn same_leg(&self, like: &Path, from: &Waypoint, to: &Waypoint) -> Option<Arc<Sightings>> {
        let mut before = &self.start;
        for (waypoint, leg) in std::iter::zip(&like.waypoints, &like.legs) {
            if before == from && waypoint == to {
                return Some(Arc::clone(leg));
            }
            before = waypoint;
        }
        None
    }

    /// σ^V after the pending waypoints and these legs, m³.
    pub(super) fn sigma_m3(&mut self, legs: &[Arc<Sightings>]) -> Option<f64> {
        self.n_looked_at += 1;
        let var = self.field.volume_var(&self.all_seen(legs)).ok()?;
        // What is no number must not score as if the target were reached.
        Some(self.sigma_of_m3(var.total_m6())).filter(|sigma_m3| sigma_m3.is_finite())
    }

    /// It is not less than this, m³.
    fn least_sigma_m3(&self, legs: &[Arc<Sightings>]) -> f64 {
        self.sigma_of_m3(self.field.least_volume_var_m6(&self.all_seen(legs)))
    }

    fn all_seen<'b>(&'b self, legs: &'b [Arc<Sightings>]) -> Vec<&'b Sightings> {
        self.known.iter().chain(legs.iter().map(Arc::as_ref)).collect()
    }

    /// True while so much is unknown that what is planned may have to be turned over.
    pub(super) fn is_far_from_target(&self) -> bool {
        let far_m3 = self.target_m3().map(|target_m3| FAR_TARGETS * target_m3);
        far_m3.is_some_and(|far_m3| self.sigma_now_m3() > far_m3)
    }

    /// σ^V as an account would have it.
    fn sigma_of_m3(&self, var_m6: f64) -> f64 {
        (var_m6 * self.scale.powi(2) + self.request.constant_var_m6).sqrt()
    }

    pub(super) fn length_m(&self, waypoints: &[Waypoint]) -> f64 {
        self.sum_of_legs(waypoints, |from, to| from.distance_m(to))
    }

    pub(super) fn cost_m(&self, waypoints: &[Waypoint]) -> f64 {
        self.sum_of_legs(waypoints, |from, to| self.leg_cost_m(from, to))
    }

    fn sum_of_legs(
        &self,
        waypoints: &[Waypoint],
        of_leg: impl Fn(&Waypoint, &Waypoint) -> f64,
    ) -> f64 {
        let before = std::iter::once(&self.start).chain(waypoints);
        std::iter::zip(before, waypoints).map(|(from, to)| of_leg(from, to)).sum()
    }

    /// What the search makes small, m.
    pub(super) fn score(&self, cost_m: f64, sigma_m3: f64) -> f64 {
        let aim_m3 = self.target_m3().map_or(1e-3, |target_m3| AIM_SHARE * target_m3);
        cost_m + self.e_fold_m * (sigma_m3 / aim_m3).ln().max(0.0)
    }

    /// True if no more flying is needed: by what is aimed at, and by the newest account, which has the last word.
    pub(super) fn is_enough_by_account(&self, sigma_m3: f64) -> bool {
        let ratio = self.request.settings.target_ratio;
        let is_left = ratio
            .zip(self.request.accounted)
            .is_some_and(|(ratio, account)| sigma_m3 > ratio * account.volume_m3.abs());
        self.is_enough(sigma_m3) && !is_left
    }

    /// True if the path reaches what is aimed at.
    pub(super) fn is_enough(&self, sigma_m3: f64) -> bool {
        self.target_m3().is_some_and(|target_m3| sigma_m3 <= AIM_SHARE * target_m3)
    }
}
