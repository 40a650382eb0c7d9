//! Sheets of markers as another program rasterises them.

use std::io::Write;
use std::process::Command;
use stockpilot::camera::picture::{GreyPicture, read_picture};
use stockpilot::camera::tag_finder::{Settings, TagFinder};
use stockpilot::markers::{Paper, PrintJob};
use stockpilot::messages::TagFamily;

const DPI: f64 = 300.0;

/// The pages as poppler draws them; `None` where it is not installed, which no CI may miss.
fn rasterised(job: &PrintJob) -> Option<Vec<GreyPicture>> {
    let folder = tempfile::tempdir().unwrap();
    let pdf = folder.path().join("sheets.pdf");
    std::fs::write(&pdf, job.pdf().unwrap()).unwrap();
    let run = Command::new("pdftoppm")
        .args(["-gray", "-r", "300"])
        .args([&pdf, &folder.path().join("page")])
        .status();
    let Ok(status) = run else {
        assert!(
            std::env::var_os("CI").is_none(),
            "pdftoppm is missing: apt-get install poppler-utils"
        );
        // Straight to the standard error: what a test prints is shown only if it fails.
        let told = writeln!(std::io::stderr(), "SKIPPED: pdftoppm (poppler-utils) is not here");
        told.unwrap();
        return None;
    };
    assert!(status.success());
    let mut pages: Vec<_> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "pgm"))
        .collect();
    pages.sort();
    let read = |path| read_picture(&std::fs::read(path).unwrap()).unwrap().picture;
    Some(pages.into_iter().map(read).collect())
}

fn job(scale: [f64; 2]) -> PrintJob {
    PrintJob {
        family: TagFamily::Tag36h11,
        ids: vec![3, 586],
        paper: Paper::named("A4").unwrap(),
        edge_mm: 120.0,
        scale,
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few thousand")]
fn whole(px: f64) -> usize {
    px.round() as usize
}

fn px(mm: f64) -> f64 {
    mm / 25.4 * DPI
}

#[test]
fn a_printed_tag_is_read_and_has_its_true_size() {
    for scale in [[1.0, 1.0], [1.01, 0.99]] {
        let job = job(scale);
        let Some(pages) = rasterised(&job) else { return };
        assert_eq!(pages.len(), 2);
        let mut finder =
            TagFinder::new(&Settings { decimation: 2.0, ..Settings::default() }).unwrap();
        for (page, id) in pages.iter().zip(&job.ids) {
            let found = finder.find(page).unwrap().tags;
            assert_eq!(found.iter().map(|tag| tag.id).collect::<Vec<_>>(), [*id]);
            let [left, top] = job.corner_mm();
            let (right, bottom) = (left + job.edge_mm, top + job.edge_mm);
            let expected = [[left, bottom], [right, bottom], [right, top], [left, top]];
            let middle = [0.5 * job.paper.width_mm, 0.5 * job.paper.height_mm];
            for (seen, drawn) in found[0].corners_px.iter().zip(expected) {
                for axis in 0..2 {
                    let mm = middle[axis] + (drawn[axis] - middle[axis]) * scale[axis];
                    // A pixel of 300 dpi is 0.08 mm: poppler paints every pixel that is touched.
                    assert!((seen[axis] - px(mm)).abs() < 1.0, "{axis}: {} {}", seen[axis], px(mm));
                }
            }
        }
    }
}

/// The dark ticks at both ends of a ruler, looked for along a line that only long ticks cross.
#[test]
fn both_rulers_are_200_mm_long() {
    let Some(pages) = rasterised(&job([1.0; 2])) else { return };
    let page = &pages[0];
    let width = page.width_px() as usize;
    let at = |x_mm: f64, y_mm: f64| {
        let (col, row) = (whole(px(x_mm)), whole(px(y_mm)));
        page.pixels()[row * width + col]
    };
    // The horizontal ruler begins 5 mm from the left edge, 282 mm below the upper one; its end ticks are 7 mm long,
    // all others at most 4 mm.
    let dark = |along: &dyn Fn(f64) -> u8| -> Vec<f64> {
        (0..2970).map(|k| f64::from(k) / 10.0).filter(|mm| along(*mm) < 128).collect()
    };
    let level = 297.0 - 5.0 - 10.0 + 5.5;
    let horizontal = dark(&|mm| if mm < 209.0 { at(mm, level) } else { 255 });
    let vertical = dark(&|mm| if mm < 260.0 { at(5.0 + 4.0 + 5.5, mm) } else { 255 });
    for ticks in [horizontal, vertical] {
        let length = ticks.last().unwrap() - ticks[0];
        assert!((length - 200.0).abs() < 0.25, "{length} mm: {ticks:?}");
    }
}
