//! What is wrong with a vehicle's calibration: stated by its σ, and drawn anew for every run.
//!
//! The truth's sensors get the drawn errors, the service keeps the nominal values; only the map of
//! the markers is the other way round: the markers hang where they hang, and the service's map of
//! them is wrong. A service that is told these σ has to claim an uncertainty that covers them.

use crate::lidar::LidarModel;
use crate::world::PlacedTag;
use clap::ValueEnum;
use nalgebra::{Rotation3, Vector3};
use stockpilot::geometry::{Hall, Point};
use stockpilot::stats::SeedBook;

/// Standard deviations of the errors of calibration, as an honest integrator would state them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationSigmas {
    /// Constant error of every range, m.
    pub range_bias_sigma_m: f64,
    /// Error of a range per range, no unit.
    pub range_scale_sigma: f64,
    /// Place of the LiDAR on the body, each axis, m.
    pub mount_position_sigma_m: f64,
    /// Direction of the LiDAR on the body, about each axis, deg.
    pub mount_rotation_sigma_deg: f64,
    /// Stamps of the LiDAR against the clock of the inertial samples, ms.
    pub clock_offset_sigma_ms: f64,
    /// Place of each marker in the service's map, each axis, independent of the others, m.
    pub marker_sigma_m: f64,
    /// Place of the service's map of the markers as a whole, each axis, m.
    pub marker_datum_sigma_m: f64,
    /// Direction of each marker in the service's map, about each axis, deg.
    pub marker_rotation_sigma_deg: f64,
}

impl CalibrationSigmas {
    /// A vehicle that is exactly as its configuration says.
    pub const NONE: Self = Self {
        range_bias_sigma_m: 0.0,
        range_scale_sigma: 0.0,
        mount_position_sigma_m: 0.0,
        mount_rotation_sigma_deg: 0.0,
        clock_offset_sigma_ms: 0.0,
        marker_sigma_m: 0.0,
        marker_datum_sigma_m: 0.0,
        marker_rotation_sigma_deg: 0.0,
    };

    /// These σ for the named sources, 0 for the others.
    #[must_use]
    pub fn only(&self, sources: &[ErrorSource]) -> Self {
        let kept = |source, sigma: f64| if sources.contains(&source) { sigma } else { 0.0 };
        Self {
            range_bias_sigma_m: kept(ErrorSource::Range, self.range_bias_sigma_m),
            range_scale_sigma: kept(ErrorSource::Range, self.range_scale_sigma),
            mount_position_sigma_m: kept(ErrorSource::Mount, self.mount_position_sigma_m),
            mount_rotation_sigma_deg: kept(ErrorSource::Mount, self.mount_rotation_sigma_deg),
            clock_offset_sigma_ms: kept(ErrorSource::Clock, self.clock_offset_sigma_ms),
            marker_sigma_m: kept(ErrorSource::Markers, self.marker_sigma_m),
            marker_datum_sigma_m: kept(ErrorSource::Datum, self.marker_datum_sigma_m),
            marker_rotation_sigma_deg: kept(ErrorSource::Markers, self.marker_rotation_sigma_deg),
        }
    }
}

impl Default for CalibrationSigmas {
    fn default() -> Self {
        Self {
            range_bias_sigma_m: 0.010,
            range_scale_sigma: 0.001,
            mount_position_sigma_m: 0.005,
            mount_rotation_sigma_deg: 0.2,
            clock_offset_sigma_ms: 2.0,
            marker_sigma_m: 0.005,
            marker_datum_sigma_m: 0.005,
            marker_rotation_sigma_deg: 0.0,
        }
    }
}

/// What may be wrong with a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ErrorSource {
    /// Bias and scale of the ranges.
    Range,
    /// Place and direction of the LiDAR on the body.
    Mount,
    /// Stamps of the LiDAR.
    Clock,
    /// The map of the markers.
    Markers,
    /// The map of the markers as a whole; beside `markers` only, and not among the usual ones: the
    /// service's own σ of it is 0.
    Datum,
}

/// The errors of one run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CalibrationErrors {
    /// The sensor reports ranges longer by this, m.
    pub range_bias_m: f64,
    /// The sensor reports ranges longer by this times the range.
    pub range_scale: f64,
    /// The true place of the LiDAR minus the nominal one, in body axes, m.
    pub mount_position_m: Vector3<f64>,
    /// Rotation vector from the nominal to the true axes of the LiDAR, in nominal LiDAR axes, rad.
    pub mount_rotation_rad: Vector3<f64>,
    /// Stamps of the LiDAR are later than the truth by this, s.
    pub clock_offset_s: f64,
    /// Errors of the service's map, one for each marker in the order of the hall's; none without.
    pub markers: Vec<MarkerError>,
    /// The service's map of all markers minus the truth, in hall axes, m.
    pub datum_m: Vector3<f64>,
}

/// Where the service's map has a marker, against where it hangs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MarkerError {
    /// The mapped middle minus the true one, in hall axes, m.
    pub shift_m: Vector3<f64>,
    /// Rotation vector from the true to the mapped corners about the middle, in hall axes, rad.
    pub turn_rad: Vector3<f64>,
}

impl CalibrationErrors {
    /// The errors of the run with these seeds, each source from a stream of its own.
    #[must_use]
    pub fn drawn(sigmas: &CalibrationSigmas, n_markers: usize, seeds: SeedBook) -> Self {
        let stream = |source: &str| seeds.stream(&format!("calibration.{source}"));
        let mut range = stream("range");
        let mut mount = stream("mount");
        let mut markers = stream("markers");
        let marker_turn_sigma_rad = sigmas.marker_rotation_sigma_deg.to_radians();
        Self {
            range_bias_m: sigmas.range_bias_sigma_m * range.normal(),
            range_scale: sigmas.range_scale_sigma * range.normal(),
            mount_position_m: sigmas.mount_position_sigma_m * mount.normal3(),
            mount_rotation_rad: sigmas.mount_rotation_sigma_deg.to_radians() * mount.normal3(),
            clock_offset_s: 1e-3 * sigmas.clock_offset_sigma_ms * stream("clock").normal(),
            markers: (0..n_markers)
                .map(|_| MarkerError {
                    shift_m: sigmas.marker_sigma_m * markers.normal3(),
                    turn_rad: marker_turn_sigma_rad * markers.normal3(),
                })
                .collect(),
            datum_m: sigmas.marker_datum_sigma_m * stream("datum").normal3(),
        }
    }

    /// The sensor as it really is, from the one that the service believes in.
    #[must_use]
    pub fn true_lidar(&self, nominal: &LidarModel) -> LidarModel {
        LidarModel {
            body_from_lidar: nominal
                .body_from_lidar
                .perturbed(&self.mount_position_m, &self.mount_rotation_rad),
            range_bias_m: nominal.range_bias_m + self.range_bias_m,
            range_scale: nominal.range_scale + self.range_scale,
            stamp_offset_s: nominal.stamp_offset_s + self.clock_offset_s,
            ..nominal.clone()
        }
    }

    /// The corners of a marker as the service's map has them; `index` counts the hall's markers.
    #[must_use]
    pub fn mapped_corners(&self, index: usize, tag: &PlacedTag) -> [Point<Hall>; 4] {
        let error = self.markers.get(index).copied().unwrap_or_default();
        let turn = Rotation3::from_scaled_axis(error.turn_rad);
        let middle_m = tag.centre().coords;
        tag.corners.map(|corner| {
            let shift_m = self.datum_m + error.shift_m;
            Point::from_coords(middle_m + shift_m + turn * (corner.coords - middle_m))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::World;
    use stockpilot::geometry::Lidar;

    /// Each number of `n` runs, divided by its σ.
    fn standardised(n: u64) -> Vec<Vec<f64>> {
        let sigmas =
            CalibrationSigmas { marker_rotation_sigma_deg: 0.3, ..CalibrationSigmas::default() };
        let of = |seed| {
            let e = CalibrationErrors::drawn(&sigmas, 2, SeedBook::new(seed));
            let mut z =
                vec![e.range_bias_m / 0.010, e.range_scale / 0.001, e.clock_offset_s / 0.002];
            z.extend(e.mount_position_m.iter().map(|m| m / 0.005));
            z.extend(e.mount_rotation_rad.iter().map(|rad| rad.to_degrees() / 0.2));
            z.extend(e.datum_m.iter().map(|m| m / 0.005));
            for marker in &e.markers {
                z.extend(marker.shift_m.iter().map(|m| m / 0.005));
                z.extend(marker.turn_rad.iter().map(|rad| rad.to_degrees() / 0.3));
            }
            z
        };
        (0..n).map(of).collect()
    }

    #[test]
    fn drawn_errors_have_the_stated_scatter_and_are_independent() {
        let runs = standardised(4000);
        let n = runs.len() as f64;
        let width = runs[0].len();
        assert_eq!(width, 24);
        for a in 0..width {
            let mean = runs.iter().map(|z| z[a]).sum::<f64>() / n;
            // Four and a half standard errors: 1/√n of the mean, √(2/n) of the variance, 1/√n of
            // a product.
            assert!(mean.abs() < 4.5 / n.sqrt(), "number {a}: mean {mean}");
            for b in 0..=a {
                let product = runs.iter().map(|z| z[a] * z[b]).sum::<f64>() / n;
                let (expected, error) =
                    if a == b { (1.0, (2.0 / n).sqrt()) } else { (0.0, 1.0 / n.sqrt()) };
                assert!((product - expected).abs() < 4.5 * error, "numbers {a}, {b}: {product}");
            }
        }
    }

    #[test]
    fn one_source_alone_draws_the_same_as_among_all() {
        let all = CalibrationSigmas::default();
        let drawn =
            |sigmas: &CalibrationSigmas| CalibrationErrors::drawn(sigmas, 3, SeedBook::new(5));
        let clock = drawn(&all.only(&[ErrorSource::Clock]));
        assert!((clock.clock_offset_s - drawn(&all).clock_offset_s).abs() < 1e-15);
        let exact = CalibrationErrors { clock_offset_s: 0.0, ..clock };
        assert_eq!(exact, drawn(&CalibrationSigmas::NONE));
        assert_eq!(all.only(&[]), CalibrationSigmas::NONE);
        assert_eq!(all.only(ErrorSource::value_variants()), all);
    }

    #[test]
    fn same_seed_draws_the_same_errors() {
        let drawn =
            |seed| CalibrationErrors::drawn(&CalibrationSigmas::default(), 5, SeedBook::new(seed));
        assert_eq!(drawn(7), drawn(7));
        assert_ne!(drawn(7), drawn(8));
    }

    #[test]
    fn a_turned_mount_moves_a_far_point_by_angle_times_range() {
        let nominal = LidarModel::ld19();
        let errors = CalibrationErrors {
            mount_position_m: Vector3::new(0.003, -0.004, 0.005),
            // About z of the LiDAR, which is forward of the body: the beam straight down swings
            // sideways, from lidar x to lidar y, which is the body's left.
            mount_rotation_rad: Vector3::new(0.0, 0.0, 0.01),
            ..CalibrationErrors::default()
        };
        let ahead = Point::<Lidar>::new(10.0, 0.0, 0.0);
        let moved =
            errors.true_lidar(&nominal).body_from_lidar * ahead - nominal.body_from_lidar * ahead;
        let by_hand = Vector3::new(0.003, 10.0 * 0.01_f64.sin() - 0.004, 0.005)
            + Vector3::z() * 10.0 * (1.0 - 0.01_f64.cos());
        assert!((moved.coords - by_hand).norm() < 1e-9, "{moved:?}");
    }

    #[test]
    fn the_map_of_the_markers_is_shifted_and_stays_square() {
        let world = World::alps(0).unwrap();
        let sigmas =
            CalibrationSigmas { marker_rotation_sigma_deg: 0.5, ..CalibrationSigmas::default() };
        let errors = CalibrationErrors::drawn(&sigmas, world.tags.len(), SeedBook::new(3));
        for (i, tag) in world.tags.iter().enumerate() {
            let mapped = errors.mapped_corners(i, tag);
            let middle = mapped.iter().map(|c| c.coords).sum::<Vector3<f64>>() / 4.0;
            let shift_m = middle - tag.centre().coords;
            assert!((shift_m - errors.datum_m - errors.markers[i].shift_m).norm() < 1e-12);
            for k in 0..4 {
                let edge_m = (mapped[k] - mapped[(k + 1) % 4]).coords.norm();
                assert!((edge_m - tag.edge_m).abs() < 1e-12);
            }
            let exact = CalibrationErrors::default().mapped_corners(i, tag);
            assert!(std::iter::zip(exact, tag.corners).all(|(a, b)| (a - b).coords.norm() < 1e-12));
        }
    }
}
