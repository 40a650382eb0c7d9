//! How good a fix is, at every place and heading of a 4-D grid.
//!
//! A node is evaluated when it is first asked for and kept; its value does not depend on when that
//! is. Between nodes, over the 16 around a place (neighbouring in x, y, z and heading):
//!
//! ```text
//! Σ^χ(χ) = Σ_k w_k Σ_k           multilinear weights w_k; nothing if one of them has no fix
//! q(χ)   = min_k q_pos(Σ_k)      over the nodes with w_k > 0: the worst one counts
//! ```
//! Nodes in walls and obstacles, where no vehicle can be, are left out of both.
//! Beyond the outermost nodes their values hold for one more step; after that there is no fix.

use super::Waypoint;
use super::free_space::{Legibility, is_legible};
use super::grid_axis::{Axis, Share};
use crate::geometry::{Body, Hall, Point, Transform};
use crate::localization::camera_model::CameraModel;
use crate::localization::marker_map::MarkerMap;
use crate::localization::vision_fix::{corner_normal_matrix, cov_of_normal_matrix, q_pos};
use crate::mapping::polygon::Polygon;
use crate::mapping::solid::{self, Solid};
use nalgebra::{Matrix6, Vector3};
use std::sync::OnceLock;

/// What a fix depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensing {
    /// The cameras; their information adds.
    pub cameras: Vec<CameraModel>,
    /// Corners of every tag.
    pub tags: Vec<[Point<Hall>; 4]>,
    /// Standard deviation of a detected corner, px.
    pub corner_sigma_px: f64,
    /// What stands in the way of sight.
    pub obstacles: Vec<Solid>,
    /// Inner faces of the walls, which end every sight.
    pub walls: Option<Polygon>,
    /// Nothing is nearer to the body's origin than this, m.
    pub vehicle_radius_m: f64,
}

/// A tag lies on its wall: sight ends this much before it, m.
const BEFORE_TAG_M: f64 = 0.05;

impl Sensing {
    /// The tags of a map, nothing in the way.
    #[must_use]
    pub fn open(cameras: &[CameraModel], map: &MarkerMap, corner_sigma_px: f64) -> Self {
        Self {
            cameras: cameras.to_vec(),
            tags: map.iter().map(|(_, _, corners)| *corners).collect(),
            corner_sigma_px,
            obstacles: Vec::new(),
            walls: None,
            vehicle_radius_m: 0.0,
        }
    }

    /// Covariance of one fix from a pose, 6×6; `None` where it is not observable.
    #[must_use]
    pub fn fix_cov(&self, hall_from_body: &Transform<Hall, Body>) -> Option<Matrix6<f64>> {
        self.cov_of(&self.normal_matrices(&self.tags, hall_from_body))
    }

    /// `JᵀJ` of the corners of these tags that each camera can read from a pose.
    #[must_use]
    pub fn normal_matrices(
        &self,
        tags: &[[Point<Hall>; 4]],
        hall_from_body: &Transform<Hall, Body>,
    ) -> Vec<Matrix6<f64>> {
        let of_camera = |camera: &CameraModel| {
            let eye = (*hall_from_body * camera.body_from_camera).origin.coords;
            let corners: Vec<Point<Hall>> = tags
                .iter()
                .filter(|tag| is_legible(camera, tag, hall_from_body, &Legibility::default()))
                .filter(|tag| self.is_in_sight(&eye, tag))
                .flatten()
                .copied()
                .collect();
            corner_normal_matrix(camera, &corners, hall_from_body)
        };
        self.cameras.iter().map(of_camera).collect()
    }

    /// Covariance of a fix from what the corners of each camera add up to; a camera that alone
    /// would not fix the pose is left out.
    #[must_use]
    pub fn cov_of(&self, normal_matrices: &[Matrix6<f64>]) -> Option<Matrix6<f64>> {
        let of_camera = |normal: &Matrix6<f64>| {
            let cov = cov_of_normal_matrix(normal, self.corner_sigma_px)?;
            cov.cholesky().map(|factor| factor.inverse())
        };
        let information = normal_matrices.iter().filter_map(of_camera).reduce(|all, i| all + i)?;
        information.cholesky().map(|factor| factor.inverse())
    }

    /// True where no vehicle can be: in or too near to a wall or an obstacle.
    fn is_void(&self, place: &Vector3<f64>) -> bool {
        let least_m = self.vehicle_radius_m;
        let is_out = |walls: &Polygon| {
            !walls.contains(place.x, place.y) || walls.border_distance_m(place.x, place.y) < least_m
        };
        self.walls.as_ref().is_some_and(is_out)
            || solid::distance_m(&self.obstacles, place, least_m + 1e-9) < least_m
    }

    /// True if nothing solid stands between an eye and the middle of a tag.
    fn is_in_sight(&self, eye: &Vector3<f64>, corners: &[Point<Hall>; 4]) -> bool {
        let middle = corners.iter().map(|c| c.coords).sum::<Vector3<f64>>() / 4.0;
        let line = middle - eye;
        let end = eye + line * (1.0 - BEFORE_TAG_M / line.norm()).max(0.0);
        let is_behind_wall = |walls: &Polygon| {
            walls.border_distance_of_line_m((eye.x, eye.y), (end.x, end.y)) <= 0.0
        };
        !solid::blocks_sight(&self.obstacles, eye, &end)
            && !self.walls.as_ref().is_some_and(is_behind_wall)
    }
}

/// Where the nodes are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    /// Along x, m.
    pub x: Axis,
    /// Along y, m.
    pub y: Axis,
    /// Heights, m.
    pub z: Axis,
    /// Number of headings, evenly around.
    pub n_headings: usize,
    /// The first heading, rad: the survey's.
    pub first_yaw_rad: f64,
    /// Which of the heights is the survey's.
    pub survey_height: usize,
}

impl Axes {
    /// Number of nodes.
    #[must_use]
    pub const fn n_nodes(&self) -> usize {
        self.x.n * self.y.n * self.z.n * self.n_headings
    }

    /// The pose of a node.
    #[must_use]
    pub fn waypoint(&self, node: usize) -> Waypoint {
        let (rest, heading) = (node / self.n_headings, node % self.n_headings);
        let (rest, i) = (rest / self.x.n, rest % self.x.n);
        let (k, j) = (rest / self.y.n, rest % self.y.n);
        Waypoint {
            place: Point::new(self.x.at(i), self.y.at(j), self.z.at(k)),
            yaw_rad: self.first_yaw_rad + Axis::turn(self.n_headings).at(heading),
        }
    }

    /// True for the nodes at the height and heading of the survey.
    #[must_use]
    pub const fn is_of_survey(&self, node: usize) -> bool {
        node.is_multiple_of(self.n_headings)
            && node / self.n_headings / self.x.n / self.y.n == self.survey_height
    }

    /// Index of the node at these counts along x, y, z and heading.
    #[must_use]
    pub const fn index(&self, [i, j, k, heading]: [usize; 4]) -> usize {
        ((k * self.y.n + j) * self.x.n + i) * self.n_headings + heading
    }

    /// The nodes around a waypoint with their weights; `None` outside of the grid.
    fn around(&self, waypoint: &Waypoint) -> Option<[Share; 4]> {
        let p = &waypoint.place.coords;
        let turn = Axis::turn(self.n_headings);
        Some([
            self.x.locate(p.x)?,
            self.y.locate(p.y)?,
            self.z.locate(p.z)?,
            turn.locate_around(waypoint.yaw_rad - self.first_yaw_rad),
        ])
    }
}

/// What a fix from a node is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Node {
    cov: Option<Matrix6<f64>>,
    quality: f64,
    /// No vehicle can be there.
    is_void: bool,
}

/// The grid.
pub struct QualityGrid {
    sensing: Sensing,
    axes: Axes,
    nodes: Vec<OnceLock<Box<Node>>>,
}

impl std::fmt::Debug for QualityGrid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("QualityGrid").field("axes", &self.axes).finish_non_exhaustive()
    }
}

/// Equal if every node has or will have the same value.
impl PartialEq for QualityGrid {
    fn eq(&self, other: &Self) -> bool {
        self.axes == other.axes && self.sensing == other.sensing
    }
}

impl QualityGrid {
    /// A grid; nothing is evaluated yet.
    #[must_use]
    pub fn new(sensing: Sensing, axes: Axes) -> Self {
        let nodes = std::iter::repeat_with(OnceLock::new).take(axes.n_nodes()).collect();
        Self { sensing, axes, nodes }
    }

    /// Where the nodes are.
    #[must_use]
    pub const fn axes(&self) -> &Axes {
        &self.axes
    }

    /// What a fix depends on.
    #[must_use]
    pub const fn sensing(&self) -> &Sensing {
        &self.sensing
    }

    fn node(&self, index: usize) -> &Node {
        self.nodes[index].get_or_init(|| {
            let waypoint = self.axes.waypoint(index);
            if self.sensing.is_void(&waypoint.place.coords) {
                return Box::new(Node { cov: None, quality: 0.0, is_void: true });
            }
            let cov = self.sensing.fix_cov(&waypoint.level_pose());
            Box::new(Node { cov, quality: cov.as_ref().map_or(0.0, q_pos), is_void: false })
        })
    }

    /// `q_pos` at a node; 0 without a fix.
    #[must_use]
    pub fn quality_at(&self, node: usize) -> f64 {
        self.node(node).quality
    }

    /// Evaluates every `n_parts`-th node from the `part`-th on, so that several callers share the
    /// work; a node's value does not depend on who evaluates it.
    pub fn fill(&self, part: usize, n_parts: usize) {
        for index in (part..self.nodes.len()).step_by(n_parts.max(1)) {
            self.node(index);
        }
    }

    /// The nodes around a waypoint where a vehicle can be, with their weights.
    fn nodes_around(&self, waypoint: &Waypoint) -> impl Iterator<Item = (&Node, f64)> {
        let around = self.axes.around(waypoint);
        let at = around.into_iter().flat_map(corners);
        at.map(|(at, weight)| (self.node(self.axes.index(at)), weight))
            .filter(|(node, _)| !node.is_void)
    }

    /// `q_pos` of the worst node around; 0 outside of the grid.
    #[must_use]
    pub fn quality(&self, waypoint: &Waypoint) -> f64 {
        let qualities = self.nodes_around(waypoint).map(|(node, _)| node.quality);
        qualities.reduce(f64::min).unwrap_or(0.0)
    }

    /// True if the worst node around is better than `least`; stops at the first that is not.
    #[must_use]
    pub fn is_better(&self, waypoint: &Waypoint, least: f64) -> bool {
        let mut nodes = self.nodes_around(waypoint).peekable();
        nodes.peek().is_some() && nodes.all(|(node, _)| node.quality > least)
    }

    /// The interpolated covariance of a fix; `None` if a node around has none.
    #[must_use]
    pub fn fix_cov(&self, waypoint: &Waypoint) -> Option<Matrix6<f64>> {
        let (mut sum, mut weights) = (Matrix6::zeros(), 0.0);
        for (node, weight) in self.nodes_around(waypoint) {
            sum += node.cov? * weight;
            weights += weight;
        }
        (weights > 0.0).then(|| sum / weights)
    }
}

/// The up to 16 nodes with a weight above zero.
fn corners(around: [Share; 4]) -> impl Iterator<Item = ([usize; 4], f64)> {
    (0..16_usize).filter_map(move |corner| {
        let mut at = [0; 4];
        let mut weight = 1.0;
        for (axis, share) in around.iter().enumerate() {
            let (node, part) = share.side(corner >> axis & 1 == 1);
            at[axis] = node;
            weight *= part;
        }
        (weight > 0.0).then_some((at, weight))
    })
}
