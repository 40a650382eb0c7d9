//! Brightness of a tag's cells, quickly looked up: a picture takes ten million of them.

use super::MARGIN_CELLS;
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use stockpilot::messages::TagPattern;

/// Cells of margin and the ring of nothing beyond it.
const RING: i32 = 2;
/// The same as an offset.
const RING_CELLS: f32 = 2.0;

/// Less than any brightness: beside the tag.
const BESIDE: f32 = -1.0;

/// The cells of a tag with its white margin, and a ring around them that stands for what is beside
/// the tag; by rows from the upper left.
pub(super) struct Shades {
    side: usize,
    /// The largest column and row.
    last: f32,
    /// Brightness, or [`BESIDE`].
    light: Vec<f32>,
}

/// How the place on the tag's plane changes around a pixel at one instant: homogeneous cells right
/// and down, at the pixel's centre and by each pixel right and down.
pub(super) struct Local {
    at: [f32; 3],
    by_u: [f32; 3],
    by_v: [f32; 3],
}

impl Local {
    pub(super) fn of(
        cells_from_ray: &Matrix3<f64>,
        ray: &Vector2<f64>,
        by_pixel: &Matrix2<f64>,
    ) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "a millionth of a cell is enough")]
        let short = |v: Vector3<f64>| [v.x as f32, v.y as f32, v.z as f32];
        let turned = |v: Vector2<f64>| short(cells_from_ray * Vector3::new(v.x, v.y, 0.0));
        Self {
            at: short(cells_from_ray * Vector3::new(ray.x, ray.y, 1.0)),
            by_u: turned(by_pixel.column(0).into()),
            by_v: turned(by_pixel.column(1).into()),
        }
    }
}

impl Shades {
    #[expect(clippy::cast_precision_loss, reason = "some ten cells")]
    pub(super) fn of(pattern: &TagPattern, white: f32, black: f32) -> Self {
        const { assert!((MARGIN_CELLS - 1.0).abs() < f64::EPSILON, "a ring of one cell") };
        let n_cells = i32::from(pattern.n_cells());
        let mut light = Vec::new();
        let all = -RING..n_cells + RING;
        for row in all.clone() {
            for col in all.clone() {
                let with_margin = 1 - RING..n_cells + RING - 1;
                let is_beside = !with_margin.contains(&row) || !with_margin.contains(&col);
                let shade = if pattern.is_white(col, row) { white } else { black };
                light.push(if is_beside { BESIDE } else { shade });
            }
        }
        let side = all.count();
        Self { side, last: (side - 1) as f32, light }
    }

    /// The cell that a ray this far from the pixel's centre meets; px right and down.
    #[inline]
    pub(super) fn cell(&self, local: &Local, [u, v]: [f32; 2]) -> usize {
        let on = |axis: usize| local.at[axis] + u * local.by_u[axis] + v * local.by_v[axis];
        let depth_inv = on(2);
        // Behind the camera nothing is met: NaN becomes the ring's first cell.
        let depth = if depth_inv > 0.0 { depth_inv.recip() } else { f32::NAN };
        let whole = |cells: f32| {
            // By way of i32, which processors convert to at once.
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "clamped; what is positive is cut downwards"
            )]
            let whole = (cells + RING_CELLS).clamp(0.0, self.last) as i32 as usize;
            whole
        };
        whole(on(1) * depth) * self.side + whole(on(0) * depth)
    }

    /// Both cells are bright alike: they are the same, or both beside the tag.
    pub(super) fn is_same(&self, a: usize, b: usize) -> bool {
        a == b || (self.light[a] < 0.0 && self.light[b] < 0.0)
    }

    /// Brightness of a cell; `before` is what is behind the tag.
    #[inline]
    pub(super) fn light(&self, cell: usize, before: f32) -> f32 {
        let light = self.light[cell];
        if light < 0.0 { before } else { light }
    }
}
