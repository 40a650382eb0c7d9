//! A map in colours, with its colour bar and what lies over it.

use super::canvas::{Area, Hold, TEXT, drawn, on_paper, part, text_style, write, write_title};
use super::legend::{self, Entry, Sample};
use super::overlay::Overlay;
use super::{Figure, FigureError, Table, ticks};
use plotters::prelude::{ChartBuilder, LabelAreaPosition, Rectangle};
use plotters::style::{Color, RGBColor, ShapeStyle};

/// Values on a regular lattice of the hall.
///
/// ```text
///   y ▲  values[2·n_cols] …
///     │  values[n_cols] …
///     │  values[0] values[1] … values[n_cols − 1]
///     └──▶ x
/// ```
/// Each value stands for a square of `cell_m`; (`x_min_m`, `y_min_m`) is the lower left corner of
/// the first. A value that is not finite is unknown and drawn grey.
#[derive(Debug, Clone, PartialEq)]
pub struct Lattice {
    /// Left border, m.
    pub x_min_m: f64,
    /// Lower border, m.
    pub y_min_m: f64,
    /// Side of a cell, m.
    pub cell_m: f64,
    /// Cells in a row along x.
    pub n_cols: usize,
    /// Row by row, from small y to large.
    pub values: Vec<f64>,
}

/// A map in colours.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatMap {
    /// What the picture shows.
    pub title: String,
    /// The values.
    pub grid: Lattice,
    /// What the values are, with their unit; stands beside the colour bar.
    pub quantity: String,
    /// Values at the ends of the colour bar; those of the data if `None`. Values beyond take the
    /// colour of the end.
    pub range: Option<[f64; 2]>,
    /// Values have a sign that matters: orange below 0, purple above, light at 0 in the middle of the bar.
    pub is_signed: bool,
    /// What lies over the map, in the order of drawing.
    pub overlays: Vec<Overlay>,
}

/// Length of the map's longer side, units of the picture.
const LONG_SIDE: f64 = 460.0;
pub(super) const TOP: i32 = 42;
pub(super) const LEFT: i32 = 64;
pub(super) const BELOW: i32 = 52;
const BAR_GAP: i32 = 20;
const BAR_WIDTH: i32 = 18;
const BAR_LABELS: i32 = 62;
const BAR_TITLE: i32 = 30;
const TICK: i32 = 6;
/// Free ground around an overlay that reaches beyond the lattice, m.
const MARGIN_M: f64 = 0.5;
pub(super) const UNKNOWN: RGBColor = RGBColor(222, 222, 222);
pub(super) const FRAME: RGBColor = RGBColor(60, 60, 60);
/// Shades of the map; neighbouring cells of one shade become one rectangle.
const N_SHADES: f64 = 128.0;

impl Lattice {
    fn n_rows(&self) -> usize {
        self.values.len() / self.n_cols.max(1)
    }

    /// Right and upper border, m.
    #[expect(clippy::cast_precision_loss, reason = "lattices are small")]
    fn far_corner_m(&self) -> [f64; 2] {
        [
            self.x_min_m + self.n_cols as f64 * self.cell_m,
            self.y_min_m + self.n_rows() as f64 * self.cell_m,
        ]
    }

    /// The border between the cells whose value is above a level and the others, for
    /// [`Shape::Segments`](super::Shape::Segments): where the map ends is no border.
    #[must_use]
    pub fn border_m(&self, level: f64) -> Vec<[f64; 2]> {
        let is_above = |k: usize| self.values.get(k).is_some_and(|v| *v > level);
        let half_m = 0.5 * self.cell_m;
        let mut ends = Vec::new();
        for k in 0..self.values.len() {
            let [x, y] = self.centre_m(k);
            let has_right = (k + 1) % self.n_cols != 0;
            if has_right && is_above(k) != is_above(k + 1) {
                ends.extend([[x + half_m, y - half_m], [x + half_m, y + half_m]]);
            }
            let has_upper = k + self.n_cols < self.values.len();
            if has_upper && is_above(k) != is_above(k + self.n_cols) {
                ends.extend([[x - half_m, y + half_m], [x + half_m, y + half_m]]);
            }
        }
        ends
    }

    /// Shows neighbours in a row that look the same as one rectangle: its upper left and lower right
    /// corner, m, and the look.
    pub(super) fn for_each_run<T: PartialEq + Copy>(
        &self,
        look: impl Fn(f64) -> Option<T>,
        mut visit: impl FnMut([f64; 2], [f64; 2], Option<T>) -> Result<(), FigureError>,
    ) -> Result<(), FigureError> {
        let half_m = 0.5 * self.cell_m;
        for row in 0..self.n_rows() {
            let first = row * self.n_cols;
            let looks: Vec<Option<T>> =
                self.values[first..first + self.n_cols].iter().map(|value| look(*value)).collect();
            let mut from = 0;
            for run in looks.chunk_by(|a, b| a == b) {
                let to = from + run.len() - 1;
                let [x0, y0] = self.centre_m(first + from);
                let [x1, _] = self.centre_m(first + to);
                visit([x0 - half_m, y0 + half_m], [x1 + half_m, y0 - half_m], run[0])?;
                from = to + 1;
            }
        }
        Ok(())
    }

    /// Centre of a cell, m.
    #[expect(clippy::cast_precision_loss, reason = "lattices are small")]
    fn centre_m(&self, k: usize) -> [f64; 2] {
        let (col, row) = (k % self.n_cols, k / self.n_cols);
        [
            self.x_min_m + (col as f64 + 0.5) * self.cell_m,
            self.y_min_m + (row as f64 + 0.5) * self.cell_m,
        ]
    }
}

/// Where the hall lies on the picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    /// Lower left and upper right corner of what is shown, m.
    min_m: [f64; 2],
    max_m: [f64; 2],
    /// The map's size on the picture.
    pub(super) size: (i32, i32),
}

impl View {
    #[expect(clippy::cast_possible_truncation, reason = "pictures are small")]
    pub(super) fn of(map: &HeatMap) -> Self {
        let grid = &map.grid;
        let (mut min_m, mut max_m) = ([grid.x_min_m, grid.y_min_m], grid.far_corner_m());
        for point in map.overlays.iter().flat_map(|overlay| &overlay.points_m) {
            for k in 0..2 {
                if point[k] < min_m[k] {
                    min_m[k] = point[k] - MARGIN_M;
                }
                if point[k] > max_m[k] {
                    max_m[k] = point[k] + MARGIN_M;
                }
            }
        }
        let spans_m = [max_m[0] - min_m[0], max_m[1] - min_m[1]];
        let scale = LONG_SIDE / spans_m[0].max(spans_m[1]);
        // A long narrow hall keeps room for its labels.
        let side = |span_m: f64| ((span_m * scale).round() as i32).max(120);
        Self { min_m, max_m, size: (side(spans_m[0]), side(spans_m[1])) }
    }

    /// From hall to the map's part of the picture.
    #[expect(clippy::cast_possible_truncation, reason = "pictures are small")]
    pub(super) fn place(&self, point_m: &[f64; 2]) -> (i32, i32) {
        let share = |k: usize| (point_m[k] - self.min_m[k]) / (self.max_m[k] - self.min_m[k]);
        let (width, height) = (f64::from(self.size.0), f64::from(self.size.1));
        ((share(0) * width).round() as i32, ((1.0 - share(1)) * height).round() as i32)
    }
}

impl HeatMap {
    pub(super) fn check(&self) -> Result<(), FigureError> {
        let grid = &self.grid;
        let is_whole = grid.n_cols > 0
            && !grid.values.is_empty()
            && grid.values.len().is_multiple_of(grid.n_cols);
        let numbers = [grid.x_min_m, grid.y_min_m, grid.cell_m];
        let reason = if !is_whole {
            format!("{} values do not fill rows of {}", grid.values.len(), grid.n_cols)
        } else if numbers.iter().any(|n| !n.is_finite()) || grid.cell_m <= 0.0 {
            "the lattice has no place or no cells".to_owned()
        } else if self.overlays.iter().flat_map(|o| &o.points_m).flatten().any(|n| !n.is_finite()) {
            "a point over the map is nowhere".to_owned()
        } else {
            return Ok(());
        };
        Err(FigureError::BadData { title: self.title.clone(), reason })
    }

    /// Values at the ends of the colour bar, different from each other.
    fn shown_range(&self) -> [f64; 2] {
        let known = || self.grid.values.iter().copied().filter(|v| v.is_finite());
        let [low, high] = self.range.unwrap_or_else(|| {
            [known().fold(f64::INFINITY, f64::min), known().fold(f64::NEG_INFINITY, f64::max)]
        });
        let farthest = low.abs().max(high.abs());
        let [low, high] = if self.is_signed { [-farthest, farthest] } else { [low, high] };
        match (low.is_finite() && high.is_finite(), high > low) {
            (true, true) => [low, high],
            (true, false) => [low - 0.5, low + 0.5],
            (false, _) => [0.0, 1.0],
        }
    }

    pub(super) fn entries(&self) -> Vec<Entry> {
        let mut entries: Vec<Entry> = Vec::new();
        for overlay in self.overlays.iter().filter(|overlay| !overlay.label.is_empty()) {
            if entries.last().is_none_or(|last| last.label != overlay.label) {
                let sample = Sample::Mark(overlay.shape, overlay.ink);
                entries.push(Entry { label: overlay.label.clone(), sample });
            }
        }
        entries
    }

    /// The colour of a share of the bar from 0 to 1.
    fn colour(&self, share: f64) -> RGBColor {
        if self.is_signed { between(&PUOR, share) } else { between(&VIRIDIS, share) }
    }

    fn draw_cells(&self, area: &Area<'_>, view: &View) -> Result<(), FigureError> {
        let [low, high] = self.shown_range();
        self.grid.for_each_run(
            |value| shade(value, low, high),
            |from_m, to_m, shade| {
                let corners = [view.place(&from_m), view.place(&to_m)];
                let colour = shade.map_or(UNKNOWN, |share| self.colour(share));
                drawn(area.draw(&Rectangle::new(corners, colour.filled())))
            },
        )
    }
}

/// Which of the shades a value gets, 0 to 1; `None` if it is unknown.
fn shade(value: f64, low: f64, high: f64) -> Option<f64> {
    let share = ((value - low) / (high - low)).clamp(0.0, 1.0);
    value.is_finite().then(|| (share * (N_SHADES - 1.0)).round() / (N_SHADES - 1.0))
}

/// Perceptually uniform, dark to light: eight colours of matplotlib's viridis (van der Walt and
/// Smith 2015, CC0) at equal distances; linear between them.
const VIRIDIS: [[f64; 3]; 8] = [
    [68.0, 1.0, 84.0],
    [70.0, 50.0, 127.0],
    [54.0, 92.0, 141.0],
    [39.0, 127.0, 143.0],
    [31.0, 162.0, 136.0],
    [74.0, 194.0, 110.0],
    [160.0, 219.0, 57.0],
    [254.0, 232.0, 37.0],
];

/// Below and above a middle, told apart without seeing all colours: `ColorBrewer`'s `PuOr` in nine classes
/// (Brewer and Harrower, Apache-2.0), from orange to purple.
const PUOR: [[f64; 3]; 9] = [
    [179.0, 88.0, 6.0],
    [224.0, 130.0, 20.0],
    [253.0, 184.0, 99.0],
    [254.0, 224.0, 182.0],
    [247.0, 247.0, 247.0],
    [216.0, 218.0, 235.0],
    [178.0, 171.0, 210.0],
    [128.0, 115.0, 172.0],
    [84.0, 39.0, 136.0],
];

/// The colour of a share from 0 to 1 between stops at equal distances.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "within a byte, among some stops"
)]
fn between(stops: &[[f64; 3]], share: f64) -> RGBColor {
    let last = stops.len() - 2;
    let place = share.clamp(0.0, 1.0) * (stops.len() - 1) as f64;
    let below = (place as usize).min(last);
    let mix = |k: usize| {
        let t = place - below as f64;
        ((1.0 - t) * stops[below][k] + t * stops[below + 1][k]).round() as u8
    };
    RGBColor(mix(0), mix(1), mix(2))
}

/// Axes in metres around the map, which has its place at (`LEFT`, `TOP`).
pub(super) fn draw_axes(root: &Area<'_>, view: &View) -> Result<(), FigureError> {
    let (width, height) = view.size;
    let area = part(root, (0, TOP), (LEFT + width, height + BELOW));
    let [x, y] = [0, 1].map(|k| view.min_m[k]..view.max_m[k]);
    let mut chart = drawn(
        ChartBuilder::on(&area)
            .x_label_area_size(BELOW)
            .y_label_area_size(LEFT)
            .build_cartesian_2d(x.clone(), y.clone()),
    )?;
    let n_labels = |length: i32| usize::try_from(length / 55).unwrap_or(2).max(2);
    drawn(
        chart
            .configure_mesh()
            .disable_mesh()
            .axis_style(FRAME)
            .x_labels(n_labels(width))
            .y_labels(n_labels(height))
            .x_label_formatter(&ticks::label(x.end - x.start))
            .y_label_formatter(&ticks::label(y.end - y.start))
            .label_style(text_style(TEXT))
            .draw(),
    )?;
    let foot = TOP + height + BELOW - 14;
    write(root, "x (m)", (LEFT + width / 2, foot), TEXT, Hold::Middle)?;
    write(root, "y (m)", (14, TOP + height / 2), TEXT, Hold::Upwards)
}

/// The colour bar with its numbers, right of the map.
fn draw_bar(
    root: &Area<'_>,
    at: (i32, i32),
    height: i32,
    [low, high]: [f64; 2],
    map: &HeatMap,
) -> Result<(), FigureError> {
    let area = part(root, at, (BAR_WIDTH + BAR_LABELS, height));
    for y in 0..height {
        let share = 1.0 - f64::from(y) / f64::from(height);
        let row = [(0, y), (BAR_WIDTH, y + 1)];
        let tone = shade(share, 0.0, 1.0).map_or(UNKNOWN, |share| map.colour(share));
        drawn(area.draw(&Rectangle::new(row, tone.filled())))?;
    }
    let mut chart = drawn(
        ChartBuilder::on(&area)
            .right_y_label_area_size(BAR_LABELS)
            .build_cartesian_2d(0.0..1.0, low..high),
    )?;
    drawn(
        chart
            .configure_mesh()
            .disable_mesh()
            .disable_x_axis()
            .set_tick_mark_size(LabelAreaPosition::Right, TICK)
            .axis_style(FRAME)
            .y_labels(8)
            .y_label_formatter(&ticks::label(high - low))
            .label_style(text_style(TEXT))
            .draw(),
    )?;
    let beside = (at.0 + BAR_WIDTH + BAR_LABELS + BAR_TITLE / 2, at.1 + height / 2);
    write(root, &map.quantity, beside, TEXT, Hold::Upwards)
}

impl Figure for HeatMap {
    fn svg(&self) -> Result<String, FigureError> {
        self.check()?;
        let view = View::of(self);
        let (width, height) = view.size;
        let entries = self.entries();
        let right = BAR_GAP + BAR_WIDTH + BAR_LABELS + BAR_TITLE;
        let total = LEFT + width + right;
        let legend_height = legend::height(&entries, total - LEFT);
        let below_map = TOP + height + BELOW;
        let size = (total.unsigned_abs(), (below_map + legend_height).unsigned_abs());
        on_paper(size, |root| {
            write_title(root, &self.title, total, TOP)?;
            draw_axes(root, &view)?;
            let map = part(root, (LEFT, TOP), view.size);
            self.draw_cells(&map, &view)?;
            for overlay in &self.overlays {
                overlay.draw(&map, |point_m| view.place(point_m))?;
            }
            let frame = Rectangle::new([(0, 0), view.size], ShapeStyle::from(FRAME));
            drawn(map.draw(&frame))?;
            let at = (LEFT + width + BAR_GAP, TOP);
            draw_bar(root, at, height, self.shown_range(), self)?;
            if legend_height > 0 {
                let area = part(root, (LEFT, below_map), (total - LEFT, legend_height));
                legend::draw(&area, &entries, total - LEFT)?;
            }
            Ok(())
        })
    }

    fn tables(&self) -> Vec<Table> {
        let columns = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let cells = (0..self.grid.values.len())
            .map(|k| {
                let [x_m, y_m] = self.grid.centre_m(k);
                (String::new(), vec![x_m, y_m, self.grid.values[k]])
            })
            .collect();
        let map = Table {
            kind: String::new(),
            columns: columns(&["x (m)", "y (m)", &self.quantity]),
            rows: cells,
        };
        let points: Vec<(String, Vec<f64>)> = self
            .overlays
            .iter()
            .flat_map(|overlay| {
                let name =
                    if overlay.label.is_empty() { overlay.shape.name() } else { &overlay.label };
                overlay.points_m.iter().map(move |point| (name.to_owned(), point.to_vec()))
            })
            .collect();
        let over = Table {
            kind: "overlay".to_owned(),
            columns: columns(&["what", "x (m)", "y (m)"]),
            rows: points,
        };
        if over.rows.is_empty() { vec![map] } else { vec![map, over] }
    }
}
