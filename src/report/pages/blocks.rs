//! Parts of a report as blocks of a page.

use super::{ACCENT, Block, DARK, GREY, HAIR, LEFT_MM, PALE, WIDTH_MM};
use crate::pdf::{Face, Hold, Ink, PdfError, Style, Typefaces};
use crate::report::content::{Bars, Column, Headline, Part, Picture, Side, Table, Tone};
use crate::report::verdict::Verdict;

const BODY_PT: f64 = 9.0;
const BODY_STEP_MM: f64 = 4.4;
const TABLE_PT: f64 = 8.6;
const TABLE_STEP_MM: f64 = 3.9;
const SMALL_PT: f64 = 7.6;
/// Air between the columns of a table, mm.
const GUTTER_MM: f64 = 3.0;
/// Where a bar begins and how long it may be, mm.
const BAR_LEFT_MM: f64 = 34.0;
const BAR_MM: f64 = 66.0;
/// Room of a picture, mm.
const PICTURE_MM: (f64, f64) = (134.0, 104.0);
/// So many bars stay together on a page; a hall may have more bays than that.
const MOST_BARS_TOGETHER: usize = 14;

impl Tone {
    const fn ink(self) -> Ink {
        let (red, green, blue) = self.rgb();
        Ink(red, green, blue)
    }
}

pub(super) fn of<'a>(part: &'a Part, typefaces: &Typefaces) -> Result<Vec<Block<'a>>, PdfError> {
    Ok(match part {
        Part::Headline(headline) => vec![of_headline(headline)],
        Part::Heading(text) => vec![of_heading(text)],
        Part::Subheading(text) => vec![of_subheading(text)],
        Part::Text(text) => vec![of_text(text, typefaces)],
        Part::List(texts) => texts.iter().map(|text| of_item(text, typefaces)).collect(),
        Part::Table(table) => of_table(table, typefaces),
        Part::Bars(bars) => of_bars(bars),
        Part::Pictures(pictures) => pictures.iter().map(of_picture).collect(),
        Part::Signatures(labels) => vec![of_signatures(labels)],
        Part::NewPage => Vec::new(),
    })
}

fn of_headline(headline: &Headline) -> Block<'_> {
    Block::new(34.0, |page, y_mm| {
        let tone = match headline.verdict {
            Verdict::Accepted => Tone::Green,
            Verdict::AcceptedWithRemark => Tone::Orange,
            Verdict::Repeat => Tone::Red,
        };
        page.area([LEFT_MM, y_mm], (WIDTH_MM, 30.0), PALE);
        page.area([LEFT_MM, y_mm], (1.4, 30.0), tone.ink());
        let label = Style::regular(8.5, GREY);
        let (left_mm, right_mm) = (LEFT_MM + 7.0, LEFT_MM + WIDTH_MM - 6.0);
        page.text(&headline.name, [left_mm, y_mm + 7.0], label, Hold::Left);
        let volume = Style::semi_bold(24.0, DARK);
        page.text(&headline.volume, [left_mm, y_mm + 17.5], volume, Hold::Left);
        if let Some(mass) = &headline.mass {
            let style = Style::semi_bold(14.0, DARK);
            page.text(mass, [left_mm, y_mm + 25.5], style, Hold::Left);
        } else {
            page.text("no density, no tonnes", [left_mm, y_mm + 25.0], label, Hold::Left);
        }
        page.text("k = 2, about 95 %", [right_mm, y_mm + 7.0], label, Hold::Right);
        let verdict = Style::semi_bold(12.0, tone.ink());
        page.text(headline.verdict.name(), [right_mm, y_mm + 25.3], verdict, Hold::Right);
        Ok(())
    })
}

fn of_heading(text: &str) -> Block<'_> {
    Block::new(9.8, move |page, y_mm| {
        let style = Style::semi_bold(11.0, ACCENT);
        page.text(text, [LEFT_MM, y_mm + 6.6], style, Hold::Left);
        Ok(())
    })
    .keeping_next()
}

fn of_subheading(text: &str) -> Block<'_> {
    Block::new(7.6, move |page, y_mm| {
        page.text(text, [LEFT_MM, y_mm + 5.2], Style::semi_bold(9.0, DARK), Hold::Left);
        Ok(())
    })
    .keeping_next()
}

#[expect(clippy::cast_precision_loss, reason = "a text has few lines")]
fn of_text<'a>(text: &'a str, typefaces: &Typefaces) -> Block<'a> {
    let n_lines = typefaces.lines(text, Face::Regular, BODY_PT, WIDTH_MM).len();
    Block::new(n_lines as f64 * BODY_STEP_MM + 2.0, move |page, y_mm| {
        let style = Style::regular(BODY_PT, DARK);
        page.paragraph(text, [LEFT_MM, y_mm + 3.4], style, (WIDTH_MM, BODY_STEP_MM));
        Ok(())
    })
}

#[expect(clippy::cast_precision_loss, reason = "a text has few lines")]
fn of_item<'a>(text: &'a str, typefaces: &Typefaces) -> Block<'a> {
    let width_mm = WIDTH_MM - 4.0;
    let n_lines = typefaces.lines(text, Face::Regular, BODY_PT, width_mm).len();
    Block::new(n_lines as f64 * BODY_STEP_MM + 0.8, move |page, y_mm| {
        let style = Style::regular(BODY_PT, DARK);
        page.text("•", [LEFT_MM, y_mm + 3.4], style, Hold::Left);
        page.paragraph(text, [LEFT_MM + 4.0, y_mm + 3.4], style, (width_mm, BODY_STEP_MM));
        Ok(())
    })
}

/// Left end and width of each column, mm.
fn columns_mm(columns: &[Column]) -> Vec<(f64, f64)> {
    let total: f64 = columns.iter().map(|column| column.weight).sum();
    let mut left_mm = LEFT_MM;
    let place = |column: &Column| {
        let width_mm = WIDTH_MM * column.weight / total;
        let place = (left_mm, width_mm - GUTTER_MM);
        left_mm += width_mm;
        place
    };
    let mut places: Vec<(f64, f64)> = columns.iter().map(place).collect();
    if let Some(last) = places.last_mut() {
        last.1 += GUTTER_MM;
    }
    places
}

fn of_table<'a>(table: &'a Table, typefaces: &Typefaces) -> Vec<Block<'a>> {
    let places = columns_mm(&table.columns);
    let head_places = places.clone();
    let head = Block::new(5.6, move |page, y_mm| {
        let style = Style::semi_bold(SMALL_PT, GREY);
        for (column, place_mm) in std::iter::zip(&table.columns, &head_places) {
            let (x_mm, hold) = held(column.side, *place_mm);
            page.text(column.title, [x_mm, y_mm + 3.4], style, hold);
        }
        page.line([LEFT_MM, y_mm + 5.0], [LEFT_MM + WIDTH_MM, y_mm + 5.0], 0.35, GREY);
        Ok(())
    })
    .keeping_next();
    let rows = table.rows.iter().map(|row| of_row(table, row, &places, typefaces));
    let mut blocks: Vec<Block<'a>> = std::iter::once(head).chain(rows).collect();
    blocks.push(Block::new(1.5, |_, _| Ok(())));
    blocks
}

#[expect(clippy::cast_precision_loss, reason = "a cell has few lines")]
fn of_row<'a>(
    table: &'a Table,
    row: &[String],
    places_mm: &[(f64, f64)],
    typefaces: &Typefaces,
) -> Block<'a> {
    let in_lines = |(text, place): (&String, &(f64, f64))| {
        typefaces.lines(text, Face::Regular, TABLE_PT, place.1)
    };
    let cells: Vec<Vec<String>> = std::iter::zip(row, places_mm).map(in_lines).collect();
    let n_lines = cells.iter().map(Vec::len).max().unwrap_or(1).max(1);
    let height_mm = n_lines as f64 * TABLE_STEP_MM + 1.4;
    let places = places_mm.to_vec();
    Block::new(height_mm, move |page, y_mm| {
        let columns = std::iter::zip(&table.columns, &places);
        for ((column, place_mm), lines) in std::iter::zip(columns, &cells) {
            let (x_mm, hold) = held(column.side, *place_mm);
            for (k, line) in lines.iter().enumerate() {
                let at_mm = [x_mm, y_mm + 3.7 + k as f64 * TABLE_STEP_MM];
                page.text(line, at_mm, Style::regular(TABLE_PT, DARK), hold);
            }
        }
        let below_mm = y_mm + height_mm;
        page.line([LEFT_MM, below_mm], [LEFT_MM + WIDTH_MM, below_mm], 0.15, HAIR);
        Ok(())
    })
}

fn held(side: Side, (left_mm, width_mm): (f64, f64)) -> (f64, Hold) {
    match side {
        Side::Left => (left_mm, Hold::Left),
        Side::Right => (left_mm + width_mm, Hold::Right),
    }
}

fn of_bars(bars: &Bars) -> Vec<Block<'_>> {
    let legend = Block::new(5.4, |page, y_mm| {
        let mut x_mm = LEFT_MM + BAR_LEFT_MM;
        for (label, tone) in &bars.parts {
            page.area([x_mm, y_mm + 1.3], (2.6, 2.6), tone.ink());
            let style = Style::regular(SMALL_PT, GREY);
            x_mm += 4.0 + page.text(label, [x_mm + 3.8, y_mm + 3.5], style, Hold::Left) + 4.0;
        }
        Ok(())
    })
    .keeping_next();
    let row = |(label, lengths, said): &'_ (String, Vec<f64>, String)| {
        let (label, lengths, said) = (label.clone(), lengths.clone(), said.clone());
        Block::new(5.0, move |page, y_mm| {
            let style = Style::regular(TABLE_PT, DARK);
            page.text(&label, [LEFT_MM, y_mm + 3.9], style, Hold::Left);
            let mut x_mm = LEFT_MM + BAR_LEFT_MM;
            page.area([x_mm, y_mm + 1.0], (BAR_MM, 3.6), PALE);
            for (length, (_, tone)) in std::iter::zip(&lengths, &bars.parts) {
                let length_mm = BAR_MM * length.clamp(0.0, 1.0);
                if length_mm > 0.0 {
                    page.area([x_mm, y_mm + 1.0], (length_mm, 3.6), tone.ink());
                }
                x_mm += length_mm;
            }
            let beside_mm = LEFT_MM + BAR_LEFT_MM + BAR_MM + 3.0;
            let style = Style::regular(SMALL_PT, DARK);
            page.text(&said, [beside_mm, y_mm + 3.8], style, Hold::Left);
            Ok(())
        })
    };
    // A single colour needs no legend: the heading says what it is.
    let legend = (bars.parts.len() > 1).then_some(legend);
    let air = Block::new(1.5, |_, _| Ok(()));
    let are_together = bars.rows.len() <= MOST_BARS_TOGETHER;
    let rows = bars.rows.iter().map(row).map(|row| Block { keeps_next: are_together, ..row });
    legend.into_iter().chain(rows).chain([air]).collect()
}

/// A picture in the middle of the page: as large as its letters need to be read.
fn of_picture(picture: &Picture) -> Block<'_> {
    Block::new(PICTURE_MM.1 + 9.0, move |page, y_mm| {
        let x_mm = LEFT_MM + 0.5 * (WIDTH_MM - PICTURE_MM.0);
        let (_, height_mm) = page.picture(&picture.svg, [x_mm, y_mm], PICTURE_MM)?;
        let style = Style::regular(SMALL_PT, GREY);
        let below_mm = [x_mm + 2.0, y_mm + height_mm + 3.6];
        page.paragraph(&picture.caption, below_mm, style, (PICTURE_MM.0, 3.4));
        Ok(())
    })
}

fn of_signatures(labels: &[String]) -> Block<'_> {
    Block::new(24.0, move |page, y_mm| {
        let mut x_mm = LEFT_MM;
        for label in labels {
            page.line([x_mm, y_mm + 17.0], [x_mm + 50.0, y_mm + 17.0], 0.25, GREY);
            let style = Style::regular(SMALL_PT, GREY);
            page.text(label, [x_mm, y_mm + 20.6], style, Hold::Left);
            x_mm += 60.0;
        }
        Ok(())
    })
}
