//! From the numbers of a packet to directions and distances.

use crate::lidar::{Model, Sample};

/// How a model's numbers are meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Geometry {
    /// Triangulation: ¼ mm, and the direction depends on the distance.
    Triangle,
    /// Time of flight: mm, the direction is the head's.
    TimeOfFlight,
}

/// Constants of the triangulating optics, mm.
const BASE_MM: f64 = 21.8;
const FOCUS_MM: f64 = 155.3;
/// Below this tangent a polynomial gives the arc to 2e-8 rad.
const SMALL_TANGENT: f64 = 0.25;

impl Geometry {
    /// That of a model.
    #[must_use]
    pub const fn of(model: Model) -> Self {
        match model {
            Model::YdlidarX2 | Model::YdlidarX4 | Model::YdlidarG4 => Self::Triangle,
            _ => Self::TimeOfFlight,
        }
    }

    /// A sample with the head at `head_deg` in [0, 720).
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "single precision is what a sample holds")]
    pub(super) fn sample(self, head_deg: f64, distance: Distance, intensity: u8) -> Sample {
        let range_mm = match (self, distance) {
            (Self::TimeOfFlight, Distance::Whole(mm)) => f64::from(mm),
            (_, Distance::Whole(quarters) | Distance::Flagged(quarters)) => {
                0.25 * f64::from(quarters)
            }
        };
        let turned_deg = match self {
            // Nothing came back from as far as the beam reaches: farther than the optics bend it by any more.
            Self::Triangle if range_mm > 0.0 => head_deg + correction_deg(range_mm),
            Self::Triangle => head_deg + correction_deg(f64::MAX),
            Self::TimeOfFlight => head_deg,
        };
        Sample {
            clockwise_deg: wrapped_deg(turned_deg) as f32,
            range_m: (range_mm * 1e-3) as f32,
            intensity,
        }
    }
}

/// A distance as transmitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Distance {
    /// All bits, in the model's unit.
    Whole(u16),
    /// The upper 14 bits, ¼ mm; the two below were flags.
    Flagged(u16),
}

/// What the optics of triangulating models add to the head's angle, °.
///
/// ```text
/// atan(21.8 · (155.3 − d) / (155.3 · d))        d in mm
/// ```
fn correction_deg(range_mm: f64) -> f64 {
    let tangent = BASE_MM * (1.0 / range_mm - 1.0 / FOCUS_MM);
    arc_of(tangent).to_degrees()
}

/// The arc of a tangent, which is small for all but the nearest ranges.
fn arc_of(tangent: f64) -> f64 {
    if tangent.abs() > SMALL_TANGENT {
        return tangent.atan();
    }
    let square = tangent * tangent;
    tangent * (1.0 - square * (1.0 / 3.0 - square * (0.2 - square * (1.0 / 7.0 - square / 9.0))))
}

/// Into [0, 360) from at most two turns below or above.
fn wrapped_deg(deg: f64) -> f64 {
    let mut deg = deg;
    while deg >= 360.0 {
        deg -= 360.0;
    }
    while deg < 0.0 {
        deg += 360.0;
    }
    deg
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corrections_are_those_of_the_maker() {
        // Values of the maker's formula as printed: −6.76° at 1 m, −7.84° at 8 m.
        assert!((correction_deg(1000.0) + 6.76).abs() < 0.01);
        assert!((correction_deg(8000.0) + 7.84).abs() < 0.01);
    }

    #[test]
    fn the_polynomial_agrees_with_the_arc_tangent() {
        for k in -250..=250 {
            let tangent = f64::from(k) * 1e-3;
            assert!((arc_of(tangent) - tangent.atan()).abs() < 3e-8, "{tangent}");
        }
    }

    #[test]
    fn negative_corrected_angles_wrap_into_the_turn() {
        let sample = Geometry::Triangle.sample(2.0, Distance::Whole(4000), 0);
        assert!((f64::from(sample.clockwise_deg) - (362.0 - 6.76)).abs() < 0.01);
        assert!((sample.range_m - 1.0).abs() < 1e-6);
        // atan(−21.8/155.3) = −7.99°: beside its neighbours that see something far away.
        let silent = Geometry::Triangle.sample(20.0, Distance::Whole(0), 0);
        assert!((f64::from(silent.clockwise_deg) - (20.0 - 7.99)).abs() < 0.01);
    }
}
