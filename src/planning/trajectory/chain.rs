//! Segments in a row, from an instant to rest.

use super::course::{self, Leg, Manner};
use super::segment::Segment;
use super::{Corridor, Knot, Limits, NoWay, SAME, brake};
use crate::geometry::{Direction, Hall, Point};
use crate::messages::Setpoint;
use crate::planning::Waypoint;
use crate::time::{Mono, Stamp};
use crate::units::wrapped_rad;
use nalgebra::Vector3;
use std::time::Duration;

/// While braking begins with motion as planned, stops are tried this far apart, s.
const BRAKE_DELAY_S: f64 = 0.05;
/// While a new way begins with motion as planned, ways are tried this far apart, s, this often.
const SWERVE_DELAY_S: f64 = 0.1;
const MAX_SWERVE_DELAYS: u32 = 5;
/// Shares of the usual speed at the ends of a leg that is not free, before it is flown straight.
const CAREFUL_SHARES: [f64; 4] = [0.6, 0.3, 0.12, 0.0];
/// A stop at every waypoint.
const STOPS: [f64; course::LOOK_AHEAD] = [0.0; course::LOOK_AHEAD];

/// Segments in a row, from an instant to rest; after its end it stays where it ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    start: Stamp<Mono>,
    legs: Vec<TimedLeg>,
    end: Knot,
    /// Waypoints that the start had reached already.
    n_reached_at_start: usize,
}

#[derive(Debug, Clone, PartialEq)]
struct TimedLeg {
    segment: Segment,
    /// Begins and ends this long after the trajectory's start.
    from_s: f64,
    to_s: f64,
    /// Waypoints reached at its end.
    n_reached: usize,
}

impl Trajectory {
    /// Keeps a place and heading.
    #[must_use]
    pub fn hold(start: Stamp<Mono>, position: Vector3<f64>, yaw_rad: f64) -> Self {
        let end = Knot::at_rest(position, yaw_rad);
        Self { start, legs: Vec::new(), end, n_reached_at_start: 0 }
    }

    /// From a state through waypoints, at rest at the last; `None` if the state leaves no way
    /// within the limits, which happens to starts that are accelerated already.
    ///
    /// At most [`Self::LOOK_AHEAD`] waypoints are looked at: the trajectory ends there.
    /// Cost: about 20 µs per waypoint.
    #[must_use]
    pub fn through(
        start: Stamp<Mono>,
        from: &Knot,
        waypoints: &[Waypoint],
        limits: &Limits,
    ) -> Option<Self> {
        Self::in_manner(start, from, waypoints, limits, &[])
    }

    /// Waypoints that a trajectory goes through at most.
    pub const LOOK_AHEAD: usize = course::LOOK_AHEAD;

    fn in_manner(
        start: Stamp<Mono>,
        from: &Knot,
        waypoints: &[Waypoint],
        limits: &Limits,
        shares: &[f64],
    ) -> Option<Self> {
        let legs = |shares| course::legs(from, waypoints, limits, Manner { shares });
        // From rest the straight legs with stops can always be flown.
        let (n_here, legs) = legs(shares).or_else(|| legs(&STOPS))?;
        let mut trajectory = Self::hold(start, from.position, from.yaw.angle_rad);
        trajectory.n_reached_at_start = n_here;
        trajectory.append(legs);
        Some(trajectory)
    }

    /// The straight legs through the waypoints from rest, with a stop at each; `None` if `from` is
    /// not at rest and leaves no way.
    #[must_use]
    pub fn straight(
        start: Stamp<Mono>,
        from: &Knot,
        waypoints: &[Waypoint],
        limits: &Limits,
    ) -> Option<Self> {
        Self::in_manner(start, from, waypoints, limits, &STOPS)
    }

    /// [`Self::through`], with a curve that is free.
    ///
    /// Legs that are not free are flown slower at their ends, which draws them to the straight
    /// line, and at last straight with a stop at both ends.
    ///
    /// # Errors
    /// No way within the limits, or a straight leg that is not free.
    pub fn through_free(
        start: Stamp<Mono>,
        from: &Knot,
        waypoints: &[Waypoint],
        limits: &Limits,
        corridor: &Corridor<'_>,
    ) -> Result<Self, NoWay> {
        let waypoints = &waypoints[..waypoints.len().min(Self::LOOK_AHEAD)];
        let mut shares = vec![1.0; waypoints.len()];
        // Each round slows at least one waypoint down by one step.
        loop {
            let trajectory =
                Self::in_manner(start, from, waypoints, limits, &shares).ok_or(NoWay::TooFast)?;
            let blocked = trajectory.blocked_waypoints(corridor);
            let Some(&waypoint) = blocked.first() else { return Ok(trajectory) };
            if !slow_ends(&mut shares, &blocked) {
                return Err(NoWay::Blocked { waypoint });
            }
        }
    }

    /// The waypoints whose legs are not free, in order.
    fn blocked_waypoints(&self, corridor: &Corridor<'_>) -> Vec<usize> {
        let mut n_before = self.n_reached_at_start;
        let mut blocked = Vec::new();
        for leg in &self.legs {
            if blocked.last() != Some(&n_before) && !corridor.holds(&leg.segment) {
                blocked.push(n_before);
            }
            n_before = leg.n_reached;
        }
        blocked
    }

    /// A new way from the present motion on, without a jump in anything up to the jerk.
    ///
    /// Where the present state leaves no free way within the limits, the present trajectory is
    /// flown on for up to half a second first, or left by a stop.
    ///
    /// - `waypoints`: those ahead at `at`
    /// - `corridor`: what the new way must keep clear of, if anything
    ///
    /// # Errors
    /// None of that leads anywhere yet. The present trajectory stays good.
    pub fn replanned(
        &self,
        at: Stamp<Mono>,
        waypoints: &[Waypoint],
        limits: &Limits,
        corridor: Option<&Corridor<'_>>,
    ) -> Result<Self, NoWay> {
        let onward = |then, from: &Knot, waypoints| match corridor {
            Some(corridor) => Self::through_free(then, from, waypoints, limits, corridor),
            None => Self::through(then, from, waypoints, limits).ok_or(NoWay::TooFast),
        };
        let left_s = self.end_at().seconds_since(at).max(0.0);
        let n_shared = self.n_shared(at, waypoints);
        let swerved = (0..=MAX_SWERVE_DELAYS)
            .map(|k| f64::from(k) * SWERVE_DELAY_S)
            .take_while(|delay_s| *delay_s <= left_s)
            .map(|delay_s| at.plus(Duration::from_secs_f64(delay_s)))
            .map(|then| (then, self.n_reached(then) - self.n_reached(at)))
            .take_while(|(_, n_passed)| *n_passed <= n_shared && *n_passed < waypoints.len())
            .find_map(|(then, n_passed)| {
                let onward = onward(then, &self.knot_at(then), &waypoints[n_passed..]).ok()?;
                Some(self.until(at, then).followed_by(&onward))
            });
        if let Some(swerved) = swerved {
            return Ok(swerved);
        }
        let stop = self.braked(at, limits);
        if corridor
            .is_some_and(|corridor| !stop.legs.iter().all(|leg| corridor.holds(&leg.segment)))
        {
            return Err(NoWay::Blocked { waypoint: 0 });
        }
        let onward = onward(stop.end_at(), stop.end(), waypoints)?;
        Ok(stop.followed_by(&onward))
    }

    /// Stops within the limits; begins at `at` with motion as planned for as long as it must.
    #[must_use]
    pub fn braked(&self, at: Stamp<Mono>, limits: &Limits) -> Self {
        let left_s = self.end_at().seconds_since(at).max(0.0);
        (0..)
            .map(|k| f64::from(k) * BRAKE_DELAY_S)
            .take_while(|delay_s| *delay_s < left_s)
            .map(|delay_s| at.plus(Duration::from_secs_f64(delay_s)))
            .find_map(|then| {
                let stop = brake::gentle(&self.knot_at(then), limits)?;
                Some(self.until(at, then).ended_by(stop))
            })
            // It ends at rest by itself.
            .unwrap_or_else(|| self.until(at, self.end_at().max(at)))
    }

    /// Stops from any state at once, as hard as an emergency allows: [`Limits::in_emergency`].
    #[must_use]
    pub fn emergency_stop(at: Stamp<Mono>, from: &Knot, limits: &Limits) -> Self {
        Self::hold(at, from.position, from.yaw.angle_rad).ended_by(brake::emergency(from, limits))
    }

    /// How many of these waypoints are the next ones of this trajectory, too.
    fn n_shared(&self, at: Stamp<Mono>, waypoints: &[Waypoint]) -> usize {
        let seconds = at.seconds_since(self.start);
        let mut n_before = self.n_reached(at);
        let own = self.legs.iter().filter(|leg| leg.to_s > seconds).filter(|leg| {
            let n_new = leg.n_reached.saturating_sub(n_before);
            n_before = n_before.max(leg.n_reached);
            n_new == 1
        });
        let is_same = |(leg, waypoint): &(&TimedLeg, &Waypoint)| {
            let end = leg.segment.knot_after(leg.segment.duration_s());
            (end.position - waypoint.place.coords).norm() < SAME
                && wrapped_rad(end.yaw.angle_rad - waypoint.yaw_rad).abs() < SAME
        };
        own.zip(waypoints).take_while(is_same).count()
    }

    /// The part from an instant to another one, as a trajectory of its own. It stops short there:
    /// something has to follow.
    fn until(&self, from: Stamp<Mono>, to: Stamp<Mono>) -> Self {
        let first = self.knot_at(from);
        let mut part = Self::hold(from, first.position, first.yaw.angle_rad);
        if to <= from {
            return part;
        }
        let (from_s, to_s) = (from.seconds_since(self.start), to.seconds_since(self.start));
        let n_before = self.n_reached(from);
        let n_passed = self.n_reached(to) - n_before;
        let legs = self.legs.iter().filter(|leg| leg.to_s > from_s && leg.from_s < to_s);
        part.append(legs.map(|leg| Leg {
            segment: leg.segment.part(from_s - leg.from_s, to_s - leg.from_s),
            n_reached: (leg.n_reached - n_before).min(n_passed),
        }));
        part
    }

    fn ended_by(mut self, segment: Segment) -> Self {
        let n_reached = self.n_waypoints();
        self.append([Leg { segment, n_reached }]);
        self
    }

    fn followed_by(mut self, onward: &Self) -> Self {
        let n_before = self.n_waypoints();
        match self.legs.last_mut() {
            Some(last) => last.n_reached += onward.n_reached_at_start,
            None => return onward.clone(),
        }
        self.append(
            onward.legs.iter().map(|leg| Leg {
                segment: leg.segment.clone(),
                n_reached: n_before + leg.n_reached,
            }),
        );
        self
    }

    fn append(&mut self, legs: impl IntoIterator<Item = Leg>) {
        let mut from_s = self.duration_s();
        for Leg { segment, n_reached } in legs {
            let to_s = from_s + segment.duration_s();
            self.end = segment.knot_after(segment.duration_s());
            self.legs.push(TimedLeg { segment, from_s, to_s, n_reached });
            from_s = to_s;
        }
        self.end = Knot::at_rest(self.end.position, self.end.yaw.angle_rad);
    }

    /// The state at an instant; past the end it rests there, before the start it waits.
    #[must_use]
    pub fn knot_at(&self, at: Stamp<Mono>) -> Knot {
        let seconds = at.seconds_since(self.start).max(0.0);
        match self.legs.get(self.legs.partition_point(|leg| leg.to_s <= seconds)) {
            Some(leg) => leg.segment.knot_after(seconds - leg.from_s),
            None => self.end,
        }
    }

    /// The setpoint at an instant.
    #[must_use]
    pub fn setpoint_at(&self, at: Stamp<Mono>) -> Setpoint {
        let knot = self.knot_at(at);
        Setpoint {
            at,
            position: Point::from_coords(knot.position),
            velocity_mps: Direction::<Hall>::from_coords(knot.velocity),
            accel_mps2: Direction::from_coords(knot.accel),
            yaw_rad: wrapped_rad(knot.yaw.angle_rad),
            yaw_rate_radps: knot.yaw.rate_radps,
        }
    }

    /// How many of the waypoints are reached at an instant.
    #[must_use]
    pub fn n_reached(&self, at: Stamp<Mono>) -> usize {
        let seconds = at.seconds_since(self.start);
        let n_over = self.legs.partition_point(|leg| leg.to_s <= seconds);
        match n_over.checked_sub(1) {
            Some(last) => self.legs[last].n_reached,
            None => self.n_reached_at_start,
        }
    }

    /// How many waypoints are reached at the end.
    #[must_use]
    pub fn n_waypoints(&self) -> usize {
        self.legs.last().map_or(self.n_reached_at_start, |leg| leg.n_reached)
    }

    /// When each of its segments ends, in order.
    pub fn joints(&self) -> impl Iterator<Item = Stamp<Mono>> + '_ {
        self.legs.iter().map(|leg| self.start.plus(Duration::from_secs_f64(leg.to_s)))
    }

    /// How far the curve leaves the straight lines between the waypoints, m: a bound from above,
    /// to a millimetre.
    ///
    /// Ramps and cruise count as legs of their own, which lie on those lines.
    #[must_use]
    pub fn departure_m(&self) -> f64 {
        self.legs.iter().map(|leg| leg.segment.departure_m()).fold(0.0, f64::max)
    }

    /// The state of rest at the end.
    #[must_use]
    pub const fn end(&self) -> &Knot {
        &self.end
    }

    /// When the trajectory ends.
    #[must_use]
    pub fn end_at(&self) -> Stamp<Mono> {
        self.start.plus(Duration::from_secs_f64(self.duration_s()))
    }

    /// True once its end is reached.
    #[must_use]
    pub fn is_over(&self, at: Stamp<Mono>) -> bool {
        at >= self.end_at()
    }

    /// How long the trajectory takes, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.legs.last().map_or(0.0, |leg| leg.to_s)
    }
}

/// Slows the waypoints at both ends of these legs down by one step; false if all of them are stops
/// already.
fn slow_ends(shares: &mut [f64], legs: &[usize]) -> bool {
    let mut has_slowed = false;
    for (k, share) in shares.iter_mut().enumerate() {
        let is_end = legs.contains(&k) || legs.contains(&(k + 1));
        let next = CAREFUL_SHARES.into_iter().find(|careful| careful < share);
        if let Some(next) = next.filter(|_| is_end) {
            *share = next;
            has_slowed = true;
        }
    }
    has_slowed
}
