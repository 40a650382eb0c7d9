//! The surface as a GeoTIFF.
//!
//! Source: OGC 19-008r4 (GeoTIFF 1.1): tags 33550, 33922, 34735, 34737. The metadata and the value of
//! cells without one are GDAL's tags 42112 and 42113.

use super::{ExportError, Surface, crs};
use std::io::Cursor;
use tiff::encoder::compression::DeflateLevel;
use tiff::encoder::{Compression, TiffEncoder, colortype::Gray64Float};
use tiff::tags::{ExtraSamples, Tag};

/// What the bands are, for GDAL and its heirs.
const METADATA: &str = "<GDALMetadata>\
    <Item name=\"DESCRIPTION\" sample=\"0\" role=\"description\">height</Item>\
    <Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">m</Item>\
    <Item name=\"DESCRIPTION\" sample=\"1\" role=\"description\">sigma</Item>\
    <Item name=\"UNITTYPE\" sample=\"1\" role=\"unittype\">m</Item>\
    </GDALMetadata>";
const GDAL_METADATA: u16 = 42112;
/// Of user-defined values of keys.
const USER_DEFINED: u16 = 32767;
const METRE: u16 = 9001;

/// Height and σ of every cell, m, as two bands in double precision; cells that do not count are NaN.
///
/// # Errors
/// A grid without cells, or a defect of the writer.
pub fn geotiff(surface: Surface<'_>) -> Result<Vec<u8>, ExportError> {
    let grid = &surface.map.grid;
    let size = || ExportError::Size { n_cols: grid.n_cols, n_rows: grid.n_rows };
    let width = u32::try_from(grid.n_cols).ok().filter(|n| *n > 0).ok_or_else(size)?;
    let height = u32::try_from(grid.n_rows).ok().filter(|n| *n > 0).ok_or_else(size)?;
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes)?
        .with_compression(Compression::Deflate(DeflateLevel::Balanced));
    let mut image = encoder.new_image::<Gray64Float>(width, height)?;
    image.extra_samples(&[ExtraSamples::Unspecified])?;
    let (_, y_max_m) = grid.max_corner_m();
    let tags = image.encoder();
    tags.write_tag(Tag::ModelPixelScaleTag, &[grid.cell_m, grid.cell_m, 0.0][..])?;
    // The upper left outer corner of the picture lies there.
    tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, grid.x_min_m, y_max_m, 0.0][..])?;
    let citation = format!("{}|", crs::NAME);
    let n_citation = u16::try_from(citation.len()).unwrap_or(u16::MAX);
    #[rustfmt::skip]
    let keys = [
        1, 1, 1, 4,
        1024, 0, 1, USER_DEFINED,        // the model: neither projected nor geographic
        1025, 0, 1, 1,                   // a value stands for an area
        1026, 34737, n_citation, 0,      // its name
        3076, 0, 1, METRE,               // its unit
    ];
    tags.write_tag(Tag::GeoKeyDirectoryTag, &keys[..])?;
    tags.write_tag(Tag::GeoAsciiParamsTag, &*citation)?;
    tags.write_tag(Tag::Unknown(GDAL_METADATA), METADATA)?;
    tags.write_tag(Tag::GdalNodata, "nan")?;
    let of = |cell: usize| {
        let map = surface.map;
        if surface.counts(cell) { [map.mean_m[cell], map.sigma_m[cell]] } else { [f64::NAN; 2] }
    };
    let samples: Vec<f64> = surface.cells_from_above().flat_map(of).collect();
    image.write_data(&samples)?;
    Ok(bytes.into_inner())
}
