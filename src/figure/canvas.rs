//! The sheet of paper: areas, texts, and errors of the drawing library.

use super::FigureError;
use plotters::coord::Shift;
use plotters::prelude::{DrawingArea, IntoDrawingArea, SVGBackend, Text, WHITE};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontTransform, IntoFont, RGBColor, TextStyle};

/// A part of the picture; places in it are in units of the picture from its upper left corner.
pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Every text but the title.
pub(super) const TEXT: u32 = 15;
const TITLE: u32 = 19;
const FAMILY: &str = "sans-serif";
const TEXT_INK: RGBColor = RGBColor(40, 40, 40);

/// Draws on a white sheet of this size.
pub(super) fn on_paper(
    size: (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Result<(), FigureError>,
) -> Result<String, FigureError> {
    let mut picture = String::new();
    {
        let root = SVGBackend::with_string(&mut picture, size).into_drawing_area();
        drawn(root.fill(&WHITE))?;
        draw(&root)?;
        drawn(root.present())?;
    }
    Ok(picture)
}

/// The library's errors, told as ours.
pub(super) fn drawn<T, E: std::fmt::Display>(result: Result<T, E>) -> Result<T, FigureError> {
    result.map_err(|error| FigureError::Draw(error.to_string()))
}

/// The part of an area from a corner, width × height.
pub(super) fn part<'a>(area: &Area<'a>, corner: (i32, i32), size: (i32, i32)) -> Area<'a> {
    area.clone().shrink(corner, size)
}

/// The style of all texts.
pub(super) fn text_style(size: u32) -> TextStyle<'static> {
    TextStyle::from((FAMILY, f64::from(size)).into_font()).color(&TEXT_INK)
}

/// Where a text stands in relation to its place.
#[derive(Debug, Clone, Copy)]
pub(super) enum Hold {
    /// Its left end, at half its height.
    Left,
    /// Its middle.
    Middle,
    /// Its middle, the text running upwards.
    Upwards,
}

/// Writes a text.
pub(super) fn write(
    area: &Area<'_>,
    text: &str,
    at: (i32, i32),
    size: u32,
    hold: Hold,
) -> Result<(), FigureError> {
    let style = text_style(size);
    let style = match hold {
        Hold::Left => style.pos(Pos::new(HPos::Left, VPos::Center)),
        Hold::Middle => style.pos(Pos::new(HPos::Center, VPos::Center)),
        Hold::Upwards => {
            style.transform(FontTransform::Rotate270).pos(Pos::new(HPos::Center, VPos::Center))
        }
    };
    drawn(area.draw(&Text::new(text.to_owned(), at, style)))
}

/// Writes the title in the middle of the top, smaller if it would not fit.
pub(super) fn write_title(
    root: &Area<'_>,
    title: &str,
    width: i32,
    height: i32,
) -> Result<(), FigureError> {
    let mut size = TITLE;
    while size > TEXT - 4 && text_width(title, size) > width {
        size -= 1;
    }
    write(root, title, (width / 2, height / 2), size, Hold::Middle)
}

/// About how wide a text is; the viewer's font decides in the end.
#[expect(clippy::cast_possible_truncation, reason = "texts are short")]
#[expect(clippy::cast_precision_loss, reason = "texts are short")]
pub(super) fn text_width(text: &str, size: u32) -> i32 {
    // The library's sizes are 1.24 of the em; letters of the widest usual fonts are 0.6 em.
    (text.chars().count() as f64 * f64::from(size) / 1.24 * 0.6).ceil() as i32
}
