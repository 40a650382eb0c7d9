//! Rectangles and boxes aligned with the hall.

use nalgebra::Vector3;

/// A rectangle on the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Lowest x in the hall, m.
    pub x_min_m: f64,
    /// Lowest y in the hall, m.
    pub y_min_m: f64,
    /// Highest x in the hall, m.
    pub x_max_m: f64,
    /// Highest y in the hall, m.
    pub y_max_m: f64,
}

impl Region {
    /// The rectangle between two opposite corners (x, y), m.
    #[must_use]
    pub const fn new(x_min_m: f64, y_min_m: f64, x_max_m: f64, y_max_m: f64) -> Self {
        Self { x_min_m, y_min_m, x_max_m, y_max_m }
    }

    /// The rectangle with its borders moved outwards, m.
    #[must_use]
    pub fn grown(&self, by_m: f64) -> Self {
        Self::new(
            self.x_min_m - by_m,
            self.y_min_m - by_m,
            self.x_max_m + by_m,
            self.y_max_m + by_m,
        )
    }

    /// True inside and on the border.
    #[must_use]
    pub fn contains(&self, x_m: f64, y_m: f64) -> bool {
        (self.x_min_m..=self.x_max_m).contains(&x_m) && (self.y_min_m..=self.y_max_m).contains(&y_m)
    }

    /// The common part, if it has an area.
    #[must_use]
    pub fn overlap(&self, other: &Self) -> Option<Self> {
        let common = Self::new(
            self.x_min_m.max(other.x_min_m),
            self.y_min_m.max(other.y_min_m),
            self.x_max_m.min(other.x_max_m),
            self.y_max_m.min(other.y_max_m),
        );
        (common.x_min_m < common.x_max_m && common.y_min_m < common.y_max_m).then_some(common)
    }

    /// Length along x, m.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.x_max_m - self.x_min_m
    }

    /// Length along y, m.
    #[must_use]
    pub fn width_m(&self) -> f64 {
        self.y_max_m - self.y_min_m
    }

    /// Area, m².
    #[must_use]
    pub fn area_m2(&self) -> f64 {
        self.length_m() * self.width_m()
    }

    /// Middle (x, y), m.
    #[must_use]
    pub fn centre_m(&self) -> (f64, f64) {
        (f64::midpoint(self.x_min_m, self.x_max_m), f64::midpoint(self.y_min_m, self.y_max_m))
    }
}

/// A box aligned with the hall's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cuboid {
    /// Lowest corner in the hall, m.
    pub min_m: Vector3<f64>,
    /// Highest corner in the hall, m.
    pub max_m: Vector3<f64>,
}

impl Cuboid {
    /// The box over a rectangle between two heights, m.
    #[must_use]
    pub const fn over(footprint: &Region, z_min_m: f64, z_max_m: f64) -> Self {
        Self {
            min_m: Vector3::new(footprint.x_min_m, footprint.y_min_m, z_min_m),
            max_m: Vector3::new(footprint.x_max_m, footprint.y_max_m, z_max_m),
        }
    }

    /// The smallest box around all of these; `None` around nothing.
    #[must_use]
    pub fn around(cuboids: &[Self]) -> Option<Self> {
        cuboids
            .iter()
            .copied()
            .reduce(|a, b| Self { min_m: a.min_m.inf(&b.min_m), max_m: a.max_m.sup(&b.max_m) })
    }

    /// What it covers of the floor.
    #[must_use]
    pub fn footprint(&self) -> Region {
        Region::new(self.min_m.x, self.min_m.y, self.max_m.x, self.max_m.y)
    }

    /// True over its footprint.
    #[must_use]
    pub fn covers(&self, x_m: f64, y_m: f64) -> bool {
        self.footprint().contains(x_m, y_m)
    }

    /// Distance of an outside point to the box, m; 0 inside.
    #[must_use]
    pub fn distance_m(&self, p: &Vector3<f64>) -> f64 {
        let outside = (self.min_m - p).sup(&(p - self.max_m));
        outside.sup(&Vector3::zeros()).norm()
    }

    /// Distance of an inside point to the nearest face, m; negative outside.
    #[must_use]
    pub fn depth_m(&self, p: &Vector3<f64>) -> f64 {
        (p - self.min_m).inf(&(self.max_m - p)).min()
    }
}
