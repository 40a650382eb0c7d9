//! A rectangle along the hall's axes.

/// A rectangle along the hall's axes, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rect {
    /// Smallest x, m.
    pub x_min_m: f64,
    /// Smallest y, m.
    pub y_min_m: f64,
    /// Largest x, m.
    pub x_max_m: f64,
    /// Largest y, m.
    pub y_max_m: f64,
}

impl Rect {
    /// True if (x, y) lies in the rectangle or at most `margin_m` beside it; a negative margin is
    /// how far inside it must lie.
    #[must_use]
    pub fn contains(&self, x_m: f64, y_m: f64, margin_m: f64) -> bool {
        x_m >= self.x_min_m - margin_m
            && x_m <= self.x_max_m + margin_m
            && y_m >= self.y_min_m - margin_m
            && y_m <= self.y_max_m + margin_m
    }

    /// True if the straight line between two points (x, y) touches the rectangle.
    ///
    /// Source: the slab test of Kay and Kajiya 1986, in two dimensions.
    #[must_use]
    pub fn cuts(&self, a: (f64, f64), b: (f64, f64)) -> bool {
        let slab = |a: f64, b: f64, low: f64, high: f64| {
            let step = b - a;
            if step == 0.0 {
                let is_between = (low..=high).contains(&a);
                return if is_between { (0.0, 1.0) } else { (1.0, 0.0) };
            }
            let (s, t) = ((low - a) / step, (high - a) / step);
            (s.min(t).max(0.0), s.max(t).min(1.0))
        };
        let (x_in, x_out) = slab(a.0, b.0, self.x_min_m, self.x_max_m);
        let (y_in, y_out) = slab(a.1, b.1, self.y_min_m, self.y_max_m);
        x_in.max(y_in) <= x_out.min(y_out)
    }

    /// Extent along x and y, m.
    #[must_use]
    pub fn size_m(&self) -> (f64, f64) {
        (self.x_max_m - self.x_min_m, self.y_max_m - self.y_min_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_separate_what_lies_on_their_sides() {
        let wall = Rect { x_min_m: 3.0, y_min_m: 4.0, x_max_m: 3.3, y_max_m: 9.0 };
        assert!(wall.cuts((2.5, 6.0), (3.8, 6.4)));
        assert!(wall.cuts((2.5, 3.5), (3.5, 4.9)), "just inside the wall's end");
        assert!(!wall.cuts((2.5, 3.0), (3.8, 3.9)), "past the wall's end");
        assert!(!wall.cuts((2.5, 6.0), (2.9, 8.0)), "on one side");
        assert!(wall.cuts((3.1, 2.0), (3.1, 5.0)), "along the wall");
        assert!(!wall.cuts((2.9, 2.0), (2.9, 5.0)), "beside the wall");
    }
}
