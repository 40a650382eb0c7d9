//! What looks at unseen ground, which are only thought of, leave of it.
//!
//! ```text
//!  ●            a ray sees the ground at its end if
//!    ╲ ╱╲         no unknown crest stands in the way         with probability `open`,
//!     ╳   ╲       and it stands high enough for the known    with probability `high`
//!   ╱   ╲   ?     ground in between
//! ```
//! Unknown crests are others on each side, so looks from two sides see more than one. From one side they are the same: what a
//! look sees there, a better one sees as well. What is too low for one look is too low for all that
//! reach no lower, so the best of several is as good as all of them.

use crate::mapping::matern_field::Row;

/// With which probabilities a ray sees unknown ground; it sees it if both come true.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chance {
    /// No unknown crest stands in the way.
    pub open: f64,
    /// The ground stands high enough for the known ground in between.
    pub high: f64,
}

/// What a part of a flight looks at, node by node.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Looks {
    sums: Vec<[Sums; N_SIDES]>,
}

/// Sides from which ground is looked at: quarters about the axes of the hall.
const N_SIDES: usize = 4;

/// Sums over the areas a that were looked at around a node, m².
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Sums {
    /// Σ a high.
    high_m2: f64,
    /// Σ a high².
    high_twice_m2: f64,
    /// Σ a high open.
    both_m2: f64,
}

/// What several parts of a flight are expected to leave of the open ground around a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rest {
    /// Share of its area that stays unseen.
    pub(super) area_share: f64,
    /// Share of its variance that stays.
    pub(super) var_share: f64,
}

/// One part's looks at the open ground around a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    /// Probability that the ground stands high enough for it.
    high: f64,
    /// Share of the ground that it looks at.
    covered: f64,
    /// Share that it sees of that if so.
    open: f64,
    side: usize,
}

/// What the looks from one side see of the ground around a node.
#[derive(Debug, Clone, Copy, Default)]
struct FromSide {
    /// Share of it that they look at.
    covered: f64,
    /// Share that they see.
    seen: f64,
}

/// More than this of the ground around a node must be unseen for a patch that no map knows of.
pub(super) const UNSEEN_SHARE: f64 = 0.5;
/// A smaller share of the ground around a node is too little for a patch.
const LEAST_PATCH_SHARE: f64 = 0.15;

impl Looks {
    /// None, at so many nodes.
    pub(super) fn none(n_nodes: usize) -> Self {
        Self { sums: vec![[Sums::default(); N_SIDES]; n_nodes] }
    }

    /// A look at an area, m², along `way`: x and y of the hall, m.
    pub(super) fn push(&mut self, row: &Row, area_m2: f64, chance: Chance, way: (f64, f64)) {
        let side = side_of(way);
        for (node, weight) in std::iter::zip(row.nodes, row.weights) {
            let sums = &mut self.sums[node as usize][side];
            let high_m2 = weight * area_m2 * chance.high;
            sums.high_m2 += high_m2;
            sums.high_twice_m2 += high_m2 * chance.high;
            sums.both_m2 += high_m2 * chance.open;
        }
    }
}

impl Rest {
    /// What all these looks leave of the open ground around a node, which has this area, m²; `scratch` is overwritten.
    ///
    /// ```text
    /// Σ_k (h_k − h_{k+1}) f(Π_side (1 − s_side,k)),   h_0 = 1, then falling
    /// ```
    /// - `h`: high of each look; `s_side,k`: share that the first k looks see from a side if the ground is that high
    /// - `f`: the identity for the area; the square for the variance, and none of a rest that makes no patch
    pub(super) fn of<'a>(
        looks: impl Iterator<Item = &'a Looks>,
        node: usize,
        open_m2: f64,
        scratch: &mut Vec<Look>,
    ) -> Self {
        scratch.clear();
        for looks in looks {
            let sides = looks.sums[node].iter().enumerate().filter(|(_, sums)| sums.high_m2 > 0.0);
            scratch.extend(sides.map(|(side, sums)| sums.look(open_m2, side)));
        }
        scratch.sort_by(|a, b| b.high.total_cmp(&a.high));
        let (mut area_share, mut var_share) = (0.0, 0.0);
        let (mut high, mut shaded) = (1.0, 1.0);
        let mut sides = [FromSide::default(); N_SIDES];
        for next in scratch.iter().copied().map(Some).chain([None]) {
            let next_high = next.map_or(0.0, |look| look.high);
            area_share += (high - next_high) * shaded;
            var_share +=
                (high - next_high) * if shaded > LEAST_PATCH_SHARE { shaded * shaded } else { 0.0 };
            high = next_high;
            if let Some(look) = next {
                sides[look.side].take(&look);
                shaded = sides.iter().map(FromSide::shaded).product();
            }
        }
        Self { area_share, var_share }
    }
}

impl Sums {
    /// The looks as one at open ground of this area, m².
    fn look(&self, open_m2: f64, side: usize) -> Look {
        // Of the rays of a part, those that see it more surely count more.
        let high = self.high_twice_m2 / self.high_m2;
        let covered = if open_m2 > 0.0 { (self.high_m2 / (high * open_m2)).min(1.0) } else { 1.0 };
        let open = self.both_m2 / self.high_m2;
        Look { high, covered, open, side }
    }
}

impl FromSide {
    /// What nobody has looked at from here comes first; of the rest, what a better look sees beyond the mean of the others.
    fn take(&mut self, look: &Look) {
        let new = look.covered.min(1.0 - self.covered);
        let mean_open = if self.covered > 0.0 { self.seen / self.covered } else { 0.0 };
        let better = (look.covered - new) * (look.open - mean_open).max(0.0);
        self.seen += new * look.open + better;
        self.covered += new;
    }

    /// The share that they leave.
    fn shaded(&self) -> f64 {
        (1.0 - self.seen).max(0.0)
    }
}

/// The side from which a look along this way comes.
fn side_of((x_m, y_m): (f64, f64)) -> usize {
    if x_m.abs() > y_m.abs() { usize::from(x_m > 0.0) } else { 2 + usize::from(y_m > 0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROW: Row = Row { nodes: [0, 1, 2, 3], weights: [1.0, 0.0, 0.0, 0.0] };

    const WEST: (f64, f64) = (2.0, -1.0);
    const EAST: (f64, f64) = (-2.0, 1.0);

    /// What looks of one area and chance each, the second and all later ones from the east, leave of 2 m².
    fn rest(looks: &[AreaOpenHigh]) -> Rest {
        let ways = std::iter::once(WEST).chain(std::iter::repeat(EAST));
        rest_along(&std::iter::zip(looks.iter().copied(), ways).collect::<Vec<_>>())
    }

    type AreaOpenHigh = (f64, f64, f64);

    fn rest_along(looks: &[(AreaOpenHigh, (f64, f64))]) -> Rest {
        let parts: Vec<Looks> = looks
            .iter()
            .map(|((area_m2, open, high), way)| {
                let mut part = Looks::none(4);
                part.push(&ROW, *area_m2, Chance { open: *open, high: *high }, *way);
                part
            })
            .collect();
        Rest::of(parts.iter(), 0, 2.0, &mut Vec::new())
    }

    #[test]
    fn crests_are_others_on_each_side_and_depth_is_the_same_for_all() {
        let is = |got: f64, expected: f64| assert!((got - expected).abs() < 1e-12, "{got}");
        // Not looked at, nothing is taken off.
        is(rest(&[]).var_share, 1.0);
        // 0.4 of it is shaded from each side: 0.16 from both. That share squared of the variance stays.
        let both = rest(&[(2.0, 0.6, 1.0), (2.0, 0.6, 1.0)]);
        is(both.area_share, 0.16);
        is(both.var_share, 0.16 * 0.16);
        // From one side the same crests are in the way.
        let again = rest_along(&[((2.0, 0.6, 1.0), WEST), ((2.0, 0.6, 1.0), WEST)]);
        is(again.area_share, 0.4);
        // A better look from there sees more of what it looks at.
        let better = rest_along(&[((2.0, 0.6, 1.0), WEST), ((0.5, 0.8, 1.0), WEST)]);
        is(better.area_share, 1.0 - 0.6 - 0.25 * 0.2);
        let elsewhere = rest_along(&[((1.0, 0.6, 1.0), WEST), ((0.5, 0.6, 1.0), WEST)]);
        is(elsewhere.area_share, 1.0 - 0.75 * 0.6);
        // 0.14 is no patch, and as good as seen.
        is(rest(&[(2.0, 0.65, 1.0), (2.0, 0.6, 1.0)]).var_share, 0.0);
        // Half the area looked at: 1 − 0.5 · 0.6 is shaded.
        is(rest(&[(1.0, 0.6, 1.0)]).var_share, 0.49);
        // Three looks that reach it with 0.3, 0.7 and 0.5 are as good as the best one: 0.3 stays.
        let low = rest(&[(2.0, 1.0, 0.3), (9.0, 1.0, 0.7), (2.0, 1.0, 0.5)]);
        is(low.var_share, 0.3);
        is(low.area_share, 0.3);
        // A look that cannot reach it changes nothing.
        is(rest(&[(9.0, 1.0, 0.0)]).var_share, 1.0);
        // One that hardly reaches all of it, and one that surely reaches a hundredth: with 0.9 a hundredth is seen.
        let glimpse = rest(&[(2.0, 1.0, 0.1), (0.02, 1.0, 1.0)]);
        is(glimpse.area_share, 0.9 * 0.99);
        is(glimpse.var_share, 0.9 * 0.99 * 0.99);
    }
}
