//! The legend: below the picture, in as many lines as it needs.

use super::FigureError;
use super::canvas::{Area, Hold, TEXT, drawn, text_width, write};
use super::overlay::{Ink, Shape, draw_marks};
use plotters::prelude::{PathElement, Rectangle};
use plotters::style::{Color, ShapeStyle};

/// One entry.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entry {
    pub(super) label: String,
    pub(super) sample: Sample,
}

/// What stands before the label.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Sample {
    /// Of something over a map.
    Mark(Shape, Ink),
    /// Of a curve: the lengths of dash and gap, or a full line.
    Curve(Ink, Option<(i32, i32)>),
    /// Of a filled band, and how opaque it is.
    Band(Ink, f64),
}

const LINE_HEIGHT: i32 = 22;
const SAMPLE_WIDTH: i32 = 26;
const GAP: i32 = 18;

/// Entries in lines of this width.
fn lines(entries: &[Entry], width: i32) -> Vec<Vec<&Entry>> {
    let mut lines: Vec<Vec<&Entry>> = Vec::new();
    let mut used = width;
    for entry in entries {
        let needed = entry_width(entry);
        if lines.is_empty() || used + needed > width {
            lines.push(Vec::new());
            used = 0;
        }
        used += needed;
        if let Some(line) = lines.last_mut() {
            line.push(entry);
        }
    }
    lines
}

fn entry_width(entry: &Entry) -> i32 {
    SAMPLE_WIDTH + 6 + text_width(&entry.label, TEXT) + GAP
}

/// What the legend needs below the picture.
pub(super) fn height(entries: &[Entry], width: i32) -> i32 {
    let n_lines = i32::try_from(lines(entries, width).len()).unwrap_or(0);
    if n_lines == 0 { 0 } else { n_lines * LINE_HEIGHT + 8 }
}

/// Draws the legend into an area of its own.
pub(super) fn draw(area: &Area<'_>, entries: &[Entry], width: i32) -> Result<(), FigureError> {
    let mut y = LINE_HEIGHT / 2;
    for line in lines(entries, width) {
        let mut x = 0;
        for entry in line {
            draw_sample(area, entry.sample, x, y)?;
            write(area, &entry.label, (x + SAMPLE_WIDTH + 6, y), TEXT, Hold::Left)?;
            x += entry_width(entry);
        }
        y += LINE_HEIGHT;
    }
    Ok(())
}

fn draw_sample(area: &Area<'_>, sample: Sample, x: i32, y: i32) -> Result<(), FigureError> {
    let end = x + SAMPLE_WIDTH;
    match sample {
        Sample::Mark(shape @ (Shape::Path | Shape::Outline | Shape::Segments), ink) => {
            // The ground of the map is dark in places, that of the legend never.
            let ink = if ink == Ink::White { Ink::Grey } else { ink };
            draw_marks(area, shape, ink, &[(x, y), (end, y)])
        }
        Sample::Mark(shape, ink) => draw_marks(area, shape, ink, &[(x + SAMPLE_WIDTH / 2, y)]),
        Sample::Curve(ink, dash) => {
            let style = ShapeStyle::from(ink.rgb()).stroke_width(2);
            let (dash, gap) = dash.unwrap_or((SAMPLE_WIDTH, SAMPLE_WIDTH));
            let mut from = x;
            while from < end {
                let to = (from + dash).min(end);
                drawn(area.draw(&PathElement::new(vec![(from, y), (to, y)], style)))?;
                from += dash + gap;
            }
            Ok(())
        }
        Sample::Band(ink, opacity) => drawn(
            area.draw(&Rectangle::new([(x, y - 6), (end, y + 6)], ink.rgb().mix(opacity).filled())),
        ),
    }
}
