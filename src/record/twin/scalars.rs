//! Instants, vectors and matrices in JSON.

use crate::geometry::{Direction, Frame, Point, Rotation, Transform};
use crate::time::Stamp;
use nalgebra::{Quaternion, SMatrix, Unit, Vector3};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;

/// Gives a `with` type the schema of a plain type.
macro_rules! schema_as {
    ($twin:ident, $plain:ty) => {
        impl JsonSchema for $twin {
            fn inline_schema() -> bool {
                true
            }
            fn schema_name() -> Cow<'static, str> {
                stringify!($twin).into()
            }
            fn json_schema(generator: &mut SchemaGenerator) -> Schema {
                <$plain>::json_schema(generator)
            }
        }
    };
}

/// An instant as nanoseconds since its clock's zero.
pub(super) struct Nanos;
schema_as!(Nanos, i64);

impl Nanos {
    pub(super) fn serialize<C, S: Serializer>(stamp: &Stamp<C>, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_i64(stamp.nanos())
    }
    pub(super) fn deserialize<'de, C, D: Deserializer<'de>>(from: D) -> Result<Stamp<C>, D::Error> {
        i64::deserialize(from).map(Stamp::from_nanos)
    }
}

/// What has three coordinates.
pub(super) trait Coords {
    fn coords(&self) -> Vector3<f64>;
    fn from_coords(coords: Vector3<f64>) -> Self;
}

impl Coords for Vector3<f64> {
    fn coords(&self) -> Vector3<f64> {
        *self
    }
    fn from_coords(coords: Vector3<f64>) -> Self {
        coords
    }
}

impl<F> Coords for Point<F> {
    fn coords(&self) -> Vector3<f64> {
        self.coords
    }
    fn from_coords(coords: Vector3<f64>) -> Self {
        Self::from_coords(coords)
    }
}

impl<F> Coords for Direction<F> {
    fn coords(&self) -> Vector3<f64> {
        self.coords
    }
    fn from_coords(coords: Vector3<f64>) -> Self {
        Self::from_coords(coords)
    }
}

/// A point or vector as `[x, y, z]`.
pub(super) struct Xyz;
schema_as!(Xyz, [f64; 3]);

impl Xyz {
    pub(super) fn serialize<T: Coords, S: Serializer>(v: &T, to: S) -> Result<S::Ok, S::Error> {
        let coords = v.coords();
        [coords.x, coords.y, coords.z].serialize(to)
    }
    pub(super) fn deserialize<'de, T: Coords, D: Deserializer<'de>>(
        from: D,
    ) -> Result<T, D::Error> {
        <[f64; 3]>::deserialize(from).map(|xyz| T::from_coords(xyz.into()))
    }
}

fn wxyz<To: Frame, From: Frame>(rotation: &Rotation<To, From>) -> [f64; 4] {
    let q = rotation.quaternion();
    [q.w, q.i, q.j, q.k]
}

/// A rotation, if there is one, as the quaternion `[w, x, y, z]` or null.
pub(super) struct OptionalWxyz;
schema_as!(OptionalWxyz, Option<[f64; 4]>);

impl OptionalWxyz {
    pub(super) fn serialize<To: Frame, From: Frame, S: Serializer>(
        rotation: &Option<Rotation<To, From>>,
        to: S,
    ) -> Result<S::Ok, S::Error> {
        rotation.as_ref().map(wxyz).serialize(to)
    }
    /// Takes the numbers as they are: a second normalisation would change the last bit.
    pub(super) fn deserialize<'de, To: Frame, From: Frame, D: Deserializer<'de>>(
        from: D,
    ) -> Result<Option<Rotation<To, From>>, D::Error> {
        let exact = |[w, x, y, z]: [f64; 4]| {
            Rotation::from_quaternion(Unit::new_unchecked(Quaternion::new(w, x, y, z)))
        };
        Ok(Option::<[f64; 4]>::deserialize(from)?.map(exact))
    }
}

/// A pose as origin and quaternion.
#[derive(Serialize, JsonSchema)]
pub(super) struct PoseTwin {
    origin_m: [f64; 3],
    rotation_wxyz: [f64; 4],
}

impl PoseTwin {
    pub(super) fn serialize<To: Frame, From: Frame, S: Serializer>(
        pose: &Transform<To, From>,
        to: S,
    ) -> Result<S::Ok, S::Error> {
        let twin =
            Self { origin_m: pose.origin.coords.into(), rotation_wxyz: wxyz(&pose.rotation) };
        Serialize::serialize(&twin, to)
    }
}

/// A matrix as one list, row by row.
pub(super) struct Rows;
schema_as!(Rows, Vec<f64>);

impl Rows {
    pub(super) fn serialize<const R: usize, const C: usize, S: Serializer>(
        matrix: &SMatrix<f64, R, C>,
        to: S,
    ) -> Result<S::Ok, S::Error> {
        to.collect_seq(matrix.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<_>>()))
    }
}
