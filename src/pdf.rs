//! PDF pages drawn in millimetres: texts, lines, areas and pictures.
//!
//! A page is drawn top down from its upper left corner, in true size, so a ruler laid on the print
//! reads what the code says. Documents keep to PDF/A-2b, the archival subset: fonts and colours are
//! inside the file, and equal calls give equal bytes. Nothing is laid out here: the caller says
//! where everything stands and asks [`Typefaces::width_mm`] how wide a text will be.
//!
//! ```
//! use stockpilot::pdf::{About, Document, Hold, Ink, Size, Style};
//!
//! let mut document = Document::new(&About { title: "A sheet".to_owned(), ..About::default() })?;
//! document.page(Size::A4, |page| {
//!     let style = Style::regular(10.0, Ink::BLACK);
//!     page.text("200 mm", [105.0, 20.0], style, Hold::Middle);
//!     page.line([5.0, 25.0], [205.0, 25.0], 0.2, Ink::BLACK);
//!     Ok(())
//! })?;
//! assert!(document.finish()?.starts_with(b"%PDF-"));
//! # Ok::<(), stockpilot::pdf::PdfError>(())
//! ```

mod page;
mod picture;
mod typeface;

pub use page::{Hold, Ink, Page, Style};
pub use typeface::{Face, Typefaces};

use jiff::Timestamp;
use krilla::SerializeSettings;
use krilla::configure::{Archival, ConfigurationBuilder};
use krilla::metadata::{DateTime, Metadata};
use krilla::page::PageSettings;

/// Points in a millimetre.
const PT_PER_MM: f64 = 72.0 / 25.4;

/// Why there is no document.
#[derive(Debug, thiserror::Error)]
pub enum PdfError {
    /// The fonts that come along cannot be read.
    #[error("the font {0} that comes along cannot be read")]
    Font(&'static str),
    /// A page has no size.
    #[error("a page of {width_mm} mm × {height_mm} mm cannot be made")]
    PageSize {
        /// Its width, mm.
        width_mm: f64,
        /// Its height, mm.
        height_mm: f64,
    },
    /// A picture is no SVG.
    #[error("a picture cannot be read: {0}")]
    Picture(String),
    /// The document cannot be put together.
    #[error("the document cannot be written: {0}")]
    Write(String),
}

/// What a document says about itself.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct About {
    /// Its title.
    pub title: String,
    /// What it is about.
    pub subject: String,
    /// What its content is of, such as the time of a flight. Not the time of writing: equal content
    /// gives equal files. Where it is not known, the file says the beginning of 1970.
    pub of: Option<Timestamp>,
}

/// Width and height of a page, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Size {
    /// Width, mm.
    pub width_mm: f64,
    /// Height, mm.
    pub height_mm: f64,
}

impl Size {
    /// A4, upright.
    pub const A4: Self = Self { width_mm: 210.0, height_mm: 297.0 };
    /// A3, upright.
    pub const A3: Self = Self { width_mm: 297.0, height_mm: 420.0 };
}

/// A document that grows page by page.
pub struct Document {
    inner: krilla::Document,
    typefaces: Typefaces,
}

impl std::fmt::Debug for Document {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Document").finish_non_exhaustive()
    }
}

impl Document {
    /// A document without a page.
    ///
    /// # Errors
    /// [`PdfError::Font`] or [`PdfError::Write`], both only by a defect of the build.
    pub fn new(about: &About) -> Result<Self, PdfError> {
        let configuration = ConfigurationBuilder::new()
            .with_archival_validator(Archival::A2_B)
            .finish()
            .map_err(|error| PdfError::Write(format!("{error:?}")))?;
        let settings = SerializeSettings { configuration, ..SerializeSettings::default() };
        let mut inner = krilla::Document::new_with(settings);
        let producer = concat!("stockpilot ", env!("CARGO_PKG_VERSION"));
        // The archival form demands a date.
        let of = about.of.unwrap_or(Timestamp::UNIX_EPOCH);
        let metadata = Metadata::new()
            .title(about.title.clone())
            .description(about.subject.clone())
            .language("en".to_owned())
            .creator(producer.to_owned())
            .producer(producer.to_owned())
            .creation_date(date_of(of));
        inner.set_metadata(metadata);
        Ok(Self { inner, typefaces: Typefaces::load()? })
    }

    /// The typefaces, to measure texts before they are drawn.
    #[must_use]
    pub const fn typefaces(&self) -> &Typefaces {
        &self.typefaces
    }

    /// Adds a page.
    ///
    /// # Errors
    /// A size that is none, and what `draw` gives.
    pub fn page<E: From<PdfError>>(
        &mut self,
        size: Size,
        draw: impl FnOnce(&mut Page<'_, '_>) -> Result<(), E>,
    ) -> Result<(), E> {
        let Size { width_mm, height_mm } = size;
        let settings = PageSettings::from_wh(points(width_mm), points(height_mm))
            .ok_or(PdfError::PageSize { width_mm, height_mm })?;
        let mut page = self.inner.start_page_with(settings);
        let mut surface = page.surface();
        let drawn = draw(&mut Page::new(&mut surface, &self.typefaces, size));
        surface.finish();
        page.finish();
        drawn
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// What contradicts PDF/A-2b.
    pub fn finish(self) -> Result<Vec<u8>, PdfError> {
        self.inner.finish().map_err(|error| PdfError::Write(error.to_string()))
    }
}

/// Millimetres as the file counts them.
#[expect(clippy::cast_possible_truncation, reason = "a page is small, its file single precision")]
fn points(mm: f64) -> f32 {
    (mm * PT_PER_MM) as f32
}

fn date_of(of: Timestamp) -> DateTime {
    let civil = of.to_zoned(jiff::tz::TimeZone::UTC);
    let small = |value: i8| u8::try_from(value).unwrap_or(0);
    DateTime::new(u16::try_from(civil.year()).unwrap_or(0))
        .month(small(civil.month()))
        .day(small(civil.day()))
        .hour(small(civil.hour()))
        .minute(small(civil.minute()))
        .second(small(civil.second()))
        .utc_offset_hour(0)
        .utc_offset_minute(0)
}

#[cfg(test)]
mod tests;
