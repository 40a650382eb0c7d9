//! Several pictures on one sheet.

use super::{Figure, FigureError, Table};

/// Pictures side by side, row by row, each with its own title.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet<F> {
    /// The pictures, each with the kind that its table gets; kinds differ.
    pub figures: Vec<(String, F)>,
    /// How many stand in one row.
    pub n_cols: usize,
}

impl<F: Figure> Figure for Sheet<F> {
    fn svg(&self) -> Result<String, FigureError> {
        let n_cols = self.n_cols.max(1);
        let pictures: Vec<(String, (u32, u32))> = self
            .figures
            .iter()
            .map(|(_, figure)| {
                let svg = figure.svg()?;
                let size = size_of(&svg)
                    .ok_or_else(|| FigureError::Draw("a picture has no size".to_owned()))?;
                Ok((svg, size))
            })
            .collect::<Result<_, FigureError>>()?;
        let mut inside = String::new();
        let (mut width, mut y) = (0, 0);
        for row in pictures.chunks(n_cols) {
            let mut x = 0;
            for (svg, (w, _)) in row {
                // Each picture is an SVG by itself, set at its place.
                let rest = svg.strip_prefix("<svg ").unwrap_or(svg);
                inside.push_str(&format!("<svg x=\"{x}\" y=\"{y}\" {rest}"));
                x += w;
            }
            width = width.max(x);
            y += row.iter().map(|(_, (_, h))| *h).max().unwrap_or(0);
        }
        Ok(format!(
            "<svg width=\"{width}\" height=\"{y}\" viewBox=\"0 0 {width} {y}\" \
             xmlns=\"http://www.w3.org/2000/svg\">\n\
             <rect width=\"{width}\" height=\"{y}\" fill=\"#FFFFFF\"/>\n{inside}</svg>\n"
        ))
    }

    fn tables(&self) -> Vec<Table> {
        let named = |kind: &str, table: Table| {
            let inner =
                if table.kind.is_empty() { String::new() } else { format!(".{}", table.kind) };
            Table { kind: format!("{kind}{inner}"), ..table }
        };
        self.figures
            .iter()
            .flat_map(|(kind, figure)| figure.tables().into_iter().map(move |t| named(kind, t)))
            .collect()
    }
}

/// Width and height as they stand in the head of an SVG of this module.
fn size_of(svg: &str) -> Option<(u32, u32)> {
    let head = svg.get(..svg.find('>')?)?;
    let number = |name: &str| {
        let from = head.find(&format!(" {name}=\""))? + name.len() + 3;
        let rest = head.get(from..)?;
        rest.get(..rest.find('"')?)?.parse().ok()
    };
    Some((number("width")?, number("height")?))
}
