//! What can be drawn on a page.

use super::typeface::{Face, Typefaces};
use super::{PT_PER_MM, PdfError, Size, picture, points};
use krilla::color::rgb;
use krilla::geom::{PathBuilder, Point, Rect, Transform};
use krilla::num::NormalizedF32;
use krilla::paint::{Fill, Stroke};
use krilla::surface::Surface;

/// A colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ink(pub u8, pub u8, pub u8);

impl Ink {
    /// Black.
    pub const BLACK: Self = Self(0, 0, 0);

    pub(super) fn paint(self) -> rgb::Color {
        rgb::Color::new(self.0, self.1, self.2)
    }
}

/// How a text looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Style {
    /// Its typeface.
    pub face: Face,
    /// Its size, points.
    pub size_pt: f64,
    /// Its colour.
    pub ink: Ink,
}

impl Style {
    /// A text for reading.
    #[must_use]
    pub const fn regular(size_pt: f64, ink: Ink) -> Self {
        Self { face: Face::Regular, size_pt, ink }
    }

    /// A heading or a result.
    #[must_use]
    pub const fn semi_bold(size_pt: f64, ink: Ink) -> Self {
        Self { face: Face::SemiBold, size_pt, ink }
    }
}

/// Which part of a text's line stands at its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hold {
    /// Its left end.
    Left,
    /// Its middle.
    Middle,
    /// Its right end.
    Right,
}

/// A page while it is drawn. Places are x to the right and y down from the upper left corner, mm; a
/// text stands with its base line at its place.
pub struct Page<'a, 's> {
    surface: &'a mut Surface<'s>,
    typefaces: &'a Typefaces,
    size: Size,
}

impl std::fmt::Debug for Page<'_, '_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Page").field("size", &self.size).finish_non_exhaustive()
    }
}

impl<'a, 's> Page<'a, 's> {
    pub(super) const fn new(
        surface: &'a mut Surface<'s>,
        typefaces: &'a Typefaces,
        size: Size,
    ) -> Self {
        Self { surface, typefaces, size }
    }

    /// The page's size.
    #[must_use]
    pub const fn size(&self) -> Size {
        self.size
    }

    /// The typefaces, to measure texts.
    #[must_use]
    pub const fn typefaces(&self) -> &Typefaces {
        self.typefaces
    }

    /// Writes one line; its width, mm.
    #[expect(clippy::cast_possible_truncation, reason = "sizes of letters are small")]
    pub fn text(&mut self, text: &str, at_mm: [f64; 2], style: Style, hold: Hold) -> f64 {
        let shaped = self.typefaces.shaped(text, style.face);
        let width_mm = f64::from(shaped.width_em) * style.size_pt / PT_PER_MM;
        let left_mm = match hold {
            Hold::Left => at_mm[0],
            Hold::Middle => at_mm[0] - 0.5 * width_mm,
            Hold::Right => at_mm[0] - width_mm,
        };
        self.fill(style.ink);
        self.surface.draw_glyphs(
            Point::from_xy(points(left_mm), points(at_mm[1])),
            &shaped.glyphs,
            self.typefaces.font(style.face),
            &shaped.text,
            style.size_pt as f32,
            false,
        );
        width_mm
    }

    /// Writes a text in lines of at most `width_mm`, `step_mm` apart; where the line after the last
    /// one would stand, mm.
    pub fn paragraph(
        &mut self,
        text: &str,
        at_mm: [f64; 2],
        style: Style,
        (width_mm, step_mm): (f64, f64),
    ) -> f64 {
        let lines = self.typefaces.lines(text, style.face, style.size_pt, width_mm);
        let mut y_mm = at_mm[1];
        for line in lines {
            self.text(&line, [at_mm[0], y_mm], style, Hold::Left);
            y_mm += step_mm;
        }
        y_mm
    }

    /// Draws a straight line.
    pub fn line(&mut self, from_mm: [f64; 2], to_mm: [f64; 2], width_mm: f64, ink: Ink) {
        let mut path = PathBuilder::new();
        path.move_to(points(from_mm[0]), points(from_mm[1]));
        path.line_to(points(to_mm[0]), points(to_mm[1]));
        let Some(path) = path.finish() else { return };
        self.surface.set_fill(None);
        self.surface.set_stroke(Some(Stroke {
            paint: ink.paint().into(),
            width: points(width_mm),
            ..Stroke::default()
        }));
        self.surface.draw_path(&path);
    }

    /// Fills a rectangle with its upper left corner at a place.
    pub fn area(&mut self, at_mm: [f64; 2], (width_mm, height_mm): (f64, f64), ink: Ink) {
        let corners = [points(at_mm[0]), points(at_mm[1]), points(width_mm), points(height_mm)];
        let Some(rect) = Rect::from_xywh(corners[0], corners[1], corners[2], corners[3]) else {
            return;
        };
        let mut path = PathBuilder::new();
        path.push_rect(rect);
        let Some(path) = path.finish() else { return };
        self.fill(ink);
        self.surface.draw_path(&path);
    }

    /// Fills a polygon.
    pub fn polygon(&mut self, corners_mm: &[[f64; 2]], ink: Ink) {
        let mut path = PathBuilder::new();
        for (index, [x_mm, y_mm]) in corners_mm.iter().enumerate() {
            let (x, y) = (points(*x_mm), points(*y_mm));
            if index == 0 { path.move_to(x, y) } else { path.line_to(x, y) }
        }
        path.close();
        let Some(path) = path.finish() else { return };
        self.fill(ink);
        self.surface.draw_path(&path);
    }

    /// Draws an SVG with its upper left corner at a place, as large as fits into a box; its width and
    /// height, mm.
    ///
    /// # Errors
    /// A picture that is no SVG.
    #[expect(clippy::cast_possible_truncation, reason = "pictures are small")]
    pub fn picture(
        &mut self,
        svg: &str,
        at_mm: [f64; 2],
        (width_mm, height_mm): (f64, f64),
    ) -> Result<(f64, f64), PdfError> {
        let tree = picture::tree(svg)?;
        let (width, height) = (f64::from(tree.size().width()), f64::from(tree.size().height()));
        let mm_per_unit = (width_mm / width).min(height_mm / height);
        let scale = (mm_per_unit * PT_PER_MM) as f32;
        let place = Transform::from_row(scale, 0.0, 0.0, scale, points(at_mm[0]), points(at_mm[1]));
        self.surface.push_transform(&place);
        picture::draw(self.surface, tree.root());
        self.surface.pop();
        Ok((width * mm_per_unit, height * mm_per_unit))
    }

    fn fill(&mut self, ink: Ink) {
        self.surface.set_stroke(None);
        self.surface.set_fill(Some(Fill {
            paint: ink.paint().into(),
            opacity: NormalizedF32::ONE,
            ..Fill::default()
        }));
    }
}
