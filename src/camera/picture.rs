//! A grey picture, and how it comes from files and streams.

use super::images::PictureError;
use crate::time::{Mono, Stamp};
use std::io::{BufRead, Read};

/// Larger pictures are not believed, px along a side.
const MAX_SIDE_PX: u32 = 8192;
/// A header of a picture is shorter than this, bytes.
const MAX_HEADER_BYTES: usize = 4096;
/// The comment of a PGM header that carries the middle of the exposure, ns.
const STAMP_KEY: &str = "captured_at_ns";

/// Brightness by rows, from the upper left.
#[derive(Clone, PartialEq, Eq)]
pub struct GreyPicture {
    width_px: u32,
    height_px: u32,
    pixels: Vec<u8>,
}

impl std::fmt::Debug for GreyPicture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "GreyPicture({} × {})", self.width_px, self.height_px)
    }
}

impl GreyPicture {
    /// A picture of these pixels.
    ///
    /// # Errors
    /// [`PictureError::Size`] if there are not `width_px · height_px` of them, or absurdly many.
    pub fn new(width_px: u32, height_px: u32, pixels: Vec<u8>) -> Result<Self, PictureError> {
        let sides = 1..=MAX_SIDE_PX;
        let n_pixels = usize::try_from(u64::from(width_px) * u64::from(height_px)).ok();
        if !sides.contains(&width_px)
            || !sides.contains(&height_px)
            || n_pixels != Some(pixels.len())
        {
            return Err(PictureError::Size { width_px, height_px, n_pixels: pixels.len() });
        }
        Ok(Self { width_px, height_px, pixels })
    }

    /// Width, px.
    #[must_use]
    pub const fn width_px(&self) -> u32 {
        self.width_px
    }

    /// Height, px.
    #[must_use]
    pub const fn height_px(&self) -> u32 {
        self.height_px
    }

    /// The pixels by rows.
    #[must_use]
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// The picture as binary PGM, with its stamp if it has one.
    #[must_use]
    pub fn to_pgm(&self, captured_at: Option<Stamp<Mono>>) -> Vec<u8> {
        let stamp =
            captured_at.map_or_else(String::new, |at| format!("# {STAMP_KEY} {}\n", at.nanos()));
        let mut bytes =
            format!("P5\n{stamp}{} {}\n255\n", self.width_px, self.height_px).into_bytes();
        bytes.extend_from_slice(&self.pixels);
        bytes
    }
}

/// A picture and, where the header tells it, the middle of its exposure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StampedPicture {
    /// The picture.
    pub picture: GreyPicture,
    /// The middle of its exposure.
    pub captured_at: Option<Stamp<Mono>>,
}

/// Reads the next binary PGM (P5, 8 bits) of a stream, which may hold one after the other; `None`
/// at its end.
///
/// A header line `# captured_at_ns N` stamps the picture on the service's monotonic clock.
///
/// # Errors
/// What the source says, or what is wrong with the picture; the stream cannot be read on then.
pub fn read_pgm(source: &mut impl BufRead) -> Result<Option<StampedPicture>, PictureError> {
    let mut header = HeaderReader { source, n_bytes: 0, captured_at: None };
    let Some(magic) = header.word()? else { return Ok(None) };
    if magic != "P5" {
        return Err(PictureError::NotPgm { found: magic });
    }
    let (width_px, height_px) = (header.number()?, header.number()?);
    let brightest = header.number()?;
    let captured_at = header.captured_at;
    if brightest != 255 || width_px > MAX_SIDE_PX || height_px > MAX_SIDE_PX {
        return Err(PictureError::Unsupported { width_px, height_px, brightest });
    }
    let n_pixels = u64::from(width_px) * u64::from(height_px);
    let mut pixels = Vec::new();
    source.take(n_pixels).read_to_end(&mut pixels)?;
    Ok(Some(StampedPicture {
        picture: GreyPicture::new(width_px, height_px, pixels)?,
        captured_at,
    }))
}

/// Words of a PGM header; each ends with the one blank behind it.
struct HeaderReader<'a, R> {
    source: &'a mut R,
    n_bytes: usize,
    captured_at: Option<Stamp<Mono>>,
}

impl<R: BufRead> HeaderReader<'_, R> {
    fn byte(&mut self) -> Result<Option<u8>, PictureError> {
        self.n_bytes += 1;
        if self.n_bytes > MAX_HEADER_BYTES {
            return Err(PictureError::Header);
        }
        let Some(&byte) = self.source.fill_buf()?.first() else { return Ok(None) };
        self.source.consume(1);
        Ok(Some(byte))
    }

    fn word(&mut self) -> Result<Option<String>, PictureError> {
        let mut word = String::new();
        while let Some(byte) = self.byte()? {
            match byte {
                b'#' => self.comment()?,
                blank if blank.is_ascii_whitespace() && word.is_empty() => {}
                blank if blank.is_ascii_whitespace() => return Ok(Some(word)),
                other => word.push(char::from(other)),
            }
        }
        if word.is_empty() { Ok(None) } else { Err(PictureError::Header) }
    }

    fn comment(&mut self) -> Result<(), PictureError> {
        let mut line = String::new();
        while let Some(byte) = self.byte()?.filter(|byte| *byte != b'\n') {
            line.push(char::from(byte));
        }
        if let Some(("captured_at_ns", nanos)) = line.trim().split_once([' ', '=']) {
            let nanos = nanos.trim().parse().map_err(|_| PictureError::Header)?;
            self.captured_at = Some(Stamp::from_nanos(nanos));
        }
        Ok(())
    }

    fn number(&mut self) -> Result<u32, PictureError> {
        let word = self.word()?.ok_or(PictureError::Header)?;
        word.parse().map_err(|_| PictureError::Header)
    }
}

/// Reads a picture file: PNG, or PGM as [`read_pgm`] does.
///
/// Colours become grey by their luma, transparency is left out, 16 bits become 8.
///
/// # Errors
/// What the file or its decoder says.
pub fn read_picture(bytes: &[u8]) -> Result<StampedPicture, PictureError> {
    if !bytes.starts_with(b"\x89PNG") {
        return read_pgm(&mut &bytes[..])?.ok_or(PictureError::Header);
    }
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info()?;
    let size = reader.output_buffer_size().ok_or(PictureError::Header)?;
    let mut pixels = vec![0; size];
    let info = reader.next_frame(&mut pixels)?;
    pixels.truncate(info.buffer_size());
    let grey: Vec<u8> = match info.color_type {
        png::ColorType::Grayscale | png::ColorType::Indexed => pixels,
        png::ColorType::GrayscaleAlpha => pixels.chunks_exact(2).map(|p| p[0]).collect(),
        png::ColorType::Rgb => pixels.chunks_exact(3).map(luma).collect(),
        png::ColorType::Rgba => pixels.chunks_exact(4).map(luma).collect(),
    };
    let picture = GreyPicture::new(info.width, info.height, grey)?;
    Ok(StampedPicture { picture, captured_at: None })
}

/// Brightness of a colour by ITU-R BT.601, rounded.
fn luma(rgb: &[u8]) -> u8 {
    let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(u32::from);
    u8::try_from((299 * r + 587 * g + 114 * b + 500) / 1000).unwrap_or(u8::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_follow_each_other_in_a_stream() {
        let first = GreyPicture::new(3, 2, vec![10, 13, 32, 35, 80, 53]).unwrap();
        let second = GreyPicture::new(1, 1, vec![255]).unwrap();
        let at = Stamp::from_nanos(81_234_567_890);
        let stream = [first.to_pgm(Some(at)), second.to_pgm(None)].concat();
        for chunk in 1..stream.len() {
            let mut source = std::io::BufReader::with_capacity(chunk, &stream[..]);
            let read = read_pgm(&mut source).unwrap().unwrap();
            assert_eq!((read.picture, read.captured_at), (first.clone(), Some(at)));
            let read = read_pgm(&mut source).unwrap().unwrap();
            assert_eq!((read.picture, read.captured_at), (second.clone(), None));
            assert!(read_pgm(&mut source).unwrap().is_none());
        }
    }

    #[test]
    fn a_cut_or_foreign_picture_is_refused() {
        let whole = GreyPicture::new(3, 2, vec![1; 6]).unwrap().to_pgm(None);
        for n_bytes in 1..whole.len() {
            assert!(read_pgm(&mut &whole[..n_bytes]).is_err(), "{n_bytes}");
        }
        let refusal = |text: &str| read_pgm(&mut text.as_bytes()).unwrap_err().to_string();
        assert!(refusal("P6\n1 1\n255\nabc").contains("P6"));
        assert!(refusal("P5\n1 1\n65535\nab").contains("65535"));
        assert!(refusal("P5\n90000 1\n255\nab").contains("90000"));
        assert!(refusal(&" ".repeat(5000)).contains("header"));
    }

    /// Colours by hand: 0.299 · 200 + 0.587 · 100 + 0.114 · 50 = 124.2.
    #[test]
    fn a_coloured_png_becomes_its_luma() {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
        encoder.set_color(png::ColorType::Rgb);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&[200, 100, 50, 255, 255, 255]).unwrap();
        writer.finish().unwrap();
        assert_eq!(read_picture(&bytes).unwrap().picture.pixels(), [124, 255]);
    }
}
