//! Curves by their control points, and what those say about a whole curve at once.
//!
//! ```text
//! x(τ)  = Σ_k B_k^n(τ) P_k,   τ ∈ [0, 1]           a curve lies in the convex hull of its P_k
//! x'(τ) = n Σ_k B_k^{n−1}(τ) (P_{k+1} − P_k)       so do its derivatives
//! ```
//! Where the hull is too large to decide, the curve is split in the middle (de Casteljau): the gap
//! between hull and curve falls to a quarter each time.
//! Source: Farin, Curves and Surfaces for CAGD, chapters 4 and 5.

/// Control points: `D` coordinates, degree `N − 1`.
pub(super) type Points<const D: usize, const N: usize> = [[f64; D]; N];

/// Splits before a curve that cannot be decided counts as out of bounds: the part left is 1/512 of
/// the curve, and its hull 4e-6 of the first hull's depth away from it.
const MAX_SPLITS: u32 = 9;
/// A constant speed at its bound is within it but for rounding.
const ROUNDING: f64 = 1e-9;

/// Control points of the derivative over τ, divided by `span_s`: a derivative over time.
pub(super) fn derivative<const D: usize, const N: usize, const M: usize>(
    points: &Points<D, N>,
    span_s: f64,
) -> Points<D, M> {
    const { assert!(M + 1 == N, "a derivative is one degree lower") };
    let factor = (1..N).fold(0.0, |n, _| n + 1.0) / span_s;
    let mut slopes = [[0.0; D]; M];
    for (slope, pair) in slopes.iter_mut().zip(points.windows(2)) {
        for d in 0..D {
            slope[d] = (pair[1][d] - pair[0][d]) * factor;
        }
    }
    slopes
}

/// The two halves of a curve.
pub(super) fn halves<const D: usize, const N: usize>(
    points: &Points<D, N>,
) -> (Points<D, N>, Points<D, N>) {
    split(points, 0.5)
}

/// The parts before and after `at`, in `[0, 1]`.
pub(super) fn split<const D: usize, const N: usize>(
    points: &Points<D, N>,
    at: f64,
) -> (Points<D, N>, Points<D, N>) {
    let (mut left, mut right) = (*points, *points);
    let mut level = *points;
    for r in 1..N {
        for k in 0..N - r {
            level[k] = between(&level[k], &level[k + 1], at);
        }
        left[r] = level[0];
        right[N - 1 - r] = level[N - 1 - r];
    }
    (left, right)
}

/// True if |x(τ)| ≤ `bound` on the whole curve.
pub(super) fn is_within<const D: usize, const N: usize>(points: &Points<D, N>, bound: f64) -> bool {
    let bound = bound * (1.0 + ROUNDING);
    stays_within(points, bound * bound, MAX_SPLITS)
}

fn stays_within<const D: usize, const N: usize>(
    points: &Points<D, N>,
    bound_squared: f64,
    splits_left: u32,
) -> bool {
    if points.iter().all(|p| norm_squared(p) <= bound_squared) {
        return true;
    }
    // The ends lie on the curve.
    let is_decided = [&points[0], &points[N - 1]].iter().any(|p| norm_squared(p) > bound_squared);
    if is_decided || splits_left == 0 {
        return false;
    }
    let (left, right) = halves(points);
    stays_within(&left, bound_squared, splits_left - 1)
        && stays_within(&right, bound_squared, splits_left - 1)
}

/// True if x(τ)·`axis` ≥ `least` on the whole curve.
pub(super) fn is_ahead<const D: usize, const N: usize>(
    points: &Points<D, N>,
    axis: &[f64; D],
    least: f64,
) -> bool {
    let along = points.map(|p| [dot(&p, axis)]);
    stays_above(&along, least, MAX_SPLITS)
}

fn stays_above<const N: usize>(points: &Points<1, N>, least: f64, splits_left: u32) -> bool {
    if points.iter().all(|p| p[0] >= least) {
        return true;
    }
    if points[0][0] < least || points[N - 1][0] < least || splits_left == 0 {
        return false;
    }
    let (left, right) = halves(points);
    stays_above(&left, least, splits_left - 1) && stays_above(&right, least, splits_left - 1)
}

/// A bound from above on the largest norm on the curve, within `tolerance` of it.
pub(super) fn largest_norm<const D: usize, const N: usize>(
    points: &Points<D, N>,
    tolerance: f64,
) -> f64 {
    let of_hull = points.iter().map(norm_squared).fold(0.0, f64::max).sqrt();
    let of_ends = norm_squared(&points[0]).max(norm_squared(&points[N - 1])).sqrt();
    let mut known = of_ends;
    let mut open = vec![(of_hull, *points, MAX_SPLITS)];
    let mut largest = 0.0_f64;
    while let Some((of_hull, points, splits_left)) = open.pop() {
        if of_hull <= known + tolerance || splits_left == 0 {
            largest = largest.max(of_hull);
            continue;
        }
        let (left, right) = halves(&points);
        for half in [left, right] {
            known = known.max(norm_squared(&half[0]).max(norm_squared(&half[N - 1])).sqrt());
            let of_hull = half.iter().map(norm_squared).fold(0.0, f64::max).sqrt();
            open.push((of_hull, half, splits_left - 1));
        }
    }
    largest
}

fn between<const D: usize>(a: &[f64; D], b: &[f64; D], at: f64) -> [f64; D] {
    let mut c = *a;
    for d in 0..D {
        c[d] += (b[d] - a[d]) * at;
    }
    c
}

pub(super) fn dot<const D: usize>(a: &[f64; D], b: &[f64; D]) -> f64 {
    let mut sum = 0.0;
    for d in 0..D {
        sum += a[d] * b[d];
    }
    sum
}

fn norm_squared<const D: usize>(p: &[f64; D]) -> f64 {
    dot(p, p)
}

/// Value and the first four derivatives over τ at a place of the curve, of degree 7.
pub(super) fn jet<const D: usize>(points: &Points<D, 8>, at: f64) -> [[f64; D]; 5] {
    let mut level = *points;
    let mut jet = [[0.0; D]; 5];
    for left in (0..8).rev() {
        // `level` has `left + 1` points now; the last five rounds carry the derivatives.
        if left <= 4 {
            jet[left] = difference(&level, left);
        }
        for k in 0..left {
            level[k] = between(&level[k], &level[k + 1], at);
        }
    }
    jet
}

/// n!/(n−k)! Δᵏ of the first points, n = 7.
fn difference<const D: usize>(level: &Points<D, 8>, order: usize) -> [f64; D] {
    const WEIGHTS: [[f64; 5]; 5] = [
        [1.0, 0.0, 0.0, 0.0, 0.0],
        [-7.0, 7.0, 0.0, 0.0, 0.0],
        [42.0, -84.0, 42.0, 0.0, 0.0],
        [-210.0, 630.0, -630.0, 210.0, 0.0],
        [840.0, -3360.0, 5040.0, -3360.0, 840.0],
    ];
    let mut sum = [0.0; D];
    for (weight, point) in WEIGHTS[order].iter().zip(level) {
        for d in 0..D {
            sum[d] += weight * point[d];
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x = τ⁷ − 2 τ³ by control points.
    ///
    /// ```text
    /// P_k = Σ_j C(k, j)/C(7, j) a_j
    /// ```
    const CURVE: Points<1, 8> =
        [[0.0], [0.0], [0.0], [-2.0 / 35.0], [-8.0 / 35.0], [-20.0 / 35.0], [-40.0 / 35.0], [-1.0]];

    #[test]
    fn the_jet_is_the_polynomial_with_its_derivatives() {
        for at in [0.0, 0.23, 0.5, 0.81, 1.0] {
            let t: f64 = at;
            let by_hand = [
                t.powi(7) - 2.0 * t.powi(3),
                7.0 * t.powi(6) - 6.0 * t.powi(2),
                42.0 * t.powi(5) - 12.0 * t,
                210.0 * t.powi(4) - 12.0,
                840.0 * t.powi(3),
            ];
            let ours = jet(&CURVE, at);
            for k in 0..5 {
                assert!((ours[k][0] - by_hand[k]).abs() < 1e-11, "derivative {k} at {at}");
            }
        }
    }

    #[test]
    fn the_extremum_is_found_and_bounds_beside_it_are_told_apart() {
        // x' = 0 at τ⁴ = 6/7, where x = τ³ (6/7 − 2) = −(8/7) (6/7)^(3/4).
        let extremum = 8.0 / 7.0 * (6.0_f64 / 7.0).powf(0.75);
        let found = largest_norm(&CURVE, 1e-7);
        assert!((found - extremum).abs() < 2e-6, "{found}");
        assert!(is_within(&CURVE, extremum * (1.0 + 1e-5)));
        assert!(!is_within(&CURVE, extremum * (1.0 - 1e-9)));
        assert!(is_ahead(&CURVE, &[1.0], -extremum * (1.0 + 1e-5)));
        assert!(!is_ahead(&CURVE, &[1.0], -extremum * (1.0 - 1e-9)));
    }

    #[test]
    fn parts_are_the_same_curve() {
        let (left, right) = split(&CURVE, 0.3);
        for at in [0.0, 0.4, 1.0] {
            assert!((jet(&left, at)[0][0] - jet(&CURVE, 0.3 * at)[0][0]).abs() < 1e-14);
            assert!((jet(&right, at)[0][0] - jet(&CURVE, 0.3 + 0.7 * at)[0][0]).abs() < 1e-14);
        }
        let slopes: Points<1, 7> = derivative(&CURVE, 2.0);
        // (7 τ⁶ − 6 τ²)/2 at the end.
        assert!((slopes[6][0] - 0.5).abs() < 1e-12);
    }
}
