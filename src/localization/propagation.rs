//! How the error of the state grows over one inertial step.
//!
//! The nominal step turns by φ = (ω − `b_g`) dt and takes the force in the middle attitude
//! `R_m = R exp(φ/2)`. Its exact derivative has only five blocks that are not trivial:
//!
//! ```text
//! δθ⁺ = E δθ + G δb_g              E = exp(−φ),            G = −J_r(φ) dt
//! δv⁺ = δv + w                     w = C δθ + D δb_g + B δb_a
//! δp⁺ = δp + dt δv + dt/2 w        C = −R (exp(φ/2) f)^ dt,   B = −R_m dt,
//!                                  D = R_m f^ (I − φ^/4) dt²/2
//! ```
//! - `f = a − b_a`: specific force, body axes, m/s²
//!
//! `D` takes `J_r(φ/2)` to first order. White noise is integrated over the step:
//!
//! ```text
//! Q_vv = σ_a² dt,  Q_pv = σ_a² dt²/2,  Q_pp = σ_a² dt³/3,  Q_θθ = σ_g² dt,  Q_vθ = C σ_g² dt/2
//! ```
//! Couplings of higher order correlate less than one in a thousand at 200 Hz and are left out.
//! Source: Solà 2017, section 7 and appendix E; the middle attitude is ours.
//! Checked: `transition_matches_central_difference`, `block_products_equal_the_dense_ones`.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::filter::{Covariance, ImuNoise};
use crate::geometry::{exp_so3, right_jacobian_so3, skew};
use crate::messages::state::{ACCEL_BIAS, ATT, GYRO_BIAS, POS, SIZE, VEL};
use nalgebra::{Matrix3, SVector, Vector3};

/// Φ of one step, by its blocks.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Transition {
    dt: f64,
    E: Matrix3<f64>,
    G: Matrix3<f64>,
    C: Matrix3<f64>,
    D: Matrix3<f64>,
    B: Matrix3<f64>,
}

impl Transition {
    /// Φ over `dt` from the attitude `R` before the step, the attitude `R_mid` in its middle, the
    /// force in body axes and the turn φ.
    pub(super) fn new(
        R: &Matrix3<f64>,
        R_mid: &Matrix3<f64>,
        force: &Vector3<f64>,
        turn: &Vector3<f64>,
        dt: f64,
    ) -> Self {
        let felt = R.tr_mul(&(R_mid * force));
        let D = R_mid * (skew(force) * (Matrix3::identity() - skew(turn) * 0.25));
        Self {
            dt,
            E: exp_so3(&-turn).to_rotation_matrix().into_inner(),
            G: right_jacobian_so3(turn) * -dt,
            C: R * skew(&felt) * -dt,
            D: D * (0.5 * dt * dt),
            B: R_mid * -dt,
        }
    }

    /// Φ x of one column.
    #[inline]
    fn apply(&self, x: &mut [f64; SIZE]) {
        let part = |first: usize| Vector3::new(x[first], x[first + 1], x[first + 2]);
        let (p, att, v) = (part(POS.start), part(ATT.start), part(VEL.start));
        let (gyro, accel) = (part(GYRO_BIAS.start), part(ACCEL_BIAS.start));
        let w = self.C * att + self.D * gyro + self.B * accel;
        let p = p + v * self.dt + w * (0.5 * self.dt);
        let att = self.E * att + self.G * gyro;
        let v = v + w;
        for axis in 0..3 {
            x[POS.start + axis] = p[axis];
            x[ATT.start + axis] = att[axis];
            x[VEL.start + axis] = v[axis];
        }
    }

    /// Φ X.
    pub(super) fn times(&self, X: &Covariance) -> Covariance {
        let mut product = *X;
        let (columns, _) = product.as_mut_slice().as_chunks_mut::<SIZE>();
        for column in columns {
            self.apply(column);
        }
        product
    }

    /// Φ P Φᵀ + Q for a symmetric P.
    pub(super) fn propagated_cov(&self, P: &Covariance, noise: &ImuNoise) -> Covariance {
        // Φ leaves the biases alone, so only its first nine rows change anything.
        const MOVED: usize = VEL.end;
        let half = self.times(P);
        let mut next = *P;
        for row in 0..MOVED {
            let mut column: [f64; SIZE] = std::array::from_fn(|k| half[(row, k)]);
            self.apply(&mut column);
            for (k, value) in column.into_iter().enumerate().skip(row) {
                next[(k, row)] = value;
                next[(row, k)] = value;
            }
        }
        self.add_noise(&mut next, noise);
        next
    }

    fn add_noise(&self, P: &mut Covariance, noise: &ImuNoise) {
        let dt = self.dt;
        let q_a = noise.accel_density_mps2_rthz.powi(2);
        let q_g = noise.gyro_density_radps_rthz.powi(2);
        let cross = self.C * (0.5 * q_g * dt);
        for i in 0..3 {
            let (p, att, v) = (POS.start + i, ATT.start + i, VEL.start + i);
            P[(p, p)] += q_a * dt.powi(3) / 3.0;
            P[(p, v)] += q_a * dt * dt / 2.0;
            P[(v, p)] += q_a * dt * dt / 2.0;
            P[(v, v)] += q_a * dt;
            P[(att, att)] += q_g * dt;
            for j in 0..3 {
                P[(v, ATT.start + j)] += cross[(i, j)];
                P[(ATT.start + j, v)] += cross[(i, j)];
            }
            let (gyro, accel) = (GYRO_BIAS.start + i, ACCEL_BIAS.start + i);
            P[(gyro, gyro)] += noise.gyro_walk_radps_rts.powi(2) * dt;
            P[(accel, accel)] += noise.accel_walk_mps2_rts.powi(2) * dt;
        }
    }

    /// Φ as a dense matrix.
    #[cfg(test)]
    pub(super) fn dense(&self) -> Covariance {
        self.times(&Covariance::identity())
    }
}

/// An error state as a column.
pub(super) type Error = SVector<f64, SIZE>;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::SeedBook;

    #[test]
    fn block_products_equal_the_dense_ones() {
        let mut noise = SeedBook::new(21).stream("blocks");
        for _ in 0..20 {
            let block = |n: &mut crate::stats::Noise| Matrix3::from_fn(|_, _| n.normal());
            let step = Transition {
                dt: 0.02,
                E: block(&mut noise),
                G: block(&mut noise),
                C: block(&mut noise),
                D: block(&mut noise),
                B: block(&mut noise),
            };
            // Φ written out from the equations of the module page.
            let mut F = Covariance::identity();
            let mut set = |row: usize, col: usize, block: &Matrix3<f64>| {
                F.fixed_view_mut::<3, 3>(row, col).copy_from(block);
            };
            set(3, 3, &step.E);
            set(3, 9, &step.G);
            for (row, scale) in [(6, 1.0), (0, 0.01)] {
                set(row, 3, &(step.C * scale));
                set(row, 9, &(step.D * scale));
                set(row, 12, &(step.B * scale));
            }
            set(0, 6, &(Matrix3::identity() * 0.02));
            assert!((step.dense() - F).amax() < 1e-14);
            let half = Covariance::from_fn(|_, _| noise.normal());
            let P = half * half.transpose();
            let silent = ImuNoise {
                accel_density_mps2_rthz: 0.0,
                gyro_density_radps_rthz: 0.0,
                accel_walk_mps2_rts: 0.0,
                gyro_walk_radps_rts: 0.0,
            };
            let next = step.propagated_cov(&P, &silent);
            let dense = F * P * F.transpose();
            assert!((next - dense).amax() < 1e-11 * dense.amax());
            assert!((next - next.transpose()).amax() <= 0.0);
        }
    }
}
