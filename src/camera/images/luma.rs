//! Which pixel formats of a video device hold brightness, and where.

use crate::camera::images::PictureError;
use crate::camera::picture::GreyPicture;
use std::borrow::Cow;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Where the brightness of a pixel lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LumaLayout {
    /// One byte for each pixel; colours, if any, in planes behind.
    Plane,
    /// The first of two bytes (YUYV, YVYU).
    EvenBytes,
    /// The second of two bytes (UYVY, VYUY).
    OddBytes,
    /// A JPEG picture by itself, often without its Huffman tables (MJPEG).
    Jpeg,
}

/// The codes that are understood, the best first: fewer bytes to move, and nothing to decompress.
const KNOWN: [([u8; 4], LumaLayout); 11] = [
    (*b"GREY", LumaLayout::Plane),
    (*b"NV12", LumaLayout::Plane),
    (*b"NV21", LumaLayout::Plane),
    (*b"YU12", LumaLayout::Plane),
    (*b"YV12", LumaLayout::Plane),
    (*b"YUYV", LumaLayout::EvenBytes),
    (*b"YVYU", LumaLayout::EvenBytes),
    (*b"UYVY", LumaLayout::OddBytes),
    (*b"VYUY", LumaLayout::OddBytes),
    (*b"MJPG", LumaLayout::Jpeg),
    (*b"JPEG", LumaLayout::Jpeg),
];

/// A rate counts as reached from this share of it on: 29.97 is 30.
const RATE_REACHED: f64 = 0.95;

/// A pixel format that a device has at the size in question.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OfferedFormat {
    /// Its four characters.
    pub code: [u8; 4],
    /// The most pictures in a second; `None` if the driver does not tell.
    pub fastest_hz: Option<f64>,
}

/// The best of the offered formats, and where it has its brightness; `None` if none is understood.
///
/// The first in our order that reaches `frames_per_s`, so that USB 2, which carries ten uncompressed
/// pictures of a megapixel in a second, does not slow a camera that compresses; if none does, the fastest.
#[must_use]
pub fn choose_layout(
    offered: &[OfferedFormat],
    frames_per_s: u32,
) -> Option<([u8; 4], LumaLayout)> {
    let rate_hz = |format: &OfferedFormat| format.fastest_hz.unwrap_or(f64::INFINITY);
    let known: Vec<_> = KNOWN
        .into_iter()
        .filter_map(|(code, layout)| {
            let format = offered.iter().find(|format| format.code == code)?;
            Some((code, layout, rate_hz(format)))
        })
        .collect();
    let needed_hz = RATE_REACHED * f64::from(frames_per_s);
    let reaches = known.iter().find(|(.., hz)| *hz >= needed_hz);
    // `max_by` takes the last of equals, our order the first.
    let fastest = || known.iter().rev().max_by(|a, b| a.2.total_cmp(&b.2));
    reaches.or_else(fastest).map(|(code, layout, _)| (*code, *layout))
}

/// True if pictures of this format can be read.
pub(crate) fn is_known(code: [u8; 4]) -> bool {
    KNOWN.iter().any(|(known, _)| *known == code)
}

/// The names of all codes that are understood.
pub(crate) fn known_names() -> Vec<String> {
    KNOWN.iter().map(|(code, _)| name_of(*code)).collect()
}

/// A code as people write it.
pub(crate) fn name_of(code: [u8; 4]) -> String {
    String::from_utf8_lossy(&code).into_owned()
}

impl LumaLayout {
    /// The grey picture in a buffer whose rows begin `row_bytes` apart (0 means without gaps; a JPEG has
    /// none).
    ///
    /// # Errors
    /// [`PictureError::Size`] if the buffer is shorter than the picture; for a JPEG
    /// [`PictureError::Jpeg`] or [`PictureError::OtherSize`].
    pub fn grey(
        self,
        size_px: [u32; 2],
        row_bytes: u32,
        buffer: &[u8],
    ) -> Result<GreyPicture, PictureError> {
        match self {
            Self::Plane => uncompressed(size_px, row_bytes, buffer, (1, 0)),
            Self::EvenBytes => uncompressed(size_px, row_bytes, buffer, (2, 0)),
            Self::OddBytes => uncompressed(size_px, row_bytes, buffer, (2, 1)),
            Self::Jpeg => decompressed(size_px, buffer),
        }
    }
}

/// Every `step`-th byte of each row from `first` on.
fn uncompressed(
    [width_px, height_px]: [u32; 2],
    row_bytes: u32,
    buffer: &[u8],
    (step, first): (usize, usize),
) -> Result<GreyPicture, PictureError> {
    let short = || PictureError::Size { width_px, height_px, n_pixels: buffer.len() };
    let width = width_px as usize;
    let packed = width * step;
    let pitch = if row_bytes == 0 { packed } else { row_bytes as usize };
    if pitch < packed {
        return Err(short());
    }
    let mut pixels = Vec::with_capacity(width * height_px as usize);
    for row in 0..height_px as usize {
        let row = buffer.get(row * pitch..row * pitch + packed).ok_or_else(short)?;
        pixels.extend(row.iter().skip(first).step_by(step));
    }
    GreyPicture::new(width_px, height_px, pixels)
}

fn decompressed(size_px: [u32; 2], buffer: &[u8]) -> Result<GreyPicture, PictureError> {
    let refuse = |cause: String| PictureError::Jpeg { cause };
    // The decoder fills up what a cut picture lacks; half a picture has other tags than a whole one.
    if !buffer.windows(2).rev().any(|pair| pair == JPEG_END) {
        return Err(refuse("it has no end".to_owned()));
    }
    let [width_px, height_px] = size_px;
    let options = DecoderOptions::default()
        .set_max_width(width_px as usize)
        .set_max_height(height_px as usize)
        .jpeg_set_out_colorspace(ColorSpace::Luma);
    let whole = with_tables(buffer);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(whole.as_ref()), options);
    let pixels = decoder.decode().map_err(|error| refuse(format!("{error:?}")))?;
    let (width, height) = decoder.dimensions().unwrap_or_default();
    let got = [width, height].map(|side| u32::try_from(side).unwrap_or(u32::MAX));
    if got != size_px {
        return Err(PictureError::OtherSize { got, expected: size_px });
    }
    GreyPicture::new(width_px, height_px, pixels)
}

const JPEG_END: [u8; 2] = [0xff, 0xd9];
/// The segment of AVI files that says: the usual Huffman tables.
const USUAL_TABLES: [u8; 18] =
    [0xff, 0xe0, 0, 16, b'A', b'V', b'I', b'1', 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];

/// The JPEG, and where it brings no Huffman tables, as cameras send it, the word that they are the usual ones.
fn with_tables(jpeg: &[u8]) -> Cow<'_, [u8]> {
    const START: usize = 2;
    if jpeg.len() < START || has_tables(&jpeg[START..]) {
        return Cow::Borrowed(jpeg);
    }
    Cow::Owned([&jpeg[..START], &USUAL_TABLES, &jpeg[START..]].concat())
}

/// True if there is a table among the segments before the picture's own bytes.
fn has_tables(mut segments: &[u8]) -> bool {
    const TABLES: u8 = 0xc4;
    const SCAN: u8 = 0xda;
    while let [0xff, kind, high, low, ..] = *segments {
        match kind {
            TABLES => return true,
            SCAN => return false,
            _ => {}
        }
        let length = 2 + usize::from(u16::from_be_bytes([high, low]));
        segments = segments.get(length..).unwrap_or_default();
    }
    false
}

#[cfg(test)]
mod tests;
