//! Solids of triangles, such as a drawing or a scan of a machine.
//!
//! The triangles stand in a tree of boxes, so a question costs about the logarithm of their number.

use super::Aabb;
use super::segment::{Triangle, crossing, point_triangle_m2, segment_triangle_m2};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Triangles in a leaf of the tree.
const LEAF_SIZE: usize = 4;

/// Triangles with a tree over them.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    triangles: Vec<Triangle>,
    nodes: Vec<Node>,
    is_closed: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Node {
    bounds: Aabb,
    content: Content,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Content {
    /// Triangles from the first to before the second.
    Leaf(usize, usize),
    /// Two nodes further on.
    Inner(usize, usize),
}

/// Why triangles make no mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MeshError {
    /// No triangle at all.
    #[error("there are no triangles")]
    Empty,
    /// A coordinate is infinite or no number.
    #[error("triangle {index} has a corner that is not a finite place")]
    NotFinite {
        /// Which triangle, from 0.
        index: usize,
    },
}

impl Mesh {
    /// A mesh of triangles in the hall, m.
    ///
    /// It is solid if every edge belongs to exactly two triangles by the same coordinates;
    /// otherwise it is a skin with nothing inside.
    ///
    /// # Errors
    /// No triangles, or corners that are no places.
    pub fn new(mut triangles: Vec<[Vector3<f64>; 3]>) -> Result<Self, MeshError> {
        let is_finite = |t: &Triangle| t.iter().all(|p| p.iter().all(|c| c.is_finite()));
        if let Some(index) = triangles.iter().position(|t| !is_finite(t)) {
            return Err(MeshError::NotFinite { index });
        }
        if triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        let is_closed = is_closed(&triangles);
        let mut nodes = Vec::new();
        grow(&mut triangles, 0, &mut nodes);
        Ok(Self { triangles, nodes, is_closed })
    }

    /// The smallest box around it.
    #[must_use]
    pub const fn bounds(&self) -> &Aabb {
        // The root stands first, and there is at least one triangle.
        &self.nodes.as_slice()[0].bounds
    }

    /// True if it encloses a volume.
    #[must_use]
    pub const fn is_closed(&self) -> bool {
        self.is_closed
    }

    /// Its triangles, in the order of the tree, m.
    #[must_use]
    pub fn triangles_m(&self) -> &[[Vector3<f64>; 3]] {
        &self.triangles
    }

    /// Distance of a point, m, at most `reach_m`; 0 inside of a closed mesh.
    #[must_use]
    pub fn distance_m(&self, p: &Vector3<f64>, reach_m: f64) -> f64 {
        if self.contains(p) {
            return 0.0;
        }
        let here = Aabb { min_m: *p, max_m: *p };
        self.nearest_m(&here, reach_m, |triangle| point_triangle_m2(p, triangle))
    }

    /// Distance of the straight way from `a` to `b`, m, at most `reach_m`; 0 if it touches.
    #[must_use]
    pub fn way_distance_m(&self, a: &Vector3<f64>, b: &Vector3<f64>, reach_m: f64) -> f64 {
        // A way that meets no triangle is inside or outside as a whole.
        if self.contains(a) {
            return 0.0;
        }
        let around = Aabb { min_m: a.inf(b), max_m: a.sup(b) };
        self.nearest_m(&around, reach_m, |triangle| segment_triangle_m2(a, b, triangle))
    }

    /// True inside of a closed mesh.
    ///
    /// A half line from inside crosses the skin an odd number of times. Three awkward directions
    /// vote, because one may meet an edge.
    #[must_use]
    pub fn contains(&self, p: &Vector3<f64>) -> bool {
        const DIRECTIONS: [[f64; 3]; 3] =
            [[0.5377, 0.2113, 0.8162], [-0.3421, 0.8931, 0.2919], [0.1371, -0.6247, -0.7687]];
        let here = Aabb { min_m: *p, max_m: *p };
        if !self.is_closed || self.bounds().gap_m(&here) > 0.0 {
            return false;
        }
        let votes = DIRECTIONS.iter().filter(|direction| {
            let along = Vector3::from(**direction);
            self.n_crossings(p, &along) % 2 == 1
        });
        votes.count() >= 2
    }

    fn n_crossings(&self, origin: &Vector3<f64>, along: &Vector3<f64>) -> usize {
        let mut n_crossings = 0;
        let mut open = vec![0];
        while let Some(index) = open.pop() {
            let node = &self.nodes[index];
            if !meets(origin, along, &node.bounds) {
                continue;
            }
            match node.content {
                Content::Inner(left, right) => open.extend([left, right]),
                Content::Leaf(from, to) => {
                    let of_leaf = &self.triangles[from..to];
                    n_crossings +=
                        of_leaf.iter().filter(|t| crossing(origin, along, t).is_some()).count();
                }
            }
        }
        n_crossings
    }

    /// The smallest distance to a triangle, m, at most `reach_m`, by branch and bound.
    fn nearest_m(
        &self,
        around: &Aabb,
        reach_m: f64,
        distance_m2: impl Fn(&Triangle) -> f64,
    ) -> f64 {
        let mut nearest_m = reach_m;
        let mut open = vec![(self.bounds().gap_m(around), 0)];
        while let Some((gap_m, index)) = open.pop() {
            if gap_m >= nearest_m {
                continue;
            }
            match self.nodes[index].content {
                Content::Leaf(from, to) => {
                    for triangle in &self.triangles[from..to] {
                        nearest_m = nearest_m.min(distance_m2(triangle).sqrt());
                    }
                }
                Content::Inner(left, right) => {
                    let gap = |node: usize| (self.nodes[node].bounds.gap_m(around), node);
                    let (left, right) = (gap(left), gap(right));
                    // The nearer one is looked at first.
                    if left.0 < right.0 {
                        open.extend([right, left]);
                    } else {
                        open.extend([left, right]);
                    }
                }
            }
        }
        nearest_m
    }
}

/// Puts the tree over `triangles`, which begin at `first` of all, behind `nodes`; says where its
/// root stands.
fn grow(triangles: &mut [Triangle], first: usize, nodes: &mut Vec<Node>) -> usize {
    let bounds = Aabb::around(triangles.iter().flatten());
    let root = nodes.len();
    nodes.push(Node { bounds, content: Content::Leaf(first, first + triangles.len()) });
    if triangles.len() > LEAF_SIZE {
        let axis = (bounds.max_m - bounds.min_m).imax();
        let middle = triangles.len() / 2;
        let along = |t: &Triangle| t[0][axis] + t[1][axis] + t[2][axis];
        triangles.sort_by(|s, t| along(s).total_cmp(&along(t)));
        let (low, high) = triangles.split_at_mut(middle);
        let left = grow(low, first, nodes);
        let right = grow(high, first + middle, nodes);
        nodes[root].content = Content::Inner(left, right);
    }
    root
}

/// True if a half line meets a box, by the slab method of Kay and Kajiya 1986.
fn meets(origin: &Vector3<f64>, along: &Vector3<f64>, bounds: &Aabb) -> bool {
    let low = (bounds.min_m - origin).component_div(along);
    let high = (bounds.max_m - origin).component_div(along);
    low.inf(&high).max().max(0.0) <= low.sup(&high).min()
}

/// True if every edge belongs to exactly two triangles.
fn is_closed(triangles: &[Triangle]) -> bool {
    // Adding zero makes −0.0 and 0.0 the same bits.
    let key = |p: &Vector3<f64>| [p.x, p.y, p.z].map(|c| (c + 0.0).to_bits());
    let mut n_of_edge = BTreeMap::new();
    for [a, b, c] in triangles {
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let (p, q) = (key(p), key(q));
            *n_of_edge.entry((p.min(q), p.max(q))).or_insert(0_usize) += 1;
        }
    }
    n_of_edge.values().all(|n| *n == 2)
}
