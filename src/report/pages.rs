//! The report as PDF pages: blocks of known height, put onto pages in their order.

mod blocks;

use super::content::{Content, Part};
use crate::pdf::{About, Document, Hold, Ink, Page, PdfError, Size, Style, Typefaces};
use jiff::Timestamp;

/// Borders of the page, mm.
const LEFT_MM: f64 = 20.0;
const WIDTH_MM: f64 = 170.0;
const TOP_MM: f64 = 24.0;
const BOTTOM_MM: f64 = 277.0;
const FOOT_MM: f64 = 285.0;

const DARK: Ink = Ink(28, 32, 38);
const GREY: Ink = Ink(105, 112, 120);
const HAIR: Ink = Ink(214, 218, 222);
const PALE: Ink = Ink(244, 246, 248);
const ACCENT: Ink = Ink(0, 90, 140);

type Draw<'a> = Box<dyn Fn(&mut Page<'_, '_>, f64) -> Result<(), PdfError> + 'a>;

/// Something that is not broken between pages.
struct Block<'a> {
    height_mm: f64,
    /// It must not be the last of its page.
    keeps_next: bool,
    draw: Draw<'a>,
}

impl<'a> Block<'a> {
    fn new(
        height_mm: f64,
        draw: impl Fn(&mut Page<'_, '_>, f64) -> Result<(), PdfError> + 'a,
    ) -> Self {
        Self { height_mm, keeps_next: false, draw: Box::new(draw) }
    }

    fn keeping_next(self) -> Self {
        Self { keeps_next: true, ..self }
    }
}

/// The document; `of` is when the survey began.
pub(super) fn pdf(content: &Content, of: Option<Timestamp>) -> Result<Vec<u8>, PdfError> {
    let about = About {
        title: content.title.clone(),
        subject: format!("Survey report. {}", content.subtitle),
        of,
    };
    let mut document = Document::new(&about)?;
    let pages = paginated(chapters(content, document.typefaces())?);
    let n_pages = pages.len();
    for (index, blocks) in pages.iter().enumerate() {
        document.page::<PdfError>(Size::A4, |page| {
            let is_first = index == 0;
            frame(page, content, (index + 1, n_pages), is_first);
            let mut y_mm = if is_first { FIRST_TOP_MM } else { TOP_MM };
            for block in blocks {
                (block.draw)(page, y_mm)?;
                y_mm += block.height_mm;
            }
            Ok(())
        })?;
    }
    document.finish()
}

/// Below the title of the first page, mm.
const FIRST_TOP_MM: f64 = 43.5;

/// Blocks of each chapter: what begins on a new page.
fn chapters<'a>(
    content: &'a Content,
    typefaces: &Typefaces,
) -> Result<Vec<Vec<Block<'a>>>, PdfError> {
    let mut chapters = vec![Vec::new()];
    for part in &content.parts {
        if *part == Part::NewPage {
            chapters.push(Vec::new());
        } else if let Some(chapter) = chapters.last_mut() {
            chapter.extend(blocks::of(part, typefaces)?);
        }
    }
    Ok(chapters)
}

/// Blocks of each page.
fn paginated(chapters: Vec<Vec<Block<'_>>>) -> Vec<Vec<Block<'_>>> {
    let mut pages: Vec<Vec<Block<'_>>> = Vec::new();
    for chapter in chapters {
        let mut room_mm = BOTTOM_MM - if pages.is_empty() { FIRST_TOP_MM } else { TOP_MM };
        let mut page: Vec<Block<'_>> = Vec::new();
        for group in groups(chapter) {
            let height_mm: f64 = group.iter().map(|block| block.height_mm).sum();
            if height_mm > room_mm && !page.is_empty() {
                pages.push(std::mem::take(&mut page));
                room_mm = BOTTOM_MM - TOP_MM;
            }
            room_mm -= height_mm;
            page.extend(group);
        }
        if !page.is_empty() {
            pages.push(page);
        }
    }
    pages
}

/// Blocks that stay together: headings with what follows.
fn groups(blocks: Vec<Block<'_>>) -> Vec<Vec<Block<'_>>> {
    let mut groups: Vec<Vec<Block<'_>>> = Vec::new();
    let mut is_open = false;
    for block in blocks {
        let keeps_next = block.keeps_next;
        match groups.last_mut().filter(|_| is_open) {
            Some(group) => group.push(block),
            None => groups.push(vec![block]),
        }
        is_open = keeps_next;
    }
    groups
}

/// What stands on every page beside its blocks.
fn frame(
    page: &mut Page<'_, '_>,
    content: &Content,
    (number, n_pages): (usize, usize),
    is_first: bool,
) {
    let right_mm = LEFT_MM + WIDTH_MM;
    if is_first {
        page.area([LEFT_MM, 18.0], (9.0, 1.2), ACCENT);
        let kicker = Style::semi_bold(8.0, ACCENT);
        page.text("SURVEY REPORT", [LEFT_MM + 12.0, 19.6], kicker, Hold::Left);
        page.text("stockpilot", [right_mm, 19.6], Style::regular(8.0, GREY), Hold::Right);
        page.text(&content.title, [LEFT_MM, 32.0], Style::semi_bold(21.0, DARK), Hold::Left);
        page.text(&content.subtitle, [LEFT_MM, 38.5], Style::regular(9.0, GREY), Hold::Left);
    } else {
        let small = Style::regular(8.0, GREY);
        page.text(&content.title, [LEFT_MM, 15.0], small, Hold::Left);
        page.text("Survey report", [right_mm, 15.0], small, Hold::Right);
        page.line([LEFT_MM, 17.5], [right_mm, 17.5], 0.2, HAIR);
    }
    page.line([LEFT_MM, FOOT_MM - 4.5], [right_mm, FOOT_MM - 4.5], 0.2, HAIR);
    let small = Style::regular(7.5, GREY);
    page.text(&content.footer, [LEFT_MM, FOOT_MM], small, Hold::Left);
    page.text(&format!("{number} / {n_pages}"), [right_mm, FOOT_MM], small, Hold::Right);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block<'a>(height_mm: f64) -> Block<'a> {
        Block::new(height_mm, |_, _| Ok(()))
    }

    #[test]
    fn a_heading_goes_to_the_next_page_with_what_it_heads() {
        // 210 mm leave 23.5 mm on the first page: the heading alone would fit.
        let chapter = vec![block(210.0), block(10.0).keeping_next(), block(25.0), block(5.0)];
        let pages = paginated(vec![chapter]);
        let heights: Vec<Vec<f64>> =
            pages.iter().map(|page| page.iter().map(|block| block.height_mm).collect()).collect();
        assert_eq!(heights, [vec![210.0], vec![10.0, 25.0, 5.0]]);
    }

    #[test]
    fn what_is_higher_than_a_page_has_one_for_itself() {
        let pages = paginated(vec![vec![block(10.0), block(900.0), block(10.0)], Vec::new()]);
        assert_eq!(pages.len(), 3);
    }
}
