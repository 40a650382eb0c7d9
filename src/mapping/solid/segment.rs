//! Distances between points, segments and triangles.
//!
//! Source: Ericson, Real-Time Collision Detection, 2005, sections 5.1.5 and 5.1.9; the crossing of
//! a segment and a triangle after Möller and Trumbore 1997.

use nalgebra::Vector3;

/// A triangle by its corners, m.
pub(super) type Triangle = [Vector3<f64>; 3];

/// Squared distance of a point from the segment a–b, m².
pub(super) fn point_segment_m2(p: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let along = b - a;
    let length_m2 = along.norm_squared();
    let share = if length_m2 > 0.0 { (p - a).dot(&along) / length_m2 } else { 0.0 };
    (p - (a + along * share.clamp(0.0, 1.0))).norm_squared()
}

/// Squared distance of two segments a–b and c–d, m².
pub(super) fn segments_m2(
    (a, b): (&Vector3<f64>, &Vector3<f64>),
    (c, d): (&Vector3<f64>, &Vector3<f64>),
) -> f64 {
    // The minimum lies at an end of one of them, unless the lines come nearest inside both.
    let ends_m2 = point_segment_m2(a, c, d)
        .min(point_segment_m2(b, c, d))
        .min(point_segment_m2(c, a, b))
        .min(point_segment_m2(d, a, b));
    let (u, v, w) = (b - a, d - c, a - c);
    let (uu, uv, vv) = (u.norm_squared(), u.dot(&v), v.norm_squared());
    let (uw, vw) = (u.dot(&w), v.dot(&w));
    let det = uu * vv - uv * uv;
    if det <= 0.0 {
        return ends_m2;
    }
    let (s, t) = ((uv * vw - vv * uw) / det, (uu * vw - uv * uw) / det);
    if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
        return ends_m2.min((w + u * s - v * t).norm_squared());
    }
    ends_m2
}

/// Squared distance of a point from a triangle, m².
pub(super) fn point_triangle_m2(p: &Vector3<f64>, [a, b, c]: &Triangle) -> f64 {
    let normal = (b - a).cross(&(c - a));
    let is_left =
        |from: &Vector3<f64>, to: &Vector3<f64>| normal.dot(&(to - from).cross(&(p - from))) >= 0.0;
    let area2_m4 = normal.norm_squared();
    if area2_m4 > 0.0 && is_left(a, b) && is_left(b, c) && is_left(c, a) {
        let off = normal.dot(&(p - a));
        return off * off / area2_m4;
    }
    point_segment_m2(p, a, b).min(point_segment_m2(p, b, c)).min(point_segment_m2(p, c, a))
}

/// Where the half line from `origin` along `along` crosses a triangle, in lengths of `along`.
pub(super) fn crossing(
    origin: &Vector3<f64>,
    along: &Vector3<f64>,
    [a, b, c]: &Triangle,
) -> Option<f64> {
    let (e, f) = (b - a, c - a);
    let h = along.cross(&f);
    let det = e.dot(&h);
    if det == 0.0 {
        return None;
    }
    let s = origin - a;
    let u = s.dot(&h) / det;
    let q = s.cross(&e);
    let v = along.dot(&q) / det;
    let t = f.dot(&q) / det;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0).then_some(t)
}

/// Squared distance of the segment a–b from a triangle, m²; 0 where they meet.
pub(super) fn segment_triangle_m2(a: &Vector3<f64>, b: &Vector3<f64>, triangle: &Triangle) -> f64 {
    if crossing(a, &(b - a), triangle).is_some_and(|share| share <= 1.0) {
        return 0.0;
    }
    let [p, q, r] = triangle;
    [(p, q), (q, r), (r, p)]
        .into_iter()
        .map(|edge| segments_m2((a, b), edge))
        .fold(point_triangle_m2(a, triangle).min(point_triangle_m2(b, triangle)), f64::min)
}
