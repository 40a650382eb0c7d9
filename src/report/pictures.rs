//! The pictures of a report.

use super::content::Picture;
use crate::figure::{
    Axis, Band, ClassMap, Figure, FigureError, HeatMap, Ink, Lattice, LineChart, Overlay, Series,
    Shape, Stroke,
};
use crate::mapping::bay::BayOnGrid;
use crate::messages::{CellCoverage, GridGeometry, HeightMap};
use crate::survey::Flight;

/// Cells with a larger σ than this share of all are drawn in the last colour.
const SIGMA_QUANTILE: f64 = 0.98;

/// The surface, its σ, and what it rests on.
pub(super) fn maps(flight: &Flight) -> Result<Vec<Picture>, FigureError> {
    let Some(surface) = &flight.surface else { return Ok(Vec::new()) };
    let counts = flight.counting_cells();
    let over = |with_path| overlays(flight, with_path);
    let height = HeatMap {
        title: "Surface".to_owned(),
        grid: lattice(&surface.grid, masked(&surface.mean_m, &counts)),
        quantity: "height over the hall's zero (m)".to_owned(),
        range: None,
        is_signed: false,
        overlays: over(true),
    };
    let sigma = HeatMap {
        title: "Standard deviation of the surface".to_owned(),
        grid: lattice(&surface.grid, masked(&surface.sigma_m, &counts)),
        quantity: "σ of the height (m)".to_owned(),
        range: quantile(&surface.sigma_m, &counts, SIGMA_QUANTILE).map(|high| [0.0, high]),
        is_signed: false,
        overlays: over(false),
    };
    let mut pictures = vec![
        picture(&height, "Height of the material, with the flown path.")?,
        picture(
            &sigma,
            "How uncertain each cell is by itself, 1σ. Errors that all cells share are in U only.",
        )?,
    ];
    if flight.states.len() == surface.mean_m.len() {
        let states = flight.states.iter().map(|state| f64::from(*state as u8));
        let states: Vec<f64> = states.collect();
        let seen = ClassMap {
            title: "What the surface rests on".to_owned(),
            grid: lattice(&surface.grid, masked(&states, &counts)),
            classes: CLASSES.iter().map(|(label, ink)| ((*label).to_owned(), *ink)).collect(),
            overlays: over(false),
        };
        pictures.push(picture(&seen, "Measured: hit by a beam. Interpolated: near such ground.")?);
    }
    Ok(pictures)
}

/// In the order of [`CellCoverage`].
const CLASSES: [(&str, Ink); 4] = [
    ("measured", Ink::Green),
    ("interpolated", Ink::Sky),
    ("unseen", Ink::Orange),
    ("disturbed", Ink::Red),
];

const _: () =
    assert!(CellCoverage::Disturbed as usize == 3 && CellCoverage::Measured as usize == 0);

/// The change of height since an earlier survey on the same cells; none on others.
pub(super) fn change(flight: &Flight, earlier: &HeightMap) -> Result<Option<Picture>, FigureError> {
    let Some(surface) = flight.surface.as_ref().filter(|s| s.grid == earlier.grid) else {
        return Ok(None);
    };
    let change: Vec<f64> =
        std::iter::zip(&surface.mean_m, &earlier.mean_m).map(|(now, then)| now - then).collect();
    let map = HeatMap {
        title: "Change of height".to_owned(),
        grid: lattice(&surface.grid, masked(&change, &flight.counting_cells())),
        quantity: "later less earlier (m)".to_owned(),
        range: None,
        is_signed: true,
        overlays: overlays(flight, false),
    };
    picture(&map, "Change of height since the earlier survey.").map(Some)
}

/// Two sections through the highest cell, with the base and ±2σ.
pub(super) fn sections(flight: &Flight, bays: &[BayOnGrid]) -> Result<Vec<Picture>, FigureError> {
    let (Some(surface), Some(hall)) = (&flight.surface, bays.first()) else {
        return Ok(Vec::new());
    };
    let counts = flight.counting_cells();
    let height = |cell: &usize| surface.mean_m[*cell];
    let highest = (0..surface.mean_m.len())
        .filter(|cell| counts[*cell])
        .max_by(|a, b| height(a).total_cmp(&height(b)));
    let Some(highest) = highest else { return Ok(Vec::new()) };
    let grid = &surface.grid;
    let (row, col) = (highest / grid.n_cols, highest % grid.n_cols);
    let (x_m, y_m) = grid.centre_m(highest);
    let along_x: Vec<usize> = (0..grid.n_cols).map(|col| grid.index(col, row)).collect();
    let along_y: Vec<usize> = (0..grid.n_rows).map(|row| grid.index(col, row)).collect();
    let draw = |cells: &[usize], axis: usize, title: String| {
        let chart = section(surface, &hall.base.cell_base_m, &counts, cells, axis, title);
        picture(&chart, "Section through the highest cell: surface with ± 2σ, and base.")
    };
    Ok(vec![
        draw(&along_x, 0, format!("Section at y = {y_m:.2} m"))?,
        draw(&along_y, 1, format!("Section at x = {x_m:.2} m"))?,
    ])
}

fn section(
    surface: &HeightMap,
    base_m: &[f64],
    counts: &[bool],
    cells: &[usize],
    axis: usize,
    title: String,
) -> LineChart {
    let place = |cell: usize| {
        let (x_m, y_m) = surface.grid.centre_m(cell);
        [x_m, y_m][axis]
    };
    let known = |cell: usize, value: f64| if counts[cell] { value } else { f64::NAN };
    let line = |of: &dyn Fn(usize) -> f64| {
        cells.iter().map(|&cell| [place(cell), known(cell, of(cell))]).collect()
    };
    let series =
        |label: &str, ink, stroke, points| Series { label: label.to_owned(), ink, stroke, points };
    LineChart {
        title,
        x: Axis::linear(if axis == 0 { "x (m)" } else { "y (m)" }),
        y: Axis::linear("height (m)"),
        bands: vec![Band {
            label: "± 2σ".to_owned(),
            ink: Ink::Blue,
            borders: cells
                .iter()
                .map(|&cell| {
                    let (mean, sigma) = (surface.mean_m[cell], surface.sigma_m[cell]);
                    [place(cell), known(cell, mean - 2.0 * sigma), known(cell, mean + 2.0 * sigma)]
                })
                .collect(),
        }],
        series: vec![
            series("surface", Ink::Blue, Stroke::Full, line(&|cell| surface.mean_m[cell])),
            series("base", Ink::Grey, Stroke::Dashed, line(&|cell| base_m[cell])),
        ],
    }
}

fn picture(figure: &impl Figure, caption: &str) -> Result<Picture, FigureError> {
    Ok(Picture { svg: figure.svg()?, caption: caption.to_owned() })
}

fn masked(values: &[f64], counts: &[bool]) -> Vec<f64> {
    std::iter::zip(values, counts).map(|(v, counts)| if *counts { *v } else { f64::NAN }).collect()
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "a place in a list"
)]
fn quantile(values: &[f64], counts: &[bool], share: f64) -> Option<f64> {
    let mut known: Vec<f64> =
        masked(values, counts).into_iter().filter(|v| v.is_finite()).collect();
    known.sort_by(f64::total_cmp);
    let high = *known.get((share * (known.len().checked_sub(1)?) as f64) as usize)?;
    (high > 0.0).then_some(high)
}

fn lattice(grid: &GridGeometry, values: Vec<f64>) -> Lattice {
    Lattice {
        x_min_m: grid.x_min_m,
        y_min_m: grid.y_min_m,
        cell_m: grid.cell_m,
        n_cols: grid.n_cols,
        values,
    }
}

fn overlays(flight: &Flight, with_path: bool) -> Vec<Overlay> {
    let mut overlays: Vec<Overlay> = flight
        .config
        .bays
        .iter()
        .map(|bay| Overlay::new("bay", Shape::Outline, Ink::White, bay.polygon_m.clone()))
        .collect();
    if with_path && !flight.path_m.is_empty() {
        let path = flight.path_m.iter().map(|[x, y, _]| [*x, *y]).collect();
        overlays.push(Overlay::new("flown path", Shape::Path, Ink::Red, path));
    }
    overlays
}
