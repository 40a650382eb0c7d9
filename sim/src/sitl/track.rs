//! The true motion in the hall, at any instant, from messages that come now and then.

use super::earth::{Earth, Place};
use super::truth::Truth;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::time::Duration;
use stockpilot::geometry::{Body, Hall, Point, Rotation, Transform, exp_so3};
use stockpilot::time::{Mono, Stamp};

/// The share of its distance by which a message's place pulls the track. Places come in steps of
/// 1.1 cm; at 25 Hz this averages over a quarter of a second.
const PULL: f64 = 0.2;
/// A vehicle that is further from where it was expected was put there, m.
const TELEPORT_M: f64 = 1.0;
/// Beyond the newest message the motion goes on for this long; after that nobody knows.
pub(super) const LONGEST_AHEAD: Duration = Duration::from_millis(250);

/// True motion at one instant, in hall axes.
#[derive(Debug, Clone, Copy)]
struct Motion {
    at: Stamp<Mono>,
    place_m: Vector3<f64>,
    velocity_mps: Vector3<f64>,
    hall_from_body: UnitQuaternion<f64>,
    rate_radps: Vector3<f64>,
}

/// The way of a simulated vehicle through the hall.
///
/// The place and heading of the first message are put onto those of a vehicle on its pad, whatever
/// corner of the world the simulator begins in and wherever it looks.
#[derive(Debug, Clone)]
pub struct TruthTrack {
    on_pad: Transform<Hall, Body>,
    start: Option<Start>,
    motions: Vec<Motion>,
    flown_m: f64,
}

/// Where the simulator's world lies in the hall.
#[derive(Debug, Clone, Copy)]
struct Start {
    place: Place,
    earth: Earth,
    /// Takes north-west-up to hall axes.
    hall_from_nwu: UnitQuaternion<f64>,
}

impl TruthTrack {
    /// A track that begins on a pad, with the pose of the body there.
    #[must_use]
    pub const fn new(on_pad: Transform<Hall, Body>) -> Self {
        Self { on_pad, start: None, motions: Vec::new(), flown_m: 0.0 }
    }

    /// Takes in what was true at `at`; earlier instants than the last are ignored.
    pub fn push(&mut self, at: Stamp<Mono>, truth: &Truth) {
        if self.motions.last().is_some_and(|last| last.at >= at) {
            return;
        }
        let start = *self.start.get_or_insert_with(|| Start {
            place: truth.place,
            earth: truth.earth,
            hall_from_nwu: level_turn(
                self.on_pad.rotation.yaw_rad() - yaw_rad(&nwu_from_flu(&truth.ned_from_body)),
            ),
        });
        let to_hall = |ned: &Vector3<f64>| start.hall_from_nwu * flipped(ned);
        let told_m =
            self.on_pad.origin.coords + to_hall(&truth.earth.ned_m(&start.place, &truth.place));
        let velocity_mps = to_hall(&truth.velocity_ned_mps);
        let place_m = self.motions.last().map_or(told_m, |last| {
            let dt_s = at.seconds_since(last.at);
            let mean_mps = 0.5 * (last.velocity_mps + velocity_mps);
            let expected_m = last.place_m + mean_mps * dt_s;
            let off_m = told_m - expected_m;
            if off_m.norm() > TELEPORT_M { told_m } else { expected_m + PULL * off_m }
        });
        self.flown_m += self.motions.last().map_or(0.0, |last| (place_m - last.place_m).norm());
        self.motions.push(Motion {
            at,
            place_m,
            velocity_mps,
            hall_from_body: start.hall_from_nwu * nwu_from_flu(&truth.ned_from_body),
            rate_radps: flipped(&truth.rate_frd_radps),
        });
    }

    /// The pose at an instant: between two messages on the curve that has both their places and
    /// velocities, and for a quarter of a second beyond the last at its velocity and turn rate;
    /// `None` before the first and after that.
    #[must_use]
    pub fn at(&self, at: Stamp<Mono>) -> Option<Transform<Hall, Body>> {
        let after = self.motions.partition_point(|motion| motion.at <= at);
        let from = self.motions.get(after.checked_sub(1)?)?;
        let (place_m, attitude) = match self.motions.get(after) {
            Some(to) => between(from, to, at),
            None if at.since(from.at) <= LONGEST_AHEAD => {
                let ahead_s = at.seconds_since(from.at);
                let turned = from.hall_from_body * exp_so3(&(from.rate_radps * ahead_s));
                (from.place_m + from.velocity_mps * ahead_s, turned)
            }
            None => return None,
        };
        Some(Transform::new(Rotation::from_quaternion(attitude), Point::from_coords(place_m)))
    }

    /// Length of the way so far, m.
    #[must_use]
    pub const fn flown_m(&self) -> f64 {
        self.flown_m
    }

    /// Whose earth it is; `None` before the first message.
    #[must_use]
    pub fn earth(&self) -> Option<Earth> {
        self.start.map(|start| start.earth)
    }

    /// Messages so far.
    #[must_use]
    pub const fn n_messages(&self) -> usize {
        self.motions.len()
    }
}

/// Cubic in the place (Hermite), along the great circle in the attitude.
fn between(from: &Motion, to: &Motion, at: Stamp<Mono>) -> (Vector3<f64>, UnitQuaternion<f64>) {
    let span_s = to.at.seconds_since(from.at);
    let s = at.seconds_since(from.at) / span_s;
    let (s2, s3) = (s * s, s * s * s);
    let place_m = from.place_m * (2.0 * s3 - 3.0 * s2 + 1.0)
        + from.velocity_mps * (span_s * (s3 - 2.0 * s2 + s))
        + to.place_m * (3.0 * s2 - 2.0 * s3)
        + to.velocity_mps * (span_s * (s3 - s2));
    (place_m, from.hall_from_body.slerp(&to.hall_from_body, s))
}

/// (x, −y, −z): NED to north-west-up, FRD to forward-left-up, and back.
fn flipped(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, -v.y, -v.z)
}

/// The same attitude between axes that point up.
fn nwu_from_flu(ned_from_frd: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let q = ned_from_frd.quaternion();
    UnitQuaternion::new_normalize(Quaternion::new(q.w, q.i, -q.j, -q.k))
}

fn yaw_rad(attitude: &UnitQuaternion<f64>) -> f64 {
    attitude.euler_angles().2
}

fn level_turn(yaw_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a vehicle that circles at 2 m/s with 4 m of radius and climbs, nose along its way, after
    /// a start at rest; in NED from home, told as PX4 tells it: cut to 1e-7°, mm and cm/s.
    fn told(seconds: f64) -> (Truth, Vector3<f64>, f64) {
        let (w, r) = (0.5, 4.0);
        let angle = w * seconds;
        let ned = Vector3::new(r * angle.sin(), r * (1.0 - angle.cos()), -0.3 * seconds);
        let velocity = Vector3::new(r * w * angle.cos(), r * w * angle.sin(), -0.3);
        let home = (47.397_742_f64, 8.545_594_f64);
        let step = |m: f64, m_per_deg: f64| m / m_per_deg;
        let cut = |value: f64, unit: f64| (value / unit).trunc() * unit;
        // A degree of WGS84 at this place: 111 187.14 m and 75 495.52 m.
        let latitude = cut(home.0 + step(ned.x, 111_187.14), 1e-7);
        let longitude = cut(home.1 + step(ned.y, 75_495.52), 1e-7);
        let truth = Truth {
            place: Place {
                latitude_rad: latitude.to_radians(),
                longitude_rad: longitude.to_radians(),
                altitude_m: cut(489.4 - ned.z, 1e-3),
            },
            ned_from_body: UnitQuaternion::from_euler_angles(0.05, -0.1, angle),
            velocity_ned_mps: velocity.map(|v| cut(v, 1e-2)),
            rate_frd_radps: Vector3::new(0.0, 0.0, w),
            earth: Earth::Wgs84,
        };
        (truth, ned, angle)
    }

    fn at_s(seconds: f64) -> Stamp<Mono> {
        Stamp::ZERO.plus(Duration::from_secs_f64(seconds))
    }

    /// On a pad at (3, −2, 0.15) that looks along 30°.
    fn on_pad() -> Transform<Hall, Body> {
        let rotation = Rotation::from_euler_rad(0.0, 0.0, 30_f64.to_radians());
        Transform::new(rotation, Point::new(3.0, -2.0, 0.15))
    }

    #[test]
    fn the_track_is_the_true_way_put_onto_the_pad() {
        let mut track = TruthTrack::new(on_pad());
        for k in 0..500 {
            let seconds = f64::from(k) * 0.04;
            track.push(at_s(seconds), &told(seconds).0);
        }
        let mut worst_m = 0.0_f64;
        for k in 100..1_990 {
            let seconds = f64::from(k) * 0.01 + 0.003;
            let (_, ned, angle) = told(seconds);
            // By hand: the first message looked north and the pad looks along 30°, so north is
            // there, east is 90° to the right of it.
            let (sin, cos) = 30_f64.to_radians().sin_cos();
            let expected = Vector3::new(
                3.0 + cos * ned.x + sin * ned.y,
                -2.0 + sin * ned.x - cos * ned.y,
                0.15 - ned.z,
            );
            let pose = track.at(at_s(seconds)).expect("known");
            worst_m = worst_m.max((pose.origin.coords - expected).norm());
            let heading_rad = 30_f64.to_radians() - angle;
            let off_rad = stockpilot::units::wrapped_rad(pose.rotation.yaw_rad() - heading_rad);
            assert!(off_rad.abs() < 1e-3, "{off_rad}");
        }
        // Steps of 1.1 cm, cut and not rounded: the raw places are off by up to 1.6 cm.
        assert!(worst_m < 0.012, "{worst_m}");
    }

    #[test]
    fn beyond_the_last_message_the_motion_goes_on_for_a_quarter_of_a_second() {
        let mut track = TruthTrack::new(on_pad());
        for k in 0..100 {
            let seconds = f64::from(k) * 0.04;
            track.push(at_s(seconds), &told(seconds).0);
        }
        let last_s = 99.0 * 0.04;
        let here = track.at(at_s(last_s)).expect("known").origin.coords;
        let ahead = track.at(at_s(last_s + 0.1)).expect("known").origin.coords;
        // 2 m/s level and 0.3 m/s up for a tenth of a second; the arc bends by 5 mm.
        assert!(((ahead - here).norm() - 0.2022).abs() < 2e-3);
        assert!(track.at(at_s(last_s + 0.24)).is_some());
        assert!(track.at(at_s(last_s + 0.26)).is_none());
        assert!(track.at(Stamp::ZERO.minus(Duration::from_secs(1))).is_none());
    }
}
