//! The two typefaces that come along: Inter, regular and semi-bold (its licence lies beside it).

use super::{PT_PER_MM, PdfError};
use harfrust::{Direction, Feature, FontRef, ShapeOptions, ShaperData, Tag, UnicodeBuffer};
use krilla::text::{Font, GlyphId, KrillaGlyph};
use std::borrow::Cow;
use std::ops::Range;

const REGULAR: &[u8] = include_bytes!("font/Inter-Regular.otf");
const SEMI_BOLD: &[u8] = include_bytes!("font/Inter-SemiBold.otf");
/// What stands for a letter that the typefaces do not have.
const UNKNOWN: char = '□';

/// Which typeface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Face {
    /// For reading.
    Regular,
    /// For headings and results.
    SemiBold,
}

/// Both typefaces.
#[derive(Debug)]
pub struct Typefaces {
    regular: Typeface,
    semi_bold: Typeface,
}

struct Typeface {
    font: Font,
    shape: FontRef<'static>,
    shaper: ShaperData,
    units_per_em: f32,
}

impl std::fmt::Debug for Typeface {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Typeface").field("font", &self.font).finish_non_exhaustive()
    }
}

/// A text as glyphs, ready to be drawn.
#[derive(Debug)]
pub(super) struct Shaped<'a> {
    /// What is drawn: the text without letters that the typeface lacks.
    pub(super) text: Cow<'a, str>,
    /// Its glyphs; advances in em.
    pub(super) glyphs: Vec<KrillaGlyph>,
    /// Its width, em.
    pub(super) width_em: f32,
}

impl Typefaces {
    pub(super) fn load() -> Result<Self, PdfError> {
        Ok(Self {
            regular: Typeface::load("Inter-Regular", REGULAR)?,
            semi_bold: Typeface::load("Inter-SemiBold", SEMI_BOLD)?,
        })
    }

    /// How wide a text will be, mm.
    #[must_use]
    pub fn width_mm(&self, text: &str, face: Face, size_pt: f64) -> f64 {
        f64::from(self.shaped(text, face).width_em) * size_pt / PT_PER_MM
    }

    /// The text in lines that are at most this wide; a word that is wider stands alone.
    #[must_use]
    pub fn lines(&self, text: &str, face: Face, size_pt: f64, width_mm: f64) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        // Only at plain spaces: the others are there to keep a number beside its unit.
        for word in text.split(' ').filter(|word| !word.is_empty()) {
            let longer = lines.last().map(|line| format!("{line} {word}"));
            match longer.filter(|line| self.width_mm(line, face, size_pt) <= width_mm) {
                Some(longer) => {
                    lines.pop();
                    lines.push(longer);
                }
                None => lines.push(word.to_owned()),
            }
        }
        lines
    }

    pub(super) fn font(&self, face: Face) -> Font {
        self.of(face).font.clone()
    }

    pub(super) fn shaped<'a>(&self, text: &'a str, face: Face) -> Shaped<'a> {
        self.of(face).shaped(text)
    }

    const fn of(&self, face: Face) -> &Typeface {
        match face {
            Face::Regular => &self.regular,
            Face::SemiBold => &self.semi_bold,
        }
    }
}

impl Typeface {
    fn load(name: &'static str, bytes: &'static [u8]) -> Result<Self, PdfError> {
        let font = Font::new(bytes.into(), 0).ok_or(PdfError::Font(name))?;
        let shape = FontRef::from_index(bytes, 0).map_err(|_| PdfError::Font(name))?;
        let shaper = ShaperData::new(&shape);
        let units_per_em = font.units_per_em();
        Ok(Self { font, shape, shaper, units_per_em })
    }

    fn shaped<'a>(&self, text: &'a str) -> Shaped<'a> {
        let shaped = self.shaped_as_is(Cow::Borrowed(text));
        // A glyph may stand for several letters, a base and its marks: without it none of them can be drawn.
        let missing: Vec<Range<usize>> = shaped
            .glyphs
            .iter()
            .filter(|glyph| glyph.glyph_id == GlyphId::new(0))
            .map(|glyph| glyph.text_range.clone())
            .collect();
        if missing.is_empty() {
            return shaped;
        }
        let known = text.char_indices().map(|(at, letter)| {
            if missing.iter().any(|range| range.contains(&at)) { UNKNOWN } else { letter }
        });
        self.shaped_as_is(Cow::Owned(known.collect()))
    }

    #[expect(clippy::cast_precision_loss, reason = "a glyph is a few thousand units wide")]
    fn shaped_as_is<'a>(&self, text: Cow<'a, str>) -> Shaped<'a> {
        let mut buffer = UnicodeBuffer::new();
        buffer.push_str(&text);
        buffer.set_direction(Direction::LeftToRight);
        buffer.guess_segment_properties();
        buffer.set_direction(Direction::LeftToRight);
        let shaper = self.shaper.shaper(&self.shape).build();
        // Figures of one width: columns of numbers stand under each other.
        let features = [Feature::new(Tag::new(b"tnum"), 1, ..)];
        let output = shaper.shape(buffer, ShapeOptions::new().features(&features));
        let (infos, positions) = (output.glyph_infos(), output.glyph_positions());
        let em = |units: i32| units as f32 / self.units_per_em;
        let glyphs: Vec<KrillaGlyph> = std::iter::zip(infos, positions)
            .enumerate()
            .map(|(index, (info, position))| {
                let from = info.cluster as usize;
                let later = infos[index..].iter().map(|next| next.cluster as usize);
                let to = later.filter(|next| *next > from).min().unwrap_or(text.len());
                KrillaGlyph {
                    glyph_id: GlyphId::new(info.glyph_id),
                    text_range: from..to,
                    x_advance: em(position.x_advance),
                    x_offset: em(position.x_offset),
                    y_offset: em(position.y_offset),
                    y_advance: 0.0,
                    location: None,
                }
            })
            .collect();
        let width_em = glyphs.iter().map(|glyph| glyph.x_advance).sum();
        Shaped { text, glyphs, width_em }
    }
}
