//! The picture of one setting: the mean NEES of each group over time, in its band.

use super::GROUPS;
use super::files::Instant;
use super::summary::SettingReport;
use plotters::prelude::*;

const SIZE_PX: (u32, u32) = (960, 1120);
const INSIDE: RGBColor = RGBColor(225, 235, 245);
const LINE: RGBColor = RGBColor(30, 80, 160);
const EXPECTED: RGBColor = RGBColor(120, 120, 120);

/// An SVG with one panel per group.
///
/// # Errors
/// A series that cannot be drawn.
pub(super) fn svg(
    title: &str,
    report: &SettingReport,
    series: &[Instant],
) -> anyhow::Result<String> {
    let mut picture = String::new();
    {
        let root = SVGBackend::with_string(&mut picture, SIZE_PX).into_drawing_area();
        root.fill(&WHITE)?;
        let root = root.titled(title, ("sans-serif", 22))?;
        let panels = root.split_evenly((GROUPS.len(), 1));
        for (group, (panel, (name, summary))) in
            std::iter::zip(&panels, report.by_name()).enumerate()
        {
            let caption = format!(
                "{name}: mean {:.2}, band over time {:.2} to {:.2}",
                summary.nees_mean, summary.band_low, summary.band_high
            );
            draw(panel, &caption, series, group)?;
        }
        root.present()?;
    }
    Ok(picture)
}

fn draw(
    panel: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    caption: &str,
    series: &[Instant],
    group: usize,
) -> anyhow::Result<()> {
    let expected = GROUPS[group].1;
    let (first_s, last_s) = match series {
        [first, .., last] => (first.at_s, last.at_s),
        _ => (0.0, 1.0),
    };
    let highest = series
        .iter()
        .map(|instant| instant.nees[group].max(instant.bands[group].high))
        .fold(2.0 * expected, f64::max)
        // One wild instant shall not flatten the rest.
        .min(6.0 * expected);
    let mut chart = ChartBuilder::on(panel)
        .caption(caption, ("sans-serif", 16))
        .margin(8)
        .x_label_area_size(26)
        .y_label_area_size(40)
        .build_cartesian_2d(first_s..last_s, 0.0..highest)?;
    let above = series.iter().map(|instant| (instant.at_s, instant.bands[group].high));
    let below = series.iter().rev().map(|instant| (instant.at_s, instant.bands[group].low));
    let band: Vec<(f64, f64)> = above.chain(below).collect();
    chart.draw_series(std::iter::once(Polygon::new(band, INSIDE.filled())))?;
    chart.configure_mesh().disable_mesh().x_desc("s").y_desc("NEES").draw()?;
    chart.draw_series(LineSeries::new([(first_s, expected), (last_s, expected)], EXPECTED))?;
    let mean = series.iter().map(|instant| (instant.at_s, instant.nees[group].min(highest)));
    chart.draw_series(LineSeries::new(mean, LINE))?;
    Ok(())
}
