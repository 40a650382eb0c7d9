//! SVG pictures as drawings of a page: paths and texts as outlines, in plain colours. What the figures
//! of this project do not use (gradients, patterns, masks, bitmaps) is left out.

use super::{Ink, PdfError};
use krilla::geom::{Path, PathBuilder, Transform};
use krilla::num::NormalizedF32;
use krilla::paint::{Fill, FillRule, LineCap, LineJoin, Stroke, StrokeDash};
use krilla::surface::Surface;
use resvg::tiny_skia::PathSegment;
use resvg::usvg::{self, Group, Node, Options, Tree, fontdb};
use std::sync::{Arc, OnceLock};

/// The typeface of texts in pictures.
const FONT: &[u8] = include_bytes!("font/Inter-Regular.otf");
const FAMILY: &str = "Inter";

/// Reads a picture.
pub(super) fn tree(svg: &str) -> Result<Tree, PdfError> {
    Tree::from_str(svg, &options()).map_err(|error| PdfError::Picture(error.to_string()))
}

fn options() -> Options<'static> {
    static FONTS: OnceLock<Arc<fontdb::Database>> = OnceLock::new();
    let fonts = FONTS.get_or_init(|| {
        let mut fonts = fontdb::Database::new();
        fonts.load_font_data(FONT.to_vec());
        fonts.set_sans_serif_family(FAMILY);
        Arc::new(fonts)
    });
    Options { font_family: FAMILY.to_owned(), fontdb: Arc::clone(fonts), ..Options::default() }
}

/// Draws a group and all that is in it.
pub(super) fn draw(surface: &mut Surface<'_>, group: &Group) {
    surface.push_transform(&transform(group.transform()));
    let opacity = group.opacity().get();
    if opacity < 1.0 {
        surface.push_opacity(share(opacity));
    }
    for node in group.children() {
        match node {
            Node::Group(inner) => draw(surface, inner),
            Node::Path(path) if path.is_visible() => draw_path(surface, path),
            Node::Text(text) => draw(surface, text.flattened()),
            Node::Path(_) | Node::Image(_) => {}
        }
    }
    if opacity < 1.0 {
        surface.pop();
    }
    surface.pop();
}

fn draw_path(surface: &mut Surface<'_>, path: &usvg::Path) {
    let Some(outline) = outline(path.data().segments()) else { return };
    surface.set_fill(path.fill().and_then(|fill| {
        Some(Fill {
            paint: ink(fill.paint())?.paint().into(),
            opacity: share(fill.opacity().get()),
            rule: match fill.rule() {
                usvg::FillRule::NonZero => FillRule::NonZero,
                usvg::FillRule::EvenOdd => FillRule::EvenOdd,
            },
        })
    }));
    surface.set_stroke(path.stroke().and_then(|stroke| {
        Some(Stroke {
            paint: ink(stroke.paint())?.paint().into(),
            width: stroke.width().get(),
            miter_limit: stroke.miterlimit().get(),
            line_cap: match stroke.linecap() {
                usvg::LineCap::Butt => LineCap::Butt,
                usvg::LineCap::Round => LineCap::Round,
                usvg::LineCap::Square => LineCap::Square,
            },
            line_join: match stroke.linejoin() {
                usvg::LineJoin::Round => LineJoin::Round,
                usvg::LineJoin::Bevel => LineJoin::Bevel,
                usvg::LineJoin::Miter | usvg::LineJoin::MiterClip => LineJoin::Miter,
            },
            opacity: share(stroke.opacity().get()),
            dash: stroke
                .dasharray()
                .map(|array| StrokeDash { array: array.to_vec(), offset: stroke.dashoffset() }),
        })
    }));
    surface.draw_path(&outline);
}

fn outline(segments: impl Iterator<Item = PathSegment>) -> Option<Path> {
    let mut path = PathBuilder::new();
    for segment in segments {
        match segment {
            PathSegment::MoveTo(p) => path.move_to(p.x, p.y),
            PathSegment::LineTo(p) => path.line_to(p.x, p.y),
            PathSegment::QuadTo(a, p) => path.quad_to(a.x, a.y, p.x, p.y),
            PathSegment::CubicTo(a, b, p) => path.cubic_to(a.x, a.y, b.x, b.y, p.x, p.y),
            PathSegment::Close => path.close(),
        }
    }
    path.finish()
}

const fn ink(paint: &usvg::Paint) -> Option<Ink> {
    match paint {
        usvg::Paint::Color(color) => Some(Ink(color.red, color.green, color.blue)),
        usvg::Paint::LinearGradient(_)
        | usvg::Paint::RadialGradient(_)
        | usvg::Paint::Pattern(_) => None,
    }
}

fn share(value: f32) -> NormalizedF32 {
    NormalizedF32::new(value).unwrap_or(NormalizedF32::ONE)
}

fn transform(t: usvg::Transform) -> Transform {
    Transform::from_row(t.sx, t.ky, t.kx, t.sy, t.tx, t.ty)
}
