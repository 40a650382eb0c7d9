//! Curves over a common axis, with bands and a legend.

use super::canvas::{Area, Hold, TEXT, drawn, on_paper, part, text_style, write, write_title};
use super::legend::{self, Entry, Sample};
use super::overlay::Ink;
use super::ticks::Scale;
use super::{Figure, FigureError, Table};
use plotters::prelude::{
    Cartesian2d, ChartBuilder, ChartContext, Circle, PathElement, Polygon, SVGBackend,
};
use plotters::style::{Color, RGBColor, ShapeStyle, TRANSPARENT};
use std::ops::Range;

/// One axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Axis {
    /// What it counts, with the unit.
    pub label: String,
    /// Its ends; those of the data if `None`. Curves are cut off there.
    pub range: Option<[f64; 2]>,
    /// Equal distances are equal ratios; values that are not above 0 are left out.
    pub is_log: bool,
}

impl Axis {
    /// A linear axis that shows all of the data.
    #[must_use]
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), range: None, is_log: false }
    }

    /// A logarithmic axis that shows all of the data.
    #[must_use]
    pub fn log(label: impl Into<String>) -> Self {
        Self { label: label.into(), range: None, is_log: true }
    }
}

/// How a curve is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Stroke {
    /// A full line.
    #[default]
    Full,
    /// Dashes, for references and comparisons.
    Dashed,
    /// A dot at each point and no line.
    Dots,
}

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// What the legend says.
    pub label: String,
    /// Its colour.
    pub ink: Ink,
    /// How it is drawn.
    pub stroke: Stroke,
    /// Its points in the order of drawing; the curve is interrupted where one is not finite.
    pub points: Vec<[f64; 2]>,
}

/// The area between two curves.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// What the legend says.
    pub label: String,
    /// Its colour, drawn thin.
    pub ink: Ink,
    /// x, lower and upper border.
    pub borders: Vec<[f64; 3]>,
}

/// Curves over a common axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LineChart {
    /// What the picture shows.
    pub title: String,
    /// The axis to the right.
    pub x: Axis,
    /// The axis upwards.
    pub y: Axis,
    /// Bands, drawn below the curves.
    pub bands: Vec<Band>,
    /// The curves.
    pub series: Vec<Series>,
}

const SIZE: (i32, i32) = (560, 360);
const TOP: i32 = 42;
const LEFT: i32 = 82;
const BELOW: i32 = 52;
const RIGHT: i32 = 28;
const N_TICKS: usize = 8;
const DASH: (i32, i32) = (7, 5);
const BAND_OPACITY: f64 = 0.18;
const FRAME: RGBColor = RGBColor(60, 60, 60);
const GRID: RGBColor = RGBColor(228, 228, 228);

type Chart<'a, 'p> = ChartContext<'a, SVGBackend<'p>, Cartesian2d<Scale, Scale>>;

impl LineChart {
    /// Every point that must be seen, and that each axis can show.
    fn points(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        let of_bands =
            self.bands.iter().flat_map(|b| &b.borders).flat_map(|b| [[b[0], b[1]], [b[0], b[2]]]);
        let of_series = self.series.iter().flat_map(|s| s.points.iter().copied());
        of_bands.chain(of_series).filter(|p| self.can_show(p))
    }

    fn can_show(&self, point: &[f64; 2]) -> bool {
        std::iter::zip([&self.x, &self.y], point)
            .all(|(axis, v)| v.is_finite() && (!axis.is_log || *v > 0.0))
    }

    /// What an axis shows: its own range, or that of the data with some air.
    fn range(&self, axis: &Axis, k: usize) -> Range<f64> {
        if let Some([low, high]) = axis.range {
            return low..high;
        }
        let (low, high) = self
            .points()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p[k]), h.max(p[k])));
        if low > high {
            return if axis.is_log { 0.1..1.0 } else { 0.0..1.0 };
        }
        if axis.is_log {
            let air = (high / low).powf(0.04).max(1.05);
            return low / air..high * air;
        }
        let span = if high > low { high - low } else { low.abs().max(1.0) };
        // Time and counts begin where they begin.
        let air = if k == 0 { 0.0 } else { 0.05 * span };
        low - air..(if k == 0 { low + span } else { high + air })
    }

    fn check(&self) -> Result<(), FigureError> {
        let bad = |reason: &str| {
            Err(FigureError::BadData { title: self.title.clone(), reason: reason.to_owned() })
        };
        for axis in [&self.x, &self.y] {
            match axis.range {
                Some([low, high]) if !(low < high && (high - low).is_finite()) => {
                    return bad("an axis ends before it begins");
                }
                Some([low, _]) if axis.is_log && low <= 0.0 => {
                    return bad("a logarithmic axis begins at 0");
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn entries(&self) -> Vec<Entry> {
        let bands = self.bands.iter().map(|band| Entry {
            label: band.label.clone(),
            sample: Sample::Band(band.ink, BAND_OPACITY),
        });
        let curves = self.series.iter().map(|series| Entry {
            label: series.label.clone(),
            sample: match series.stroke {
                Stroke::Full => Sample::Curve(series.ink, None),
                Stroke::Dashed => Sample::Curve(series.ink, Some(DASH)),
                Stroke::Dots => Sample::Mark(super::Shape::Dots, series.ink),
            },
        });
        bands.chain(curves).filter(|entry| !entry.label.is_empty()).collect()
    }

    fn draw_chart(&self, area: &Area<'_>) -> Result<(), FigureError> {
        let scale = |axis: &Axis, k| Scale { range: self.range(axis, k), is_log: axis.is_log };
        let (x, y) = (scale(&self.x, 0), scale(&self.y, 1));
        let mut chart = drawn(
            ChartBuilder::on(area)
                .x_label_area_size(BELOW)
                .y_label_area_size(LEFT)
                .build_cartesian_2d(x.clone(), y.clone()),
        )?;
        drawn(
            chart
                .configure_mesh()
                .light_line_style(TRANSPARENT)
                .bold_line_style(GRID)
                .axis_style(FRAME)
                .x_labels(N_TICKS)
                .y_labels(N_TICKS)
                .x_label_formatter(&x.texts())
                .y_label_formatter(&y.texts())
                .label_style(text_style(TEXT))
                .draw(),
        )?;
        self.draw_data(&chart, [&x.range, &y.range])
    }

    fn draw_data(
        &self,
        chart: &Chart<'_, '_>,
        ranges: [&Range<f64>; 2],
    ) -> Result<(), FigureError> {
        let area = chart.plotting_area();
        let cut = |k: usize, v: f64| v.clamp(ranges[k].start, ranges[k].end);
        for band in &self.bands {
            let shown = || band.borders.iter().filter(|b| b.iter().all(|v| v.is_finite()));
            let above = shown().map(|b| (cut(0, b[0]), cut(1, b[2])));
            let below = shown().rev().map(|b| (cut(0, b[0]), cut(1, b[1])));
            let outline: Vec<(f64, f64)> = above.chain(below).collect();
            let style = band.ink.rgb().mix(BAND_OPACITY).filled();
            drawn(area.draw(&Polygon::new(outline, style)))?;
        }
        for series in &self.series {
            let style = ShapeStyle::from(series.ink.rgb()).stroke_width(2);
            if series.stroke == Stroke::Dots {
                for p in series.points.iter().filter(|p| self.can_show(p)) {
                    let at = (cut(0, p[0]), cut(1, p[1]));
                    drawn(area.draw(&Circle::new(at, 3, series.ink.rgb().filled())))?;
                }
                continue;
            }
            for piece in series.points.split(|p| !self.can_show(p)) {
                let line: Vec<(f64, f64)> =
                    piece.iter().map(|p| (cut(0, p[0]), cut(1, p[1]))).collect();
                if series.stroke == Stroke::Dashed {
                    let (dash, gap) = DASH;
                    let dashes = plotters::element::DashedPathElement::new(line, dash, gap, style);
                    drawn(area.draw(&dashes))?;
                } else {
                    drawn(area.draw(&PathElement::new(line, style)))?;
                }
            }
        }
        Ok(())
    }
}

impl Figure for LineChart {
    fn svg(&self) -> Result<String, FigureError> {
        self.check()?;
        let (width, height) = SIZE;
        let total = LEFT + width + RIGHT;
        let entries = self.entries();
        let legend_width = total - LEFT;
        let legend_height = legend::height(&entries, legend_width);
        let below = TOP + height + BELOW;
        let size = (total.unsigned_abs(), (below + legend_height).unsigned_abs());
        on_paper(size, |root| {
            write_title(root, &self.title, total, TOP)?;
            self.draw_chart(&part(root, (0, TOP), (LEFT + width, height + BELOW)))?;
            write(root, &self.x.label, (LEFT + width / 2, below - 14), TEXT, Hold::Middle)?;
            write(root, &self.y.label, (14, TOP + height / 2), TEXT, Hold::Upwards)?;
            if legend_height > 0 {
                let area = part(root, (LEFT, below), (legend_width, legend_height));
                legend::draw(&area, &entries, legend_width)?;
            }
            Ok(())
        })
    }

    fn tables(&self) -> Vec<Table> {
        let bands = self.bands.iter().flat_map(|band| {
            [(1, "low"), (2, "high")].into_iter().flat_map(move |(k, side)| {
                let name = format!("{}: {side}", band.label);
                band.borders.iter().map(move |b| (name.clone(), vec![b[0], b[k]]))
            })
        });
        let curves = self.series.iter().flat_map(|series| {
            series.points.iter().map(move |p| (series.label.clone(), p.to_vec()))
        });
        vec![Table {
            kind: String::new(),
            columns: vec!["series".to_owned(), self.x.label.clone(), self.y.label.clone()],
            rows: bands.chain(curves).collect(),
        }]
    }
}
