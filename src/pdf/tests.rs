use super::*;

fn document(draw: impl FnOnce(&mut Page<'_, '_>)) -> Vec<u8> {
    let of = "2026-03-04T05:06:07Z".parse().ok();
    let about = About { title: "Test".to_owned(), subject: "Pages".to_owned(), of };
    let mut document = Document::new(&about).expect("fonts");
    document
        .page::<PdfError>(Size::A4, |page| {
            draw(page);
            Ok(())
        })
        .expect("page");
    document.finish().expect("a PDF/A document")
}

#[test]
fn equal_pages_give_equal_bytes() {
    let draw = |page: &mut Page<'_, '_>| {
        page.text(
            "V = 412.6 m³ ± 5.0 m³",
            [20.0, 30.0],
            Style::semi_bold(12.0, Ink::BLACK),
            Hold::Left,
        );
        page.area([20.0, 40.0], (50.0, 5.0), Ink(0, 114, 178));
    };
    let (one, other) = (document(draw), document(draw));
    assert!(one.starts_with(b"%PDF-1.7"));
    assert_eq!(one, other);
}

/// The archive form refuses glyphs that are missing, so a bay's name in any script must pass.
#[test]
fn letters_that_the_typeface_lacks_are_boxes_and_no_failure() {
    let style = Style::regular(10.0, Ink::BLACK);
    let pdf = document(|page| {
        page.text("塩 salt العربية मُحَمَّد किरण a\u{1ab0} 🏔 Ä Ж σ", [20.0, 30.0], style, Hold::Right);
    });
    assert!(pdf.len() > 1000);
}

/// Columns of numbers stand under each other only if every figure is equally wide.
#[test]
fn figures_have_one_width() {
    let typefaces = Typefaces::load().expect("fonts");
    for face in [Face::Regular, Face::SemiBold] {
        let widths: Vec<f64> =
            ('0'..='9').map(|d| typefaces.width_mm(&d.to_string(), face, 10.0)).collect();
        // The semi-bold four is 3 of 2,816 units narrower: 4 µm on paper.
        assert!(widths.iter().all(|w| (w - widths[0]).abs() < 5e-3), "{face:?}: {widths:?}");
        assert!(widths[0] > 1.0);
    }
}

#[test]
fn lines_keep_to_their_width_and_lose_no_word() {
    let typefaces = Typefaces::load().expect("fonts");
    let text = "Every volume is stated with its expanded uncertainty, k = 2, about 95 %.";
    let lines = typefaces.lines(text, Face::Regular, 9.0, 40.0);
    assert!(lines.len() > 1);
    assert!(lines.iter().all(|line| typefaces.width_mm(line, Face::Regular, 9.0) <= 40.0));
    assert_eq!(lines.join(" "), text);
    // A word that is wider than the line stands alone.
    let long = typefaces.lines("a Donaudampfschifffahrtsgesellschaft b", Face::Regular, 9.0, 5.0);
    assert_eq!(long.len(), 3);
}

#[test]
fn a_picture_keeps_its_shape_in_the_box() {
    let svg = r##"<svg xmlns="http://www.w3.org/2000/svg" width="200" height="100" viewBox="0 0 200 100">
        <rect x="10" y="10" width="50" height="50" fill="#0072B2" opacity="0.5"/>
        <path d="M 10 90 L 190 10" stroke="#D55E00" stroke-dasharray="4 2" fill="none"/>
        <text x="20" y="80" font-family="sans-serif" font-size="12">height (m)</text></svg>"##;
    let mut size = (0.0, 0.0);
    let pdf = document(|page| size = page.picture(svg, [10.0, 10.0], (100.0, 100.0)).expect("svg"));
    assert!((size.0 - 100.0).abs() < 1e-4 && (size.1 - 50.0).abs() < 1e-4, "{size:?}");
    assert!(pdf.len() > 2000);
}

#[test]
fn a_page_without_a_size_and_a_picture_that_is_none_are_refused() {
    let mut empty = Document::new(&About::default()).expect("fonts");
    let nowhere = Size { width_mm: 0.0, height_mm: 297.0 };
    let refused = empty.page::<PdfError>(nowhere, |_| Ok(()));
    assert!(matches!(refused, Err(PdfError::PageSize { .. })));
    let refused = empty.page::<PdfError>(Size::A4, |page| {
        page.picture("no picture", [0.0, 0.0], (10.0, 10.0)).map(|_| ())
    });
    assert!(matches!(refused, Err(PdfError::Picture(_))));
}
