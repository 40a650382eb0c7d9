//! Which pixel formats of a video device hold brightness, and where.

use crate::camera::images::PictureError;
use crate::camera::picture::GreyPicture;

/// Where the brightness of a pixel lies in a row of an uncompressed picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LumaLayout {
    /// One byte for each pixel; colours, if any, in planes behind.
    Plane,
    /// The first of two bytes (YUYV, YVYU).
    EvenBytes,
    /// The second of two bytes (UYVY, VYUY).
    OddBytes,
}

/// The codes that are understood, the best first: fewer bytes to move.
const KNOWN: [([u8; 4], LumaLayout); 9] = [
    (*b"GREY", LumaLayout::Plane),
    (*b"NV12", LumaLayout::Plane),
    (*b"NV21", LumaLayout::Plane),
    (*b"YU12", LumaLayout::Plane),
    (*b"YV12", LumaLayout::Plane),
    (*b"YUYV", LumaLayout::EvenBytes),
    (*b"YVYU", LumaLayout::EvenBytes),
    (*b"UYVY", LumaLayout::OddBytes),
    (*b"VYUY", LumaLayout::OddBytes),
];

/// The best of the offered codes, and where it has its brightness; `None` if all are compressed or
/// coloured in another way.
#[must_use]
pub fn choose_layout(offered: &[[u8; 4]]) -> Option<([u8; 4], LumaLayout)> {
    KNOWN.into_iter().find(|(code, _)| offered.contains(code))
}

/// The names of all codes that are understood.
pub(super) fn known_names() -> Vec<String> {
    KNOWN.iter().map(|(code, _)| name_of(*code)).collect()
}

/// A code as people write it.
pub(super) fn name_of(code: [u8; 4]) -> String {
    String::from_utf8_lossy(&code).into_owned()
}

impl LumaLayout {
    const fn bytes_per_pixel(self) -> usize {
        match self {
            Self::Plane => 1,
            Self::EvenBytes | Self::OddBytes => 2,
        }
    }

    /// The grey picture in a buffer whose rows begin `row_bytes` apart (0 means without gaps).
    ///
    /// # Errors
    /// [`PictureError::Size`] if the buffer is shorter than the picture.
    pub fn grey(
        self,
        [width_px, height_px]: [u32; 2],
        row_bytes: u32,
        buffer: &[u8],
    ) -> Result<GreyPicture, PictureError> {
        let short = || PictureError::Size { width_px, height_px, n_pixels: buffer.len() };
        let width = width_px as usize;
        let packed = width * self.bytes_per_pixel();
        let pitch = if row_bytes == 0 { packed } else { row_bytes as usize };
        if pitch < packed {
            return Err(short());
        }
        let mut pixels = Vec::with_capacity(width * height_px as usize);
        for row in 0..height_px as usize {
            let row = buffer.get(row * pitch..row * pitch + packed).ok_or_else(short)?;
            match self {
                Self::Plane => pixels.extend_from_slice(row),
                Self::EvenBytes => pixels.extend(row.iter().step_by(2)),
                Self::OddBytes => pixels.extend(row.iter().skip(1).step_by(2)),
            }
        }
        GreyPicture::new(width_px, height_px, pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grey_is_taken_before_colours_and_colours_before_nothing() {
        let best = |offered: &[&[u8; 4]]| {
            choose_layout(&offered.iter().map(|code| **code).collect::<Vec<_>>())
        };
        assert_eq!(best(&[b"MJPG", b"YUYV"]), Some((*b"YUYV", LumaLayout::EvenBytes)));
        assert_eq!(best(&[b"YUYV", b"GREY", b"NV12"]), Some((*b"GREY", LumaLayout::Plane)));
        assert_eq!(best(&[b"MJPG", b"H264", b"RGB3"]), None);
    }

    /// Two rows of two pixels with two bytes of padding, written by hand from the kernel's format
    /// pages: YUYV is Y0 U Y1 V, UYVY is U Y0 V Y1.
    #[test]
    fn brightness_is_found_between_colours_and_padding() {
        let yuyv = [10, 1, 20, 2, 0, 0, 30, 3, 40, 4, 0, 0];
        let uyvy = [1, 10, 2, 20, 0, 0, 3, 30, 4, 40, 0, 0];
        let planar = [10, 20, 0, 30, 40, 0, 128, 128];
        let grey = |layout: LumaLayout, row_bytes, buffer: &[u8]| {
            layout.grey([2, 2], row_bytes, buffer).map(|picture| picture.pixels().to_vec())
        };
        assert_eq!(grey(LumaLayout::EvenBytes, 6, &yuyv).unwrap(), [10, 20, 30, 40]);
        assert_eq!(grey(LumaLayout::OddBytes, 6, &uyvy).unwrap(), [10, 20, 30, 40]);
        assert_eq!(grey(LumaLayout::Plane, 3, &planar).unwrap(), [10, 20, 30, 40]);
        assert!(grey(LumaLayout::EvenBytes, 6, &yuyv[..9]).is_err(), "cut");
        assert!(grey(LumaLayout::EvenBytes, 3, &yuyv).is_err(), "rows that overlap");
    }
}
