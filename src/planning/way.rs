//! A short free way from one place to another, around what stands between.
//!
//! A* over the nodes of a lattice (26 neighbours, straight distance as the bound), then corners are
//! cut as long as the straight way is free. Every piece of the answer is judged by the same rule as
//! any other way, so what the lattice lacks in fineness costs length, never clearance.
//!
//! Source: Hart, Nilsson, Raphael 1968.

use super::Waypoint;
use super::clearance::Shortfall;
use super::free_space::FreeSpace;
use super::grid_axis::Axis;
use crate::geometry::Point;
use nalgebra::Vector3;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// What a way must keep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Demand {
    /// Free space: clear of everything, and a fix good enough all along.
    Free,
    /// Clear of everything; the fix does not matter.
    Clear,
}

/// The waypoints after `from`, the last of them `to`; `None` if there is no way.
///
/// An end that is itself nearer to something than allowed, such as a pad beside a wall, may be left
/// and reached by ways that are no nearer than it is. The heading of `to` holds all along.
#[must_use]
pub fn way(space: &FreeSpace, from: &Waypoint, to: &Waypoint) -> Option<Vec<Waypoint>> {
    way_within(space, from, to, Demand::Free)
}

/// The same under another demand.
#[must_use]
pub fn way_within(
    space: &FreeSpace,
    from: &Waypoint,
    to: &Waypoint,
    demand: Demand,
) -> Option<Vec<Waypoint>> {
    let search = Search::new(space, from, to, demand);
    if search.is_leg_free(END_FROM, END_TO) {
        return Some(vec![*to]);
    }
    let corners = search.smoothed(&search.shortest()?);
    Some(corners.into_iter().skip(1).map(|node| search.waypoint(node)).collect())
}

/// The lattice is this much finer than the grid of the fixes.
const FINER: f64 = 0.5;
/// Numbers of the two ends, before those of the lattice.
const END_FROM: usize = 0;
const END_TO: usize = 1;
const N_ENDS: usize = 2;

struct Search<'a> {
    space: &'a FreeSpace,
    demand: Demand,
    ends: [Waypoint; N_ENDS],
    /// What the ends lack themselves.
    shortfalls: [Shortfall; N_ENDS],
    axes: [Axis; 3],
}

/// A node with the length of the way over it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Open {
    bound_m: f64,
    node: usize,
}

impl Eq for Open {}

impl Ord for Open {
    /// The shortest first; equal ones by their number, so that the answer is always the same.
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound_m.total_cmp(&self.bound_m).then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<'a> Search<'a> {
    fn new(space: &'a FreeSpace, from: &Waypoint, to: &Waypoint, demand: Demand) -> Self {
        let from = Waypoint { yaw_rad: to.yaw_rad, ..*from };
        let ends = [from, *to];
        let places = ends.map(|end| end.place.coords);
        let axes = space.quality().axes();
        let finer = |axis: &Axis| Axis {
            first: axis.first,
            step: axis.step * FINER,
            n: (axis.n - 1) * 2 + 1,
        };
        let shortfalls = places.map(|place| space.clearance().shortfall(&place, &place));
        Self { space, demand, ends, shortfalls, axes: [finer(&axes.x), finer(&axes.y), axes.z] }
    }

    fn n_nodes(&self) -> usize {
        N_ENDS + self.axes[0].n * self.axes[1].n * self.axes[2].n
    }

    fn counts(&self, node: usize) -> [usize; 3] {
        let index = node - N_ENDS;
        let [x, y, _] = self.axes;
        [index % x.n, index / x.n % y.n, index / x.n / y.n]
    }

    fn place(&self, node: usize) -> Vector3<f64> {
        if node < N_ENDS {
            return self.ends[node].place.coords;
        }
        let [i, j, k] = self.counts(node);
        Vector3::new(self.axes[0].at(i), self.axes[1].at(j), self.axes[2].at(k))
    }

    fn waypoint(&self, node: usize) -> Waypoint {
        Waypoint { place: Point::from_coords(self.place(node)), yaw_rad: self.ends[1].yaw_rad }
    }

    /// What a way to or from a node may lack: what an end lacks itself.
    fn allowed(&self, node: usize) -> Shortfall {
        let short = if node < N_ENDS { self.shortfalls[node] } else { Shortfall::NONE };
        // Never through a wall, whatever the end lacks.
        let around_m = if short.around_m.is_finite() { short.around_m } else { 0.0 };
        Shortfall { around_m, ..short }
    }

    fn is_leg_free(&self, a: usize, b: usize) -> bool {
        let (of_a, of_b) = (self.allowed(a), self.allowed(b));
        let allowed = Shortfall {
            around_m: of_a.around_m.max(of_b.around_m),
            below_m: of_a.below_m.max(of_b.below_m),
        };
        let (p, q) = (self.place(a), self.place(b));
        self.space.clearance().shortfall(&p, &q).is_within(&allowed)
            && (self.demand == Demand::Clear || self.has_fix_along(a, b))
    }

    /// The fix along a leg; an end without one, such as a pad, may be left and reached.
    fn has_fix_along(&self, a: usize, b: usize) -> bool {
        let is_end_without = |node: usize| {
            node < N_ENDS
                && !self.space.quality().is_better(&self.ends[node], self.space.min_quality())
        };
        is_end_without(a)
            || is_end_without(b)
            || self.space.has_fix_along(&self.waypoint(a), &self.waypoint(b))
    }

    /// The nodes of the shortest way over the lattice, both ends included.
    fn shortest(&self) -> Option<Vec<usize>> {
        let mut length_m = vec![f64::INFINITY; self.n_nodes()];
        let mut before = vec![END_FROM; self.n_nodes()];
        let mut is_done = vec![false; self.n_nodes()];
        let goal = self.place(END_TO);
        let mut open = BinaryHeap::new();
        length_m[END_FROM] = 0.0;
        open.push(Open { bound_m: 0.0, node: END_FROM });
        while let Some(Open { node, .. }) = open.pop() {
            if node == END_TO {
                return Some(traced(&before));
            }
            if std::mem::replace(&mut is_done[node], true) {
                continue;
            }
            for next in self.neighbours(node) {
                let leg_m = (self.place(next) - self.place(node)).norm();
                let over_m = length_m[node] + leg_m;
                if is_done[next] || over_m >= length_m[next] || !self.is_leg_free(node, next) {
                    continue;
                }
                length_m[next] = over_m;
                before[next] = node;
                let bound_m = over_m + (goal - self.place(next)).norm();
                open.push(Open { bound_m, node: next });
            }
        }
        None
    }

    /// The lattice around a node, and the goal where it is near; around the start, and so that the
    /// goal is found from every side, two nodes far.
    fn neighbours(&self, node: usize) -> Vec<usize> {
        let here = self.place(node);
        let reach = if node < N_ENDS { 2 } else { 1 };
        let ranges: [Vec<usize>; 3] = [0, 1, 2].map(|axis| self.near(axis, here[axis], reach));
        let mut near = Vec::with_capacity(28);
        for &k in &ranges[2] {
            for &j in &ranges[1] {
                for &i in &ranges[0] {
                    let index = (k * self.axes[1].n + j) * self.axes[0].n + i;
                    if index + N_ENDS != node {
                        near.push(index + N_ENDS);
                    }
                }
            }
        }
        let goal = self.place(END_TO);
        let is_near = (0..3).all(|axis| {
            let off = (goal[axis] - here[axis]).abs() / self.axes[axis].step;
            // Heights outside of the lattice, as over a pad, are reached from its edge.
            off <= 2.0
                || (axis == 2
                    && self.near(axis, goal.z, 1).contains(&self.axes[axis].nearest(here.z)))
        });
        if node != END_TO && is_near {
            near.push(END_TO);
        }
        near
    }

    /// The nodes of one axis within so many steps of a value, at least the nearest.
    fn near(&self, axis: usize, value: f64, reach: usize) -> Vec<usize> {
        let nearest = self.axes[axis].nearest(value);
        let last = self.axes[axis].n - 1;
        (nearest.saturating_sub(reach)..=(nearest + reach).min(last)).collect()
    }

    /// From each corner straight to the furthest one that can be seen.
    fn smoothed(&self, nodes: &[usize]) -> Vec<usize> {
        let mut corners = vec![nodes[0]];
        let mut at = 0;
        while at + 1 < nodes.len() {
            let furthest =
                (at + 2..nodes.len()).rev().find(|&to| self.is_leg_free(nodes[at], nodes[to]));
            at = furthest.unwrap_or(at + 1);
            corners.push(nodes[at]);
        }
        corners
    }
}

/// The way that ends at the goal, from its start.
fn traced(before: &[usize]) -> Vec<usize> {
    let mut nodes = vec![END_TO];
    while let Some(&node) = nodes.last()
        && node != END_FROM
    {
        nodes.push(before[node]);
    }
    nodes.reverse();
    nodes
}

#[cfg(test)]
mod tests;
