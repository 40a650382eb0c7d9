//! Hits as point clouds.

use super::{ExportError, crs};
use crate::mapping::KeptHit;
use crate::time::{Mono, Stamp};
use las::point::Format;
use las::{Builder, Color, GpsTimeType, Point, Transform, Vector, Version, Vlr, Writer};
use std::io::Cursor;

/// Hits with what their times count from.
#[derive(Debug, Clone, Copy)]
pub struct Cloud<'a> {
    /// The hits.
    pub hits: &'a [KeptHit],
    /// Times in the files are seconds since this instant: the start of the log.
    pub began_at: Stamp<Mono>,
}

/// Steps of a coordinate in LAS, m.
const STEP_M: f64 = 0.0001;
/// Point format with 64-bit times and without colours.
const POINT_FORMAT: u8 = 6;
/// Bytes of the extra dimension: a single-precision number.
const EXTRA_BYTES: u16 = 4;

impl Cloud<'_> {
    fn seconds(&self, hit: &KeptHit) -> f64 {
        hit.at.seconds_since(self.began_at)
    }
}

/// LAZ 1.4, point format 6: places in steps of 0.1 mm, intensity in the sensor's scale, time in
/// seconds since the start of the log, and `height_sigma` (m, 1σ) as an extra dimension.
///
/// # Errors
/// A hit beyond 200 km, or a defect of the writer.
pub fn laz(cloud: Cloud<'_>) -> Result<Vec<u8>, ExportError> {
    let mut format = Format::new(POINT_FORMAT)?;
    format.is_compressed = true;
    format.extra_bytes = EXTRA_BYTES;
    let mut builder = Builder::from(Version::new(1, 4));
    builder.point_format = format;
    builder.generating_software = concat!("stockpilot ", env!("CARGO_PKG_VERSION")).to_owned();
    builder.system_identifier = "2D LiDAR".to_owned();
    // Equal flights give equal files: no date of writing.
    builder.date = None;
    builder.gps_time_type = GpsTimeType::Week;
    let axis = Transform { scale: STEP_M, offset: 0.0 };
    builder.transforms = Vector { x: axis, y: axis, z: axis };
    builder.vlrs.push(extra_dimension());
    let mut header = builder.into_header()?;
    let mut wkt = crs::WKT.as_bytes().to_vec();
    wkt.push(0);
    header.set_wkt_crs(wkt)?;
    let mut writer = Writer::new(Cursor::new(Vec::new()), header)?;
    for hit in cloud.hits {
        writer.write_point(point(cloud, hit))?;
    }
    Ok(writer.into_inner()?.into_inner())
}

#[expect(clippy::cast_possible_truncation, reason = "a σ needs no double precision")]
fn point(cloud: Cloud<'_>, hit: &KeptHit) -> Point {
    let [x, y, z] = hit.place_m;
    Point {
        x,
        y,
        z,
        intensity: u16::from(hit.intensity),
        return_number: 1,
        number_of_returns: 1,
        gps_time: Some(cloud.seconds(hit)),
        color: None::<Color>,
        extra_bytes: (hit.height_sigma_m as f32).to_le_bytes().to_vec(),
        ..Point::default()
    }
}

/// Says what the extra bytes are (LAS 1.4-R15, 4.2: "Extra Bytes").
fn extra_dimension() -> Vlr {
    let mut data = vec![0; 192];
    data[2] = 9; // a single-precision number
    let mut put =
        |at: usize, text: &str| data[at..at + text.len()].copy_from_slice(text.as_bytes());
    put(4, "height_sigma");
    put(160, "1 sigma of the height, m");
    Vlr {
        user_id: "LASF_Spec".to_owned(),
        record_id: 4,
        description: "extra dimensions".to_owned(),
        data,
    }
}

/// Binary PLY: x, y, z and time in double precision, the height's σ, intensity.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "a σ needs no double precision")]
pub fn ply(cloud: Cloud<'_>) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment stockpilot hits; metres in the hall's frame, z \
         up\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nproperty \
         double time_s\nproperty float height_sigma\nproperty uchar intensity\nend_header\n",
        cloud.hits.len()
    )
    .into_bytes();
    for hit in cloud.hits {
        for number in hit.place_m.into_iter().chain([cloud.seconds(hit)]) {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend((hit.height_sigma_m as f32).to_le_bytes());
        bytes.push(hit.intensity);
    }
    bytes
}
