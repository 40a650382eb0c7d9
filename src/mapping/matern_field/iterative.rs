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
    let (mut z, mut q_p) = (vec![0.0; n], vec![0.0; n]);
    precondition(b, &mut z);
    let from_zero = dot(b, &z);
    let bound = from_zero * stop.residual_ratio * stop.residual_ratio;
    let (mut r, mut r_z) = (b.to_vec(), from_zero);
    let mut p = z.clone();
    if x.iter().any(|x| *x != 0.0) {
        apply(&x, &mut q_p);
        r.iter_mut().zip(&q_p).for_each(|(r, q)| *r -= q);
        precondition(&r, &mut z);
        r_z = dot(&r, &z);
        if r_z < from_zero {
            p.clone_from(&z);
        } else {
            // A start that is worse than none.
            x.fill(0.0);
            (r, z, r_z) = (b.to_vec(), p.clone(), from_zero);
        }
    }
    for n_steps in 0..=stop.n_steps {
        if r_z <= bound {
            return Ok(Converged { x, n_steps });
        }
        apply(&p, &mut q_p);
        let alpha = r_z / dot(&p, &q_p);
        if !alpha.is_finite() {
            break;
        }
        let mut old_r_z = 0.0;
        for i in 0..n {
            x[i] += alpha * p[i];
            r[i] -= alpha * q_p[i];
            old_r_z += r[i] * z[i];
        }
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
