//! Simple polygons on the hall's floor: outlines of bays, footprints of machines.

use super::rect::Rect;

/// A place on the floor, x and y, m.
pub type Place = (f64, f64);

/// A polygon whose border neither crosses nor touches itself; it may be concave.
///
/// Corners run counter-clockwise, whatever order they were given in.
#[derive(Debug, Clone, PartialEq)]
pub struct Polygon {
    corners_m: Vec<Place>,
    bounds: Rect,
}

/// Why corners make no polygon. Corners are numbered from 0 as they were given.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PolygonError {
    /// Fewer than three different corners.
    #[error("a polygon needs 3 corners, this one has {got}")]
    TooFewCorners {
        /// How many there are.
        got: usize,
    },
    /// A coordinate is infinite or no number.
    #[error("corner {index} is not a finite place")]
    NotFinite {
        /// Which corner.
        index: usize,
    },
    /// Two neighbouring corners are the same.
    #[error("corner {index} is the same as the one after it")]
    RepeatedCorner {
        /// Which corner.
        index: usize,
    },
    /// Two edges cross, touch or fold back.
    #[error(
        "the polygon crosses or touches itself: the edge from corner {first} to {} and the edge \
         from corner {second} to {}",
        first + 1,
        second + 1
    )]
    SelfIntersecting {
        /// Corner where the one edge begins.
        first: usize,
        /// Corner where the other edge begins.
        second: usize,
    },
}

impl Polygon {
    /// A polygon from its corners, clockwise or not; the first may stand again at the end.
    ///
    /// # Errors
    /// [`PolygonError`] says which corner or edges are wrong.
    ///
    /// Cost: every edge is compared with every other.
    pub fn new(corners_m: &[Place]) -> Result<Self, PolygonError> {
        let mut corners = corners_m.to_vec();
        if corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        if let Some(index) = corners.iter().position(|(x, y)| !x.is_finite() || !y.is_finite()) {
            return Err(PolygonError::NotFinite { index });
        }
        if corners.len() < 3 {
            return Err(PolygonError::TooFewCorners { got: corners.len() });
        }
        let n = corners.len();
        if let Some(index) = (0..n).find(|&i| corners[i] == corners[(i + 1) % n]) {
            return Err(PolygonError::RepeatedCorner { index });
        }
        if let Some((first, second)) = self_intersection(&corners) {
            return Err(PolygonError::SelfIntersecting { first, second });
        }
        if signed_area_m2(&corners) < 0.0 {
            corners.reverse();
        }
        let bounds = bounds_of(&corners);
        Ok(Self { corners_m: corners, bounds })
    }

    /// The corners, counter-clockwise, m.
    #[must_use]
    pub fn corners_m(&self) -> &[Place] {
        &self.corners_m
    }

    /// The edges as pairs of corners.
    pub fn edges(&self) -> impl Iterator<Item = (Place, Place)> + '_ {
        edges_of(&self.corners_m)
    }

    /// The smallest rectangle around it.
    #[must_use]
    pub const fn bounds(&self) -> &Rect {
        &self.bounds
    }

    /// Its area, m², by the shoelace formula.
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        signed_area_m2(&self.corners_m)
    }

    /// True if (x, y) lies inside; on the border it may be either.
    ///
    /// Source: the crossings test of Shimrat 1962.
    #[must_use]
    pub fn contains(&self, x_m: f64, y_m: f64) -> bool {
        self.bounds.contains(x_m, y_m, 0.0)
            && self.edges().fold(false, |is_inside, (a, b)| {
                let spans = (a.1 > y_m) != (b.1 > y_m);
                is_inside ^ (spans && x_m < a.0 + (y_m - a.1) / (b.1 - a.1) * (b.0 - a.0))
            })
    }

    /// True if (x, y) lies inside or at most `margin_m` away.
    #[must_use]
    pub fn is_within(&self, x_m: f64, y_m: f64, margin_m: f64) -> bool {
        self.bounds.contains(x_m, y_m, margin_m)
            && (self.contains(x_m, y_m)
                || self.edges().any(|(a, b)| distance_m((x_m, y_m), a, b) <= margin_m))
    }

    /// Distance of (x, y) from the polygon, m; 0 inside.
    #[must_use]
    pub fn distance_m(&self, x_m: f64, y_m: f64) -> f64 {
        if self.contains(x_m, y_m) { 0.0 } else { self.border_distance_m(x_m, y_m) }
    }

    /// Distance of (x, y) from the border, m, from either side.
    #[must_use]
    pub fn border_distance_m(&self, x_m: f64, y_m: f64) -> f64 {
        self.edges().map(|(a, b)| distance_m((x_m, y_m), a, b)).fold(f64::INFINITY, f64::min)
    }

    /// Distance of the straight line between two points from the border, m; 0 if it crosses it.
    #[must_use]
    pub fn border_distance_of_line_m(&self, a: Place, b: Place) -> f64 {
        if a == b {
            return self.border_distance_m(a.0, a.1);
        }
        let to_edge = |(c, d): (Place, Place)| {
            if touches(a, b, c, d) {
                return 0.0;
            }
            let from_ends = distance_m(a, c, d).min(distance_m(b, c, d));
            from_ends.min(distance_m(c, a, b)).min(distance_m(d, a, b))
        };
        self.edges().map(to_edge).fold(f64::INFINITY, f64::min)
    }

    /// True if no corner turns inwards.
    #[must_use]
    pub fn is_convex(&self) -> bool {
        let turns = std::iter::zip(self.edges(), self.edges().skip(1).chain(self.edges().take(1)));
        let (mut is_left, mut is_right) = (false, false);
        for ((a, b), (_, c)) in turns {
            let turn_m2 = (b.0 - a.0) * (c.1 - b.1) - (b.1 - a.1) * (c.0 - b.0);
            is_left |= turn_m2 > 0.0;
            is_right |= turn_m2 < 0.0;
        }
        !(is_left && is_right)
    }

    /// True if the straight line between two points touches the polygon.
    #[must_use]
    pub fn cuts(&self, a: Place, b: Place) -> bool {
        self.bounds.cuts(a, b)
            && (self.contains(a.0, a.1) || self.edges().any(|(c, d)| touches(a, b, c, d)))
    }
}

impl From<Rect> for Polygon {
    fn from(bounds: Rect) -> Self {
        let Rect { x_min_m, y_min_m, x_max_m, y_max_m } = bounds;
        let corners_m =
            vec![(x_min_m, y_min_m), (x_max_m, y_min_m), (x_max_m, y_max_m), (x_min_m, y_max_m)];
        Self { corners_m, bounds }
    }
}

fn edges_of(corners: &[Place]) -> impl Iterator<Item = (Place, Place)> + '_ {
    let next = corners.iter().cycle().skip(1);
    std::iter::zip(corners, next).map(|(a, b)| (*a, *b))
}

fn bounds_of(corners: &[Place]) -> Rect {
    let extreme = |pick: fn(&Place) -> f64, of: fn(f64, f64) -> f64, start: f64| {
        corners.iter().map(pick).fold(start, of)
    };
    Rect {
        x_min_m: extreme(|c| c.0, f64::min, f64::INFINITY),
        y_min_m: extreme(|c| c.1, f64::min, f64::INFINITY),
        x_max_m: extreme(|c| c.0, f64::max, f64::NEG_INFINITY),
        y_max_m: extreme(|c| c.1, f64::max, f64::NEG_INFINITY),
    }
}

/// Positive if the corners run counter-clockwise. Taken from the first corner, so that places far
/// from the origin lose no digits.
fn signed_area_m2(corners: &[Place]) -> f64 {
    let Some(&first) = corners.first() else { return 0.0 };
    edges_of(corners).map(|(a, b)| 0.5 * turn(first, a, b)).sum()
}

/// Twice the signed area of the triangle a, b, c: positive if c lies left of a → b.
fn turn(a: Place, b: Place, c: Place) -> f64 {
    (b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0)
}

/// True if the segments a–b and c–d have a point in common.
fn touches(a: Place, b: Place, c: Place, d: Place) -> bool {
    let (abc, abd) = (turn(a, b, c), turn(a, b, d));
    let (cda, cdb) = (turn(c, d, a), turn(c, d, b));
    let are_apart = |s: f64, t: f64| (s > 0.0 && t < 0.0) || (s < 0.0 && t > 0.0);
    let lies_on = |p: Place, q: Place, r: Place| {
        (p.0.min(q.0)..=p.0.max(q.0)).contains(&r.0) && (p.1.min(q.1)..=p.1.max(q.1)).contains(&r.1)
    };
    (are_apart(abc, abd) && are_apart(cda, cdb))
        || (abc == 0.0 && lies_on(a, b, c))
        || (abd == 0.0 && lies_on(a, b, d))
        || (cda == 0.0 && lies_on(c, d, a))
        || (cdb == 0.0 && lies_on(c, d, b))
}

/// Distance of a point from the segment a–b, m.
fn distance_m(p: Place, a: Place, b: Place) -> f64 {
    let nearest = nearest_on(p, a, b).0;
    (p.0 - nearest.0).hypot(p.1 - nearest.1)
}

/// The point of the segment a–b nearest to `p`, and how far it is along the segment, 0 to 1.
pub(super) fn nearest_on(p: Place, a: Place, b: Place) -> (Place, f64) {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let along = ((p.0 - a.0) * dx + (p.1 - a.1) * dy) / (dx * dx + dy * dy);
    let along = along.clamp(0.0, 1.0);
    ((a.0 + along * dx, a.1 + along * dy), along)
}

/// The first two edges that have more in common than the corner between neighbours.
fn self_intersection(corners: &[Place]) -> Option<(usize, usize)> {
    let n = corners.len();
    let edge = |i: usize| (corners[i], corners[(i + 1) % n]);
    (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).find(|&(i, j)| {
        let ((a, b), (c, d)) = (edge(i), edge(j));
        if j == i + 1 {
            folds_back(a, b, d)
        } else if i == 0 && j == n - 1 {
            folds_back(c, d, b)
        } else {
            touches(a, b, c, d)
        }
    })
}

/// True if a → b → c returns along the line it came.
fn folds_back(a: Place, b: Place, c: Place) -> bool {
    let ahead = (b.0 - a.0) * (c.0 - b.0) + (b.1 - a.1) * (c.1 - b.1);
    turn(a, b, c) == 0.0 && ahead < 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An arrow head that points along x: concave at (1, 1).
    const ARROW: [Place; 4] = [(0.0, 0.0), (4.0, 1.0), (0.0, 2.0), (1.0, 1.0)];

    #[test]
    fn area_does_not_depend_on_the_order_or_a_repeated_end() {
        // The triangle 4 × 2 / 2 without the notch 1 × 2 / 2.
        let mut corners = ARROW.to_vec();
        assert!((Polygon::new(&corners).expect("simple").area_m2() - 3.0).abs() < 1e-12);
        corners.reverse();
        corners.push(corners[0]);
        let polygon = Polygon::new(&corners).expect("simple");
        assert!((polygon.area_m2() - 3.0).abs() < 1e-12);
        assert_eq!(polygon.corners_m().len(), 4);
    }

    #[test]
    fn a_notch_is_outside_and_margins_are_round() {
        let polygon = Polygon::new(&ARROW).expect("simple");
        assert!(polygon.contains(2.0, 1.0) && polygon.contains(0.3, 0.2));
        assert!(!polygon.contains(0.5, 1.0), "in the notch");
        assert!(polygon.is_within(4.3, 1.4, 0.51), "the tip is 0.5 away");
        assert!(!polygon.is_within(4.3, 1.4, 0.49));
        assert!(polygon.is_within(2.0, 1.0, 0.0));
    }

    #[test]
    fn lines_through_touch_and_lines_past_do_not() {
        let polygon = Polygon::new(&ARROW).expect("simple");
        assert!(polygon.cuts((2.0, -1.0), (2.0, 3.0)), "right through");
        assert!(polygon.cuts((1.5, 0.9), (2.0, 1.1)), "within");
        assert!(!polygon.cuts((0.2, 0.8), (0.3, 1.2)), "inside the notch");
        assert!(polygon.cuts((0.5, 1.0), (2.0, 1.0)), "out of the notch");
        assert!(!polygon.cuts((5.0, 0.0), (4.2, 2.0)), "past the tip");
    }

    #[test]
    fn wrong_polygons_are_refused_with_their_reason() {
        let refused = |corners: &[Place]| Polygon::new(corners).unwrap_err();
        let bow_tie = [(0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 2.0)];
        assert_eq!(refused(&bow_tie), PolygonError::SelfIntersecting { first: 0, second: 2 });
        let touching = [(0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (2.0, 0.0), (0.0, 2.0)];
        assert!(matches!(refused(&touching), PolygonError::SelfIntersecting { first: 0, .. }));
        let spike = [(0.0, 0.0), (2.0, 0.0), (1.0, 0.0), (1.0, 1.0)];
        assert!(matches!(refused(&spike), PolygonError::SelfIntersecting { first: 0, .. }));
        let flat = [(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)];
        assert!(matches!(refused(&flat), PolygonError::SelfIntersecting { .. }));
        assert_eq!(refused(&bow_tie[..2]), PolygonError::TooFewCorners { got: 2 });
        assert_eq!(
            refused(&[(0.0, 0.0), (1.0, f64::NAN), (1.0, 1.0)]),
            PolygonError::NotFinite { index: 1 }
        );
        assert_eq!(
            refused(&[(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (1.0, 1.0)]),
            PolygonError::RepeatedCorner { index: 1 }
        );
        assert!(refused(&bow_tie).to_string().contains("corner 2 to 3"));
    }
}
