//! A value with its type, and the float that carries it.

use mavlink::dialects::ardupilotmega::MavParamType;
use std::fmt;

/// How an autopilot puts whole numbers into the float field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// The bits of the number (PX4).
    Bytewise,
    /// The number as a float (ArduPilot).
    CCast,
}

/// The types that autopilots use for parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// 8 bits, with sign.
    Int8,
    /// 16 bits, with sign.
    Int16,
    /// 32 bits, with sign.
    Int32,
    /// A float.
    Real32,
}

impl Kind {
    /// `None` for the types that no autopilot here uses.
    pub(crate) const fn from_wire(kind: MavParamType) -> Option<Self> {
        match kind {
            MavParamType::MAV_PARAM_TYPE_INT8 => Some(Self::Int8),
            MavParamType::MAV_PARAM_TYPE_INT16 => Some(Self::Int16),
            MavParamType::MAV_PARAM_TYPE_INT32 => Some(Self::Int32),
            MavParamType::MAV_PARAM_TYPE_REAL32 => Some(Self::Real32),
            _ => None,
        }
    }

    pub(crate) const fn to_wire(self) -> MavParamType {
        match self {
            Self::Int8 => MavParamType::MAV_PARAM_TYPE_INT8,
            Self::Int16 => MavParamType::MAV_PARAM_TYPE_INT16,
            Self::Int32 => MavParamType::MAV_PARAM_TYPE_INT32,
            Self::Real32 => MavParamType::MAV_PARAM_TYPE_REAL32,
        }
    }

    /// MAVLink's number, as parameter files write it.
    pub(super) const fn from_number(number: u8) -> Option<Self> {
        match number {
            2 => Some(Self::Int8),
            4 => Some(Self::Int16),
            6 => Some(Self::Int32),
            9 => Some(Self::Real32),
            _ => None,
        }
    }

    const fn whole_range(self) -> Option<(i32, i32)> {
        match self {
            Self::Int8 => Some((i8::MIN as i32, i8::MAX as i32)),
            Self::Int16 => Some((i16::MIN as i32, i16::MAX as i32)),
            Self::Int32 => Some((i32::MIN, i32::MAX)),
            Self::Real32 => None,
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Int8 => "INT8",
            Self::Int16 => "INT16",
            Self::Int32 => "INT32",
            Self::Real32 => "REAL32",
        })
    }
}

/// A whole number or a float.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// Of any of the whole types.
    Whole(i32),
    /// Of type REAL32; finite.
    Real(f32),
}

impl Value {
    /// The number.
    #[must_use]
    pub fn as_f64(self) -> f64 {
        match self {
            Self::Whole(value) => f64::from(value),
            Self::Real(value) => f64::from(value),
        }
    }

    /// The number in a text, as a value of this type; `None` if it is none, or does not fit.
    #[must_use]
    pub fn parse(text: &str, kind: Kind) -> Option<Self> {
        let Some((low, high)) = kind.whole_range() else {
            return text.parse().ok().filter(|value: &f32| value.is_finite()).map(Self::Real);
        };
        // Tools write whole numbers as 4, 4.0 and 4.000000.
        let number: f64 = text.parse().ok()?;
        let fits = is_whole(number) && f64::from(low) <= number && number <= f64::from(high);
        #[expect(clippy::cast_possible_truncation, reason = "whole and in range")]
        fits.then_some(Self::Whole(number as i32))
    }

    /// What the float field says; `None` if it does not fit the type.
    #[must_use]
    pub fn from_wire(field: f32, kind: Kind, encoding: Encoding) -> Option<Self> {
        let Some((low, high)) = kind.whole_range() else {
            return field.is_finite().then_some(Self::Real(field));
        };
        let number = match encoding {
            Encoding::Bytewise => match kind {
                // The narrow types stand in the low bytes.
                Kind::Int8 => i32::from(field.to_bits().to_le_bytes()[0].cast_signed()),
                Kind::Int16 => {
                    let [a, b, ..] = field.to_bits().to_le_bytes();
                    i32::from(i16::from_le_bytes([a, b]))
                }
                Kind::Int32 | Kind::Real32 => field.to_bits().cast_signed(),
            },
            Encoding::CCast => {
                let number = f64::from(field);
                let fits =
                    is_whole(number) && f64::from(low) <= number && number <= f64::from(high);
                #[expect(clippy::cast_possible_truncation, reason = "whole and in range")]
                if fits { number as i32 } else { return None }
            }
        };
        Some(Self::Whole(number))
    }

    /// The float field; `None` if this encoding cannot hold the number exactly.
    #[must_use]
    pub fn to_wire(self, encoding: Encoding) -> Option<f32> {
        match (self, encoding) {
            (Self::Real(value), _) => Some(value),
            (Self::Whole(value), Encoding::Bytewise) => Some(f32::from_bits(value.cast_unsigned())),
            (Self::Whole(value), Encoding::CCast) => {
                #[expect(clippy::cast_possible_truncation, reason = "compared below")]
                let field = f64::from(value) as f32;
                (f64::from(field).to_bits() == f64::from(value).to_bits()).then_some(field)
            }
        }
    }

    /// True if this is `other` taken for the bits of a float, or the other way round: somebody
    /// wrote it with the wrong encoding.
    #[must_use]
    pub fn is_reinterpreted(self, other: Self) -> bool {
        let bits = |value| match value {
            #[expect(clippy::cast_precision_loss, reason = "as the other tool did")]
            Self::Whole(value) => (value, (value as f32).to_bits().cast_signed()),
            #[expect(clippy::cast_possible_truncation, reason = "as the other tool did")]
            Self::Real(value) => (value as i32, value.to_bits().cast_signed()),
        };
        let ((own, own_bits), (others, others_bits)) = (bits(self), bits(other));
        own != others && (own == others_bits || own_bits == others)
    }
}

/// A number so small that it would round to 0 is not whole: it is a whole number's bits.
fn is_whole(number: f64) -> bool {
    number.trunc().to_bits() == number.to_bits()
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole(value) => value.fmt(f),
            Self::Real(value) => value.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_encoding_carries_what_was_observed() {
        use Encoding::{Bytewise, CCast};
        // PX4: INT32 1 arrives as 1.4e-45. ArduPilot: as 1.0.
        let one = Value::Whole(1);
        assert_eq!(one.to_wire(Bytewise), Some(f32::from_bits(1)));
        assert_eq!(one.to_wire(CCast), Some(1.0));
        assert_eq!(Value::from_wire(f32::from_bits(1), Kind::Int32, Bytewise), Some(one));
        assert_eq!(Value::from_wire(1.0, Kind::Int8, CCast), Some(one));
        // A tool that sends 1.0 to PX4 stores 1065353216.
        let wrong = Value::from_wire(1.0, Kind::Int32, Bytewise).unwrap();
        assert_eq!(wrong, Value::Whole(1_065_353_216));
        assert!(wrong.is_reinterpreted(one) && !one.is_reinterpreted(one));
        assert!(!Value::Whole(2).is_reinterpreted(one));
        // −7 has bits that are a NaN as a float: it must survive.
        let nan = Value::Whole(-7).to_wire(Bytewise).unwrap();
        assert!(nan.is_nan());
        assert_eq!(Value::from_wire(nan, Kind::Int32, Bytewise), Some(Value::Whole(-7)));
    }

    #[test]
    fn what_does_not_fit_its_type_is_refused() {
        use Encoding::CCast;
        assert_eq!(Value::from_wire(200.0, Kind::Int8, CCast), None);
        assert_eq!(Value::from_wire(0.5, Kind::Int16, CCast), None);
        assert_eq!(Value::from_wire(f32::from_bits(10), Kind::Int16, CCast), None);
        assert_eq!(Value::from_wire(f32::NAN, Kind::Int32, CCast), None);
        assert_eq!(Value::from_wire(f32::INFINITY, Kind::Real32, CCast), None);
        // 2^24 + 1 has no float.
        assert_eq!(Value::Whole(16_777_217).to_wire(CCast), None);
        assert_eq!(Value::Whole(16_777_216).to_wire(CCast), Some(16_777_216.0));
        assert_eq!(Value::parse("4.000000", Kind::Int32), Some(Value::Whole(4)));
        assert_eq!(Value::parse("4.5", Kind::Int32), None);
        assert_eq!(Value::parse("128", Kind::Int8), None);
        assert_eq!(Value::parse("nan", Kind::Real32), None);
        assert_eq!(Value::parse("0.2", Kind::Real32), Some(Value::Real(0.2)));
    }
}
