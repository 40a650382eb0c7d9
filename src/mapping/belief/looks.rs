//! What looks at unseen ground, which are only thought of, leave of it.
//!
//! ```text
//!  ●            a ray sees the ground at its end if
//!    ╲ ╱╲         no unknown crest stands in the way         with probability `open`,
//!     ╳   ╲       and it stands high enough for the known    with probability `high`
//!   ╱   ╲   ?     ground in between
//! ```
//! Unknown crests are others for each look, so looks from two ways see more than one. What is too low for one look is
//! too low for all that reach no lower, so the best of several is as good as all of them.

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
    sums: Vec<Sums>,
}

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
    /// Share of the ground that it sees if so.
    seen_share: f64,
}

/// More than this of the ground around a node must be unseen for a patch.
pub(super) const UNSEEN_SHARE: f64 = 0.5;
/// Ground of whose variance less than this stays is as good as seen.
const LEAST_VAR_SHARE: f64 = 0.1;

impl Looks {
    /// None, at so many nodes.
    pub(super) fn none(n_nodes: usize) -> Self {
        Self { sums: vec![Sums::default(); n_nodes] }
    }

    /// A look at an area, m².
    pub(super) fn push(&mut self, row: &Row, area_m2: f64, chance: Chance) {
        for (node, weight) in std::iter::zip(row.nodes, row.weights) {
            let sums = &mut self.sums[node as usize];
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
    /// Σ_k (h_k − h_{k+1}) f(Π_{l≤k} (1 − s_l)),   h_0 = 1, then falling
    /// ```
    /// - `h`: high of each look; `s`: share that it sees if the ground is that high
    /// - `f`: the identity for the area; the square for the variance, and none of a rest that makes no patch
    pub(super) fn of<'a>(
        looks: impl Iterator<Item = &'a Looks>,
        node: usize,
        open_m2: f64,
        scratch: &mut Vec<Look>,
    ) -> Self {
        scratch.clear();
        let sums = looks.map(|looks| looks.sums[node]).filter(|sums| sums.high_m2 > 0.0);
        scratch.extend(sums.map(|sums| sums.look(open_m2)));
        scratch.sort_by(|a, b| b.high.total_cmp(&a.high));
        let (mut area_share, mut var_share) = (0.0, 0.0);
        let (mut high, mut shaded) = (1.0, 1.0);
        for next in scratch.iter().copied().map(Some).chain([None]) {
            let next_high = next.map_or(0.0, |look| look.high);
            area_share += (high - next_high) * shaded;
            var_share +=
                (high - next_high) * if shaded > UNSEEN_SHARE { shaded * shaded } else { 0.0 };
            high = next_high;
            shaded *= 1.0 - next.map_or(0.0, |look| look.seen_share);
        }
        Self {
            area_share,
            var_share: ((var_share - LEAST_VAR_SHARE) / (1.0 - LEAST_VAR_SHARE)).max(0.0),
        }
    }
}

impl Sums {
    /// The looks as one at open ground of this area, m².
    fn look(&self, open_m2: f64) -> Look {
        // Of the rays of a part, those that see it more surely count more.
        let high = self.high_twice_m2 / self.high_m2;
        let covered = if open_m2 > 0.0 { (self.high_m2 / (high * open_m2)).min(1.0) } else { 1.0 };
        Look { high, seen_share: covered * self.both_m2 / self.high_m2 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROW: Row = Row { nodes: [0, 1, 2, 3], weights: [1.0, 0.0, 0.0, 0.0] };

    /// What looks of one area and chance each leave of 2 m².
    fn rest(looks: &[(f64, f64, f64)]) -> Rest {
        let parts: Vec<Looks> = looks
            .iter()
            .map(|(area_m2, open, high)| {
                let mut part = Looks::none(4);
                part.push(&ROW, *area_m2, Chance { open: *open, high: *high });
                part
            })
            .collect();
        Rest::of(parts.iter(), 0, 2.0, &mut Vec::new())
    }

    #[test]
    fn crests_are_others_for_each_look_and_depth_is_the_same_for_all() {
        let is = |got: f64, expected: f64| assert!((got - expected).abs() < 1e-12, "{got}");
        // Not looked at, nothing is taken off.
        is(rest(&[]).var_share, 1.0);
        // 0.4 of it is shaded from each side: 0.16 from both; that is no patch, and as good as seen.
        let both = rest(&[(2.0, 0.6, 1.0), (2.0, 0.6, 1.0)]);
        is(both.area_share, 0.16);
        is(both.var_share, 0.0);
        // Half the area looked at: 1 − 0.5 · 0.6 is shaded. That share squared of the variance stays.
        is(rest(&[(1.0, 0.6, 1.0)]).var_share, (0.49 - 0.1) / 0.9);
        // Three looks that reach it with 0.3, 0.7 and 0.5 are as good as the best one: 0.3 stays.
        let low = rest(&[(2.0, 1.0, 0.3), (9.0, 1.0, 0.7), (2.0, 1.0, 0.5)]);
        is(low.var_share, (0.3 - 0.1) / 0.9);
        is(low.area_share, 0.3);
        // A look that cannot reach it changes nothing.
        is(rest(&[(9.0, 1.0, 0.0)]).var_share, 1.0);
        // One that hardly reaches all of it, and one that surely reaches a hundredth: with 0.9 a hundredth is seen.
        let glimpse = rest(&[(2.0, 1.0, 0.1), (0.02, 1.0, 1.0)]);
        is(glimpse.area_share, 0.9 * 0.99);
        is(glimpse.var_share, (0.9 * 0.99 * 0.99 - 0.1) / 0.9);
    }
}
