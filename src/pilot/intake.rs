//! Which samples the brain believes at all.
//!
//! The edges refuse what is not finite; here goes what no sensor can mean. A stamp far in the
//! future would put the filter there, where it refuses everything that follows; a force that no
//! accelerometer can show would fill it with infinities.

use crate::messages::{
    FixRecord, ImuSample, LandedState, Scan, TagDetections, VehicleState, Verdict,
};
use crate::stats::chi2_gate_99;
use crate::time::{Mono, Stamp};
use std::time::Duration;

/// Samples may be this much newer than the last tick: the brain can fall behind, clocks differ.
const MAX_AHEAD: Duration = Duration::from_secs(1);
/// Older inertial samples and frames lie before everything that the filter remembers.
const MAX_AGE: Duration = Duration::from_secs(5);
/// Twice the widest range of the usual accelerometers, ±16 g, m/s².
const MAX_FORCE_MPS2: f64 = 320.0;
/// Twice the widest range of the usual gyroscopes, ±2000 °/s, rad/s.
const MAX_RATE_RADPS: f64 = 70.0;

/// True if an inertial sample can be one.
pub(super) fn believes_imu(imu: &ImuSample, now: Stamp<Mono>) -> bool {
    is_near(imu.at, now).is_ok()
        && imu.accel_mps2.amax() <= MAX_FORCE_MPS2
        && imu.gyro_radps.amax() <= MAX_RATE_RADPS
}

/// True if a scan was not measured in the future.
pub(super) fn believes_scan(scan: &Scan, now: Stamp<Mono>) -> bool {
    scan.end() <= now.plus(MAX_AHEAD)
}

/// The record of a frame that the filter must not see, if it must not.
pub(super) fn refusal_of_frame(frame: &TagDetections, now: Stamp<Mono>) -> Option<FixRecord> {
    is_near(frame.captured_at, now).err().map(|verdict| refused_frame(frame, verdict))
}

/// The record of a frame that the filter does not see.
pub(super) fn refused_frame(frame: &TagDetections, verdict: Verdict) -> FixRecord {
    FixRecord::of_frame(frame, chi2_gate_99(6), verdict)
}

/// True if the autopilot's words leave no doubt: a vehicle whose motors may turn can leave the
/// ground before it says so.
pub(super) fn is_on_ground(vehicle: &VehicleState) -> bool {
    !vehicle.is_armed && matches!(vehicle.landed, LandedState::OnGround | LandedState::Unknown)
}

/// Which frames can still come.
#[derive(Debug, Clone)]
pub(super) struct FrameWatch {
    /// The newest treated frame of each camera, if it was ever heard.
    newest: Vec<Option<Stamp<Mono>>>,
}

impl FrameWatch {
    /// A watch over this many cameras.
    pub(super) fn new(n_cameras: usize) -> Self {
        Self { newest: vec![None; n_cameras] }
    }

    /// Remembers a treated frame.
    pub(super) fn note(&mut self, frame: &TagDetections, verdict: Verdict) {
        // A stamp ahead of all samples would say that no frame is expected for a while.
        if verdict != Verdict::FromTheFuture
            && let Some(newest) = self.newest.get_mut(usize::from(frame.camera.0))
        {
            *newest = Some(frame.captured_at).max(*newest);
        }
    }

    /// True once every camera that was heard has delivered a frame captured at `at` or later.
    pub(super) fn have_passed(&self, at: Stamp<Mono>) -> bool {
        self.newest.iter().flatten().all(|newest| *newest >= at)
    }
}

fn is_near(at: Stamp<Mono>, now: Stamp<Mono>) -> Result<(), Verdict> {
    if at > now.plus(MAX_AHEAD) {
        Err(Verdict::FromTheFuture)
    } else if at < now.minus(MAX_AGE) {
        Err(Verdict::TooOld)
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::CameraId;
    use nalgebra::Vector3;

    fn at_s(seconds: i64) -> Stamp<Mono> {
        Stamp::from_nanos(seconds * 1_000_000_000)
    }

    fn imu(at: Stamp<Mono>, force_mps2: f64) -> ImuSample {
        ImuSample { at, accel_mps2: Vector3::z() * force_mps2, gyro_radps: Vector3::zeros() }
    }

    #[test]
    fn samples_from_far_away_in_time_or_scale_are_refused() {
        let now = at_s(100);
        assert!(believes_imu(&imu(now, 9.8), now));
        // A hard landing at 16 g is real.
        assert!(believes_imu(&imu(now, 157.0), now));
        assert!(!believes_imu(&imu(now, 1e6), now));
        assert!(!believes_imu(&imu(now, f64::NAN), now));
        assert!(!believes_imu(&imu(at_s(102), 9.8), now));
        assert!(!believes_imu(&imu(at_s(94), 9.8), now));
        assert!(!believes_scan(&Scan { start: at_s(200), beams: Vec::new() }, now));
    }

    #[test]
    fn scans_wait_for_every_camera_that_was_heard() {
        let frame = |camera: u8, captured_at| TagDetections {
            captured_at,
            received_at: captured_at,
            camera: CameraId(camera),
            tags: Vec::new(),
            points: Vec::new(),
        };
        let mut watch = FrameWatch::new(2);
        assert!(watch.have_passed(at_s(1)), "no camera, nothing to wait for");
        watch.note(&frame(0, at_s(10)), Verdict::Fused);
        watch.note(&frame(1, at_s(9)), Verdict::NoKnownTag);
        assert!(watch.have_passed(at_s(9)) && !watch.have_passed(at_s(10)));
        // A late frame and one from the future move nothing.
        watch.note(&frame(1, at_s(8)), Verdict::TooOld);
        watch.note(&frame(1, at_s(90)), Verdict::FromTheFuture);
        assert!(watch.have_passed(at_s(9)) && !watch.have_passed(at_s(10)));
    }

    #[test]
    fn a_refused_frame_leaves_a_record() {
        let frame = |captured_at| TagDetections {
            captured_at,
            received_at: at_s(100),
            camera: CameraId(0),
            tags: Vec::new(),
            points: Vec::new(),
        };
        let verdict = |at| refusal_of_frame(&frame(at), at_s(100)).map(|record| record.verdict);
        assert_eq!(verdict(at_s(3_000)), Some(Verdict::FromTheFuture));
        assert_eq!(verdict(at_s(10)), Some(Verdict::TooOld));
        assert_eq!(verdict(at_s(99)), None);
    }
}
