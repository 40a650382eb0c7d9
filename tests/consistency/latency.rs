//! The whole localizer, loose and tight, with frames that come late: errors stay in their bands.

use crate::scene::{Flight, settings};
use stockpilot::localization::Update;
use stockpilot::messages::{FixSource, Verdict};

const N_FLIGHTS: u64 = 10;
/// Between two frames, so that it matters how late the last one is.
const LOOKS_S: [f64; 3] = [6.02, 9.02, 12.02];

/// The band of 99 % for the mean of `n` χ² draws with `dof` degrees of freedom, nearly normal: few
/// flights, and the looks of one are not quite independent. Thirty flights of three looks keep
/// that of 95 %.
fn band(dof: f64, n: f64) -> (f64, f64) {
    let reach = 2.576 * (2.0 * dof / n).sqrt();
    (dof - reach, dof + reach)
}

struct Outcome {
    /// Mean NEES of position, attitude, velocity over flights and looks.
    nees: [f64; 3],
    /// NIS over its degrees of freedom, mean over all frames.
    nis_ratio: f64,
    fused: f64,
    position_rms_m: f64,
    yaw_rms_deg: f64,
}

fn fly(update: Update, latency_s: f64) -> Outcome {
    let mut all = Outcome {
        nees: [0.0; 3],
        nis_ratio: 0.0,
        fused: 0.0,
        position_rms_m: 0.0,
        yaw_rms_deg: 0.0,
    };
    let (mut n_looks, mut n_frames, mut nis, mut dof) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..N_FLIGHTS {
        let mut flight = Flight::new(seed, settings(update), latency_s);
        for look in LOOKS_S {
            while flight.t() < look {
                flight.step(&mut |_, _| true);
            }
            for (sum, nees) in all.nees.iter_mut().zip(flight.nees()) {
                *sum += nees;
            }
            let error = flight.error();
            all.position_rms_m += error[0].norm_squared();
            // Nearly level: the third component of the attitude error is the yaw.
            all.yaw_rms_deg += error[1].z.to_degrees().powi(2);
            n_looks += 1.0;
        }
        let started = flight.records.iter().filter(|record| record.at.seconds() > 4.0);
        for record in started {
            n_frames += 1.0;
            all.fused += f64::from(u8::from(record.verdict == Verdict::Fused));
            if let Some(frame_nis) = record.nis {
                nis += frame_nis;
                #[expect(clippy::cast_precision_loss, reason = "few points")]
                let n = match record.source {
                    FixSource::Tight => 2.0 * record.n_points_used as f64,
                    _ => 6.0,
                };
                dof += n;
            }
        }
    }
    all.nees.iter_mut().for_each(|sum| *sum /= n_looks);
    all.position_rms_m = (all.position_rms_m / n_looks).sqrt();
    all.yaw_rms_deg = (all.yaw_rms_deg / n_looks).sqrt();
    all.nis_ratio = nis / dof;
    all.fused /= n_frames;
    all
}

fn assert_honest(update: Update, latency_s: f64) {
    let seen = fly(update, latency_s);
    #[expect(clippy::cast_precision_loss, reason = "few")]
    let n = N_FLIGHTS as f64 * LOOKS_S.len() as f64;
    let (low, high) = band(3.0, n);
    println!(
        "{update:?}, {latency_s} s late: NEES {:.2?} in {low:.2} to {high:.2}, NIS/dof {:.3}, \
         fused {:.4}, rms {:.4} m {:.4}°",
        seen.nees, seen.nis_ratio, seen.fused, seen.position_rms_m, seen.yaw_rms_deg
    );
    assert!(seen.nees.iter().all(|nees| (low..=high).contains(nees)), "{:?}", seen.nees);
    // The mean of 2,000 frames with 6 and more degrees of freedom scatters by less than 0.013.
    assert!((0.94..1.06).contains(&seen.nis_ratio), "{}", seen.nis_ratio);
    assert!(seen.fused > 0.97 && seen.position_rms_m < 0.03 && seen.yaw_rms_deg < 0.3);
}

#[test]
fn loose_10_ms_late() {
    assert_honest(Update::Loose, 0.01);
}

#[test]
fn loose_30_ms_late() {
    assert_honest(Update::Loose, 0.03);
}

#[test]
fn loose_150_ms_late() {
    assert_honest(Update::Loose, 0.15);
}

#[test]
fn tight_10_ms_late() {
    assert_honest(Update::Tight, 0.01);
}

#[test]
fn tight_30_ms_late() {
    assert_honest(Update::Tight, 0.03);
}

#[test]
fn tight_150_ms_late() {
    assert_honest(Update::Tight, 0.15);
}
