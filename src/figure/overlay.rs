//! What lies over a map: paths, places, outlines.

use super::FigureError;
use super::canvas::{Area, drawn};
use plotters::prelude::{Circle, Cross, PathElement, RGBColor, TriangleMarker};
use plotters::style::{Color, ShapeStyle};

/// A colour with a meaning left to the caller; they differ for colour-blind eyes too.
///
/// Source of the hues: Okabe and Ito (2008), *Color Universal Design*.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// Texts and frames.
    Black,
    /// Seen on dark ground.
    White,
    /// A neutral reference.
    Grey,
    /// Vermilion.
    Red,
    /// Deep blue.
    Blue,
    /// Bluish green.
    Green,
    /// Orange.
    Orange,
    /// Reddish purple.
    Purple,
    /// Sky blue.
    Sky,
}

impl Ink {
    /// Inks for curves, in the order of use.
    pub const CURVES: [Self; 6] =
        [Self::Blue, Self::Red, Self::Green, Self::Purple, Self::Orange, Self::Sky];

    pub(super) const fn rgb(self) -> RGBColor {
        match self {
            Self::Black => RGBColor(0, 0, 0),
            Self::White => RGBColor(255, 255, 255),
            Self::Grey => RGBColor(120, 120, 120),
            Self::Red => RGBColor(213, 94, 0),
            Self::Blue => RGBColor(0, 114, 178),
            Self::Green => RGBColor(0, 158, 115),
            Self::Orange => RGBColor(230, 159, 0),
            Self::Purple => RGBColor(204, 121, 167),
            Self::Sky => RGBColor(86, 180, 233),
        }
    }
}

/// How the points of an overlay are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// A line from the first point to the last.
    Path,
    /// A closed line, for instance around an obstacle.
    Outline,
    /// Lines from each point of even number to the one after it, for instance a border in pieces.
    Segments,
    /// A disc at each point.
    Dots,
    /// A cross at each point.
    Crosses,
    /// A triangle at each point.
    Triangles,
}

impl Shape {
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Path => "path",
            Self::Outline => "outline",
            Self::Segments => "segments",
            Self::Dots => "dots",
            Self::Crosses => "crosses",
            Self::Triangles => "triangles",
        }
    }
}

/// One thing that lies over a map.
#[derive(Debug, Clone, PartialEq)]
pub struct Overlay {
    /// What the legend says; overlays that follow with the same label share its entry, and an
    /// empty one has none.
    pub label: String,
    /// How it is drawn.
    pub shape: Shape,
    /// Its colour.
    pub ink: Ink,
    /// Its points in the hall: x, y, m.
    pub points_m: Vec<[f64; 2]>,
}

/// Half the size of a mark, units of the picture.
const MARK: i32 = 4;

impl Overlay {
    /// An overlay from all of its parts.
    #[must_use]
    pub fn new(label: impl Into<String>, shape: Shape, ink: Ink, points_m: Vec<[f64; 2]>) -> Self {
        Self { label: label.into(), shape, ink, points_m }
    }

    /// Draws it in units of the picture; `to_picture` takes hall to picture.
    pub(super) fn draw(
        &self,
        area: &Area<'_>,
        to_picture: impl Fn(&[f64; 2]) -> (i32, i32),
    ) -> Result<(), FigureError> {
        let mut points: Vec<(i32, i32)> = self.points_m.iter().map(to_picture).collect();
        if self.shape == Shape::Outline {
            points.extend(points.first().copied());
        }
        draw_marks(area, self.shape, self.ink, &points)
    }
}

/// The shape through these points, with a rim that keeps it visible on every ground.
pub(super) fn draw_marks(
    area: &Area<'_>,
    shape: Shape,
    ink: Ink,
    points: &[(i32, i32)],
) -> Result<(), FigureError> {
    let rim = if ink == Ink::White { Ink::Black } else { Ink::White };
    let line = |ink: Ink, width| ShapeStyle::from(ink.rgb()).stroke_width(width);
    match shape {
        Shape::Path | Shape::Outline => {
            drawn(area.draw(&PathElement::new(points.to_vec(), line(rim, 4))))?;
            drawn(area.draw(&PathElement::new(points.to_vec(), line(ink, 2))))
        }
        Shape::Segments => [(rim, 4), (ink, 2)].into_iter().try_for_each(|(ink, width)| {
            points.chunks_exact(2).try_for_each(|ends| {
                drawn(area.draw(&PathElement::new(ends.to_vec(), line(ink, width))))
            })
        }),
        Shape::Dots => points.iter().try_for_each(|&at| {
            drawn(area.draw(&Circle::new(at, MARK + 1, rim.rgb().filled())))?;
            drawn(area.draw(&Circle::new(at, MARK, ink.rgb().filled())))
        }),
        Shape::Crosses => points.iter().try_for_each(|&at| {
            drawn(area.draw(&Cross::new(at, MARK + 1, line(rim, 4))))?;
            drawn(area.draw(&Cross::new(at, MARK, line(ink, 2))))
        }),
        Shape::Triangles => points.iter().try_for_each(|&at| {
            drawn(area.draw(&TriangleMarker::new(at, MARK + 3, rim.rgb().filled())))?;
            drawn(area.draw(&TriangleMarker::new(at, MARK + 1, ink.rgb().filled())))
        }),
    }
}
