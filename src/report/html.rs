//! The report as one HTML file that needs nothing else.

use super::content::{Bars, Content, Headline, Part, Picture, Side, Table, Tone};
use super::verdict::Verdict;
use std::fmt::Write as _;

const STYLE: &str = include_str!("style.css");

/// The whole file.
pub(super) fn html(content: &Content) -> String {
    let mut out = String::new();
    let title = escaped(&content.title);
    // Writing into a text cannot fail.
    let _ok = write!(
        out,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}: survey report</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n\
         <header>\n<p class=\"kicker\">Survey report</p>\n<h1>{title}</h1>\n<p>{}</p>\n</header>\n",
        escaped(&content.subtitle)
    );
    for part in &content.parts {
        write_part(&mut out, part);
    }
    let _ok =
        write!(out, "<footer>{}</footer>\n</main>\n</body>\n</html>\n", escaped(&content.footer));
    out
}

fn write_part(out: &mut String, part: &Part) {
    let _ok = match part {
        Part::Headline(headline) => return write_headline(out, headline),
        Part::Table(table) => return write_table(out, table),
        Part::Bars(bars) => return write_bars(out, bars),
        Part::Pictures(pictures) => return write_pictures(out, pictures),
        Part::Heading(text) => writeln!(out, "<h2>{}</h2>", escaped(text)),
        Part::Subheading(text) => writeln!(out, "<h3>{}</h3>", escaped(text)),
        Part::Text(text) => writeln!(out, "<p>{}</p>", escaped(text)),
        Part::List(texts) => {
            let items = texts.iter().map(|text| format!("<li>{}</li>", escaped(text)));
            writeln!(out, "<ul>{}</ul>", items.collect::<String>())
        }
        Part::Signatures(labels) => {
            let lines = labels.iter().map(|label| format!("<span>{}</span>", escaped(label)));
            writeln!(out, "<p class=\"signatures\">{}</p>", lines.collect::<String>())
        }
        Part::NewPage => writeln!(out, "<hr>"),
    };
}

fn write_headline(out: &mut String, headline: &Headline) {
    let tone = match headline.verdict {
        Verdict::Accepted => Tone::Green,
        Verdict::AcceptedWithRemark => Tone::Orange,
        Verdict::Repeat => Tone::Red,
    };
    let mass = headline.mass.as_deref().unwrap_or("no density, no tonnes");
    let _ok = writeln!(
        out,
        "<section class=\"headline\" style=\"border-color:{0}\"><p>{1}</p><p class=\"volume\">{2}</p>\
         <p class=\"mass\">{3}</p><p class=\"verdict\" style=\"color:{0}\">{4}</p>\
         <p>k = 2, about 95 %</p></section>",
        colour(tone),
        escaped(&headline.name),
        escaped(&headline.volume),
        escaped(mass),
        headline.verdict.name()
    );
}

fn write_table(out: &mut String, table: &Table) {
    let class = |side| if side == Side::Right { " class=\"number\"" } else { "" };
    let heads = table.columns.iter().map(|column| {
        format!("<th scope=\"col\"{}>{}</th>", class(column.side), escaped(column.title))
    });
    let _ok = write!(
        out,
        "<div class=\"scroll\"><table><thead><tr>{}</tr></thead><tbody>",
        heads.collect::<String>()
    );
    for row in &table.rows {
        let cells = std::iter::zip(row, &table.columns)
            .map(|(text, column)| format!("<td{}>{}</td>", class(column.side), escaped(text)));
        let _ok = write!(out, "<tr>{}</tr>", cells.collect::<String>());
    }
    out.push_str("</tbody></table></div>\n");
}

fn write_bars(out: &mut String, bars: &Bars) {
    let legend = bars.parts.iter().map(|(label, tone)| {
        format!("<span><i style=\"background:{}\"></i>{}</span>", colour(*tone), escaped(label))
    });
    let _ok = writeln!(out, "<p class=\"legend\">{}</p>", legend.collect::<String>());
    out.push_str("<div class=\"bars\">");
    for (label, lengths, said) in &bars.rows {
        let pieces = std::iter::zip(lengths, &bars.parts).map(|(length, (_, tone))| {
            let percent = 100.0 * length.clamp(0.0, 1.0);
            format!("<i style=\"width:{percent:.3}%;background:{}\"></i>", colour(*tone))
        });
        let _ok = writeln!(
            out,
            "<span>{}</span><span class=\"bar\">{}</span><span>{}</span>",
            escaped(label),
            pieces.collect::<String>(),
            escaped(said)
        );
    }
    out.push_str("</div>\n");
}

fn write_pictures(out: &mut String, pictures: &[Picture]) {
    out.push_str("<div class=\"pictures\">");
    for picture in pictures {
        let _ok = writeln!(
            out,
            "<figure>{}<figcaption>{}</figcaption></figure>",
            picture.svg,
            escaped(&picture.caption)
        );
    }
    out.push_str("</div>\n");
}

fn colour(tone: Tone) -> String {
    let (red, green, blue) = tone.rgb();
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// A text that cannot become markup.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
        .replace('\'', "&#39;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::content::Column;

    #[test]
    fn names_from_a_configuration_are_text_and_nothing_else() {
        let evil = "<script>alert('x')</script>\" onload=\"";
        let table =
            Table { columns: vec![Column::words("Bay", 1.0)], rows: vec![vec![evil.to_owned()]] };
        let bars = Bars {
            parts: vec![("measured", Tone::Green)],
            rows: vec![(evil.to_owned(), vec![f64::NAN], evil.to_owned())],
        };
        let headline = Headline {
            name: evil.to_owned(),
            volume: evil.to_owned(),
            mass: Some(evil.to_owned()),
            verdict: Verdict::Repeat,
        };
        let content = Content {
            title: evil.to_owned(),
            subtitle: evil.to_owned(),
            footer: evil.to_owned(),
            parts: vec![
                Part::Headline(headline),
                Part::Heading(evil.to_owned()),
                Part::Subheading(evil.to_owned()),
                Part::Text(evil.to_owned()),
                Part::List(vec![evil.to_owned()]),
                Part::Table(table),
                Part::Bars(bars),
            ],
        };
        let page = html(&content);
        assert!(!page.contains("<script") && !page.contains("\" onload"));
        assert_eq!(page.matches("&lt;script&gt;").count(), 14);
    }
}
