//! Sheets with one tag each, as vector PDF.
//!
//! ```text
//!   ┌──────────────────────┐
//!   │ ▲ up   36h11  id 7   │   what it is, and the side that is up
//!   │┊ ┌╴              ╶┐  │
//!   │┊    ■■■■■■■■■■       │   the tag with a white margin of one cell, marks to cut along
//!   │┊    ■■□□■■□□■■       │
//!   │┊ └╴              ╶┘  │
//!   │  ├──┼──┼──┼──┤       │   rulers of 200 mm in both directions
//!   └──────────────────────┘
//! ```
//! Lengths of the PDF are true when it is printed at 100 %; the rulers tell whether it was. Texts are in
//! Helvetica, which every reader of PDF has.

use super::paper::{BORDER_MM, BOTTOM_STRIP_MM, Paper, SIDE_STRIP_MM, SheetError, TOP_STRIP_MM};
use crate::messages::{TagFamily, TagPattern};
use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, Str};

/// Length of the rulers, mm.
pub const RULER_MM: f64 = 200.0;
/// What is believed of a measured ruler, mm.
const BELIEVED_MM: std::ops::RangeInclusive<f64> = 150.0..=250.0;
/// Both axes are the same if they differ by less than this: the printer is no worse, and a square
/// of the marker map may be off by six times as much.
const SAME_RATIO: f64 = 0.003;
const SMALLEST_EDGE_MM: f64 = 20.0;
const POINTS_PER_MM: f64 = 72.0 / 25.4;
const FONT: Name<'static> = Name(b"F1");

/// What is printed.
#[derive(Debug, Clone, PartialEq)]
pub struct PrintJob {
    /// The family.
    pub family: TagFamily,
    /// The tags, one sheet each.
    pub ids: Vec<u32>,
    /// The paper.
    pub paper: Paper,
    /// Edge of the black square, where detectors put the corners, mm.
    pub edge_mm: f64,
    /// Everything is drawn this many times larger in x and y, against a printer that shrinks.
    pub scale: [f64; 2],
}

/// What a printed sheet really measures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueEdge {
    /// Edge of the black square, mean of both directions, mm.
    pub edge_mm: f64,
    /// Relative difference of both directions.
    pub difference: f64,
    /// Factors for [`PrintJob::scale`] that would make the next print true.
    pub scale: [f64; 2],
}

impl TrueEdge {
    /// True if the tag is a square for all that matters here.
    #[must_use]
    pub fn is_square(&self) -> bool {
        self.difference.abs() <= SAME_RATIO
    }
}

/// The true edge of a tag whose rulers of 200 mm measure this, horizontally and vertically, mm.
///
/// # Errors
/// [`SheetError::Measured`] for a length that cannot be.
pub fn true_edge(edge_mm: f64, measured_mm: [f64; 2]) -> Result<TrueEdge, SheetError> {
    if let Some(&measured_mm) = measured_mm.iter().find(|mm| !BELIEVED_MM.contains(*mm)) {
        return Err(SheetError::Measured { measured_mm });
    }
    let [x, y] = measured_mm.map(|mm| mm / RULER_MM);
    Ok(TrueEdge {
        edge_mm: edge_mm * 0.5 * (x + y),
        difference: (x - y) / (0.5 * (x + y)),
        scale: [1.0 / x, 1.0 / y],
    })
}

impl PrintJob {
    /// The PDF, one page for each tag.
    ///
    /// # Errors
    /// A tag that does not exist or does not fit on the paper.
    pub fn pdf(&self) -> Result<Vec<u8>, SheetError> {
        let patterns = self.patterns()?;
        let mut pdf = Pdf::new();
        let [catalog, tree, font] = [1, 2, 3].map(Ref::new);
        let pages: Vec<(Ref, Ref)> =
            (2..).take(patterns.len()).map(|n| (Ref::new(2 * n), Ref::new(2 * n + 1))).collect();
        pdf.catalog(catalog).pages(tree);
        let n_pages = i32::try_from(pages.len()).unwrap_or(i32::MAX);
        pdf.pages(tree).kids(pages.iter().map(|(page, _)| *page)).count(n_pages);
        pdf.type1_font(font).base_font(Name(b"Helvetica"));
        for ((id, pattern), (page_ref, content_ref)) in patterns.iter().zip(pages) {
            let mut page = pdf.page(page_ref);
            let (width, height) = (points(self.paper.width_mm), points(self.paper.height_mm));
            page.media_box(Rect::new(0.0, 0.0, width, height));
            page.parent(tree).contents(content_ref);
            page.resources().fonts().pair(FONT, font);
            page.finish();
            pdf.stream(content_ref, &self.page(*id, pattern));
        }
        Ok(pdf.finish())
    }

    /// Where the upper left corner of the black square lies on the paper, from its upper left
    /// corner, at scale 1, mm.
    #[must_use]
    pub fn corner_mm(&self) -> [f64; 2] {
        let margin_mm = self.edge_mm / f64::from(self.family.n_cells());
        let room_mm = self.paper.width_mm - 2.0 * BORDER_MM - SIDE_STRIP_MM;
        let side_mm = 0.5 * (room_mm - self.edge_mm - 2.0 * margin_mm);
        [BORDER_MM + SIDE_STRIP_MM + side_mm + margin_mm, BORDER_MM + TOP_STRIP_MM + margin_mm]
    }

    fn patterns(&self) -> Result<Vec<(u32, TagPattern)>, SheetError> {
        let largest_mm = self.paper.largest_edge_mm(self.family);
        if !(SMALLEST_EDGE_MM..=largest_mm).contains(&self.edge_mm) {
            let paper = self.paper.name;
            return Err(SheetError::DoesNotFit { edge_mm: self.edge_mm, paper, largest_mm });
        }
        if self.ids.is_empty() {
            return Err(SheetError::NoTags);
        }
        let (family, last) = (self.family, self.family.n_tags() - 1);
        let pattern = |id: &u32| {
            let unknown = SheetError::UnknownTag { family, id: *id, last };
            TagPattern::new(family, *id).map(|pattern| (*id, pattern)).ok_or(unknown)
        };
        self.ids.iter().map(pattern).collect()
    }

    fn page(&self, id: u32, pattern: &TagPattern) -> Vec<u8> {
        let mut pen = Pen::new(&self.paper, self.scale);
        self.draw_tag(&mut pen, pattern);
        self.draw_texts(&mut pen, id);
        let ruler_y_mm = self.paper.height_mm - BORDER_MM - 10.0;
        pen.ruler([self.ruler_left_mm(), ruler_y_mm], false);
        let ruler_top_mm = 0.5 * (self.paper.height_mm - RULER_MM);
        pen.ruler([BORDER_MM + 4.0, ruler_top_mm], true);
        pen.content.finish().into_vec()
    }

    /// The horizontal ruler stands in the middle; on A4 it leaves the border just free.
    fn ruler_left_mm(&self) -> f64 {
        0.5 * (self.paper.width_mm - RULER_MM)
    }

    fn draw_tag(&self, pen: &mut Pen, pattern: &TagPattern) {
        let [left, top] = self.corner_mm();
        let n_cells = i32::from(pattern.n_cells());
        let cell = self.edge_mm / f64::from(n_cells);
        pen.grey(0.0);
        pen.rect([left, top], [self.edge_mm; 2]);
        pen.content.fill_nonzero();
        pen.grey(1.0);
        let cells = (0..n_cells).flat_map(|row| (0..n_cells).map(move |col| (col, row)));
        for (col, row) in cells.filter(|(col, row)| pattern.is_white(*col, *row)) {
            pen.rect([left + f64::from(col) * cell, top + f64::from(row) * cell], [cell; 2]);
        }
        // One fill for all cells, so that no seam shows between them.
        pen.content.fill_nonzero();
        pen.grey(0.6);
        let (near, far) = (-cell, self.edge_mm + cell);
        for (x, y) in [(near, near), (far, near), (near, far), (far, far)] {
            let arm = |at: f64| if at < 0.0 { 0.25 * cell } else { -0.25 * cell };
            pen.line([left + x, top + y], [left + x + arm(x), top + y]);
            pen.line([left + x, top + y], [left + x, top + y + arm(y)]);
        }
    }

    fn draw_texts(&self, pen: &mut Pen, id: u32) {
        let [left, top] = [BORDER_MM + SIDE_STRIP_MM, BORDER_MM];
        pen.grey(0.0);
        pen.arrow([left + 4.0, top + 1.0]);
        let family = self.family.name();
        pen.text([left + 12.0, top + 7.0], 16.0, &format!("UP    {family}  id {id}"));
        let edge = format!("black square {:.1} mm", self.edge_mm);
        pen.text(
            [left + 12.0, top + 13.0],
            10.0,
            &format!("{edge}; keep the white margin up to the marks"),
        );
        let advice =
            "print at 100 %, then measure both rulers: each is 200 mm, or the tag is not its size";
        let y = self.paper.height_mm - BORDER_MM - BOTTOM_STRIP_MM + 9.0;
        pen.text([self.ruler_left_mm(), y], 9.0, advice);
    }
}

#[expect(clippy::cast_possible_truncation, reason = "PDF numbers; 10⁻⁵ mm are enough")]
fn points(mm: f64) -> f32 {
    (mm * POINTS_PER_MM) as f32
}

/// Draws in millimetres from the upper left corner of the paper.
struct Pen {
    content: Content,
    height_mm: f64,
}

impl Pen {
    fn new(paper: &Paper, scale: [f64; 2]) -> Self {
        let mut content = Content::new();
        // Larger about the middle of the paper.
        let [x, y] = scale;
        let shift = |size_mm: f64, scale: f64| points(0.5 * size_mm * (1.0 - scale));
        #[expect(clippy::cast_possible_truncation, reason = "PDF numbers")]
        let (x32, y32) = (x as f32, y as f32);
        content.transform([
            x32,
            0.0,
            0.0,
            y32,
            shift(paper.width_mm, x),
            shift(paper.height_mm, y),
        ]);
        Self { content, height_mm: paper.height_mm }
    }

    fn place(&self, [x_mm, y_mm]: [f64; 2]) -> (f32, f32) {
        (points(x_mm), points(self.height_mm - y_mm))
    }

    fn grey(&mut self, level: f32) {
        self.content.set_fill_gray(level).set_stroke_gray(level);
    }

    /// Adds a rectangle to the path by its upper left corner.
    fn rect(&mut self, [x_mm, y_mm]: [f64; 2], [width_mm, height_mm]: [f64; 2]) {
        let (x, y) = self.place([x_mm, y_mm + height_mm]);
        self.content.rect(x, y, points(width_mm), points(height_mm));
    }

    fn line(&mut self, from: [f64; 2], to: [f64; 2]) {
        let ((x1, y1), (x2, y2)) = (self.place(from), self.place(to));
        self.content.set_line_width(points(0.15)).move_to(x1, y1).line_to(x2, y2).stroke();
    }

    fn text(&mut self, at: [f64; 2], size_points: f32, text: &str) {
        let (x, y) = self.place(at);
        self.content.begin_text().set_font(FONT, size_points).next_line(x, y);
        self.content.show(Str(text.as_bytes())).end_text();
    }

    /// An arrow upwards in a box of 5 mm by 7 mm.
    fn arrow(&mut self, [x, y]: [f64; 2]) {
        let outline =
            [[2.5, 0.0], [5.0, 3.0], [3.3, 3.0], [3.3, 7.0], [1.7, 7.0], [1.7, 3.0], [0.0, 3.0]];
        for (k, [dx, dy]) in outline.into_iter().enumerate() {
            let (px, py) = self.place([x + dx, y + dy]);
            if k == 0 {
                self.content.move_to(px, py)
            } else {
                self.content.line_to(px, py)
            };
        }
        self.content.close_path().fill_nonzero();
    }

    /// 200 mm with a tick each millimetre; `at` is its first end.
    fn ruler(&mut self, [x, y]: [f64; 2], is_vertical: bool) {
        self.grey(0.0);
        let along = |mm: f64, aside_mm: f64| {
            if is_vertical { [x + aside_mm, y + mm] } else { [x + mm, y + aside_mm] }
        };
        self.line(along(0.0, 0.0), along(RULER_MM, 0.0));
        for mm in 0..=200_u32 {
            let tick_mm = match mm {
                0 | 200 => 7.0,
                mm if mm.is_multiple_of(10) => 4.0,
                mm if mm.is_multiple_of(5) => 2.5,
                _ => 1.5,
            };
            self.line(along(f64::from(mm), 0.0), along(f64::from(mm), tick_mm));
        }
        for mm in (50..=150).step_by(50) {
            let at = along(f64::from(mm), 6.5);
            self.text([at[0] - 2.0, at[1] + 0.8], 7.0, &mm.to_string());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_printer_that_shrinks_is_told_and_undone() {
        // 200 mm printed as 191.8 and 191.6 mm: 95.85 % of 150 mm.
        let edge = true_edge(150.0, [191.8, 191.6]).unwrap();
        assert!((edge.edge_mm - 143.775).abs() < 1e-9 && edge.is_square());
        assert!((edge.scale[0] * 191.8 - 200.0).abs() < 1e-9);
        assert!(!true_edge(150.0, [200.0, 198.0]).unwrap().is_square());
        assert!(true_edge(150.0, [20.0, 200.0]).is_err(), "centimetres");
    }

    #[test]
    fn what_cannot_be_printed_is_refused() {
        let job = |ids: Vec<u32>, edge_mm| PrintJob {
            family: TagFamily::Tag16h5,
            ids,
            paper: Paper::ALL[0],
            edge_mm,
            scale: [1.0; 2],
        };
        assert!(job(vec![0, 29], 100.0).pdf().unwrap().starts_with(b"%PDF"));
        assert!(matches!(job(vec![30], 100.0).pdf(), Err(SheetError::UnknownTag { id: 30, .. })));
        assert!(matches!(job(vec![0], 190.0).pdf(), Err(SheetError::DoesNotFit { .. })));
        assert!(matches!(job(vec![], 100.0).pdf(), Err(SheetError::NoTags)));
    }
}
