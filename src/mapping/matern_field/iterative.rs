//! Conjugate gradients with a preconditioner.

use super::FieldError;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stop {
    /// Residual against the right-hand side, both in the norm of the preconditioner.
    pub(super) residual_ratio: f64,
    /// Most steps.
    pub(super) n_steps: usize,
}

/// What came out, and after how many steps.
#[derive(Debug)]
pub(super) struct Converged {
    pub(super) x: Vec<f64>,
    pub(super) n_steps: usize,
}

/// Solves Q x = b from `start`, with `apply`: x ↦ Q x and `precondition`: r ↦ M⁻¹ r.
///
/// Source: [Hestenes, Stiefel 1952], in the form with the Polak–Ribière quotient, which bears a
/// preconditioner that rounds.
///
/// # Errors
/// [`FieldError::NotConverged`] after `stop.n_steps`.
pub(super) fn conjugate_gradients(
    apply: impl Fn(&[f64], &mut [f64]),
    mut precondition: impl FnMut(&[f64], &mut [f64]),
    b: &[f64],
    start: Vec<f64>,
    stop: Stop,
) -> Result<Converged, FieldError> {
    let n = b.len();
    let mut x = start;
    let (mut r, mut z, mut q_p) = (b.to_vec(), vec![0.0; n], vec![0.0; n]);
    let (mut r_z, mut from_zero) = (0.0, 0.0);
    if x.iter().any(|x| *x != 0.0) {
        apply(&x, &mut q_p);
        r.iter_mut().zip(&q_p).for_each(|(r, q)| *r -= q);
        // 2 bᵀx − xᵀQx = bᵀQ⁻¹b − |x − Q⁻¹b|² in the norm of Q: the scale of b, from below, without
        // preconditioning it.
        from_zero = dot(b, &x) + dot(&r, &x);
        precondition(&r, &mut z);
        r_z = dot(&r, &z);
    }
    if r_z >= from_zero {
        // No start, or one that is hardly better than none.
        x.fill(0.0);
        r.copy_from_slice(b);
        precondition(&r, &mut z);
        r_z = dot(&r, &z);
        from_zero = r_z;
    }
    let bound = from_zero * stop.residual_ratio * stop.residual_ratio;
    let mut p = z.clone();
    for n_steps in 0..=stop.n_steps {
        if r_z <= bound {
            return Ok(Converged { x, n_steps });
        }
        apply(&p, &mut q_p);
        let alpha = r_z / dot(&p, &q_p);
        if !alpha.is_finite() {
            break;
        }
        x.iter_mut().zip(&p).for_each(|(x, p)| *x += alpha * p);
        r.iter_mut().zip(&q_p).for_each(|(r, q)| *r -= alpha * q);
        let old_r_z = dot(&r, &z);
        precondition(&r, &mut z);
        let new_r_z = dot(&r, &z);
        let beta = (new_r_z - old_r_z) / r_z;
        r_z = new_r_z;
        for (p, z) in p.iter_mut().zip(&z) {
            *p = z + beta * *p;
        }
    }
    let ratio = (r_z / bound).sqrt() * stop.residual_ratio;
    Err(FieldError::NotConverged { n_steps: stop.n_steps, residual_ratio: ratio })
}

/// xᵀ y; the partial sums let the compiler use wide registers.
pub(super) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (x_blocks, y_blocks) = (x.chunks_exact(8), y.chunks_exact(8));
    let rest: f64 =
        std::iter::zip(x_blocks.remainder(), y_blocks.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in x_blocks.zip(y_blocks) {
        for k in 0..8 {
            sums[k] += x[k] * y[k];
        }
    }
    sums.iter().sum::<f64>() + rest
}
