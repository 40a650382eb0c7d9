use super::*;
use std::collections::BTreeSet;

fn hills() -> HeatMap {
    let n = 24_usize;
    let values = (0..n * n)
        .map(|k| {
            let (x, y) = ((k % n) as f64 / 6.0, (k / n) as f64 / 6.0);
            if k % 37 == 5 { f64::NAN } else { x.sin() * y.cos() + 0.3 * x }
        })
        .collect();
    HeatMap {
        title: "Height, 2σ < 3 m & \"quoted\"".to_owned(),
        grid: Lattice { x_min_m: -2.0, y_min_m: 1.0, cell_m: 0.5, n_cols: n, values },
        quantity: "height over the floor (m)".to_owned(),
        range: None,
        is_signed: false,
        overlays: vec![
            Overlay::new(
                "flown path",
                Shape::Path,
                Ink::Red,
                vec![[-3.2, 1.5], [1.0, 2.0], [6.0, 9.0]],
            ),
            Overlay::new("waypoint", Shape::Dots, Ink::White, vec![[1.0, 2.0], [6.0, 9.0]]),
            Overlay::new(
                "column",
                Shape::Outline,
                Ink::Black,
                vec![[3.0, 3.0], [4.0, 3.0], [4.0, 4.0], [3.0, 4.0]],
            ),
            Overlay::new("marker", Shape::Triangles, Ink::Orange, vec![[9.0, 4.0]]),
            Overlay::new("lost", Shape::Crosses, Ink::Purple, vec![[9.0, 6.0]]),
        ],
    }
}

fn curves() -> LineChart {
    let points =
        |scale: f64| (0..40).map(|k| [f64::from(k), scale / (1.0 + f64::from(k))]).collect();
    LineChart {
        title: "Volume against samples".to_owned(),
        x: Axis::linear("samples (1000)"),
        y: Axis::linear("volume (m³)"),
        bands: vec![Band {
            label: "greedy ± 2σ".to_owned(),
            ink: Ink::Blue,
            borders: vec![[0.0, -10.0, 10.0], [39.0, -1.0, 1.0]],
        }],
        series: vec![
            Series {
                label: "greedy".to_owned(),
                ink: Ink::Blue,
                stroke: Stroke::Full,
                points: points(100.0),
            },
            Series {
                label: "square wave, published".to_owned(),
                ink: Ink::Red,
                stroke: Stroke::Dashed,
                points: points(70.0),
            },
            Series {
                label: "truth".to_owned(),
                ink: Ink::Black,
                stroke: Stroke::Dots,
                points: vec![[3.0, 40.0], [20.0, f64::NAN], [30.0, 60.0]],
            },
        ],
    }
}

/// The numbers of a CSV: what the columns after the first `skip` hold.
fn read_csv(text: &str, skip: usize) -> Vec<Vec<f64>> {
    let number = |field: &str| if field.is_empty() { f64::NAN } else { field.parse().unwrap() };
    text.lines().skip(1).map(|line| line.split(',').skip(skip).map(number).collect()).collect()
}

#[test]
fn the_csv_of_a_map_holds_every_drawn_cell_at_its_place() {
    let map = hills();
    let tables = map.tables();
    assert_eq!(tables[0].columns, ["x (m)", "y (m)", "height over the floor (m)"]);
    let rows = read_csv(&tables[0].csv(), 0);
    assert_eq!(rows.len(), 24 * 24);
    // The second row's third cell: x = −2 + 2.5 · 0.5, y = 1 + 1.5 · 0.5.
    assert_eq!(rows[26][..2], [-0.75, 1.75]);
    for (row, value) in rows.iter().zip(&map.grid.values) {
        assert!(row[2].to_bits() == value.to_bits() || row[2].is_nan() && value.is_nan());
    }
    let over = read_csv(&tables[1].csv(), 1);
    assert_eq!(over.len(), 3 + 2 + 4 + 1 + 1);
    assert_eq!(over[2], [6.0, 9.0]);
}

#[test]
fn the_cells_on_the_picture_are_those_of_the_data() {
    // Four cells with values at the ends and at the anchors of the colours between.
    let map = HeatMap {
        title: "four".to_owned(),
        grid: Lattice {
            x_min_m: 0.0,
            y_min_m: 0.0,
            cell_m: 1.0,
            n_cols: 2,
            values: vec![0.0, 7.0, f64::NAN, 7.0],
        },
        quantity: "n".to_owned(),
        range: None,
        is_signed: false,
        overlays: Vec::new(),
    };
    let svg = map.svg().unwrap();
    // The map's corner is at (64, 42), its side 460: the lower left cell is darkest, the right
    // column brightest, the upper left one grey.
    for (x, y, colour) in [(64, 272, "440154"), (294, 272, "FEE825"), (64, 42, "DEDEDE")] {
        let cell = format!(
            "<rect x=\"{x}\" y=\"{y}\" width=\"230\" height=\"230\" opacity=\"1\" fill=\"#{colour}\""
        );
        assert!(svg.contains(&cell), "{cell} is missing");
    }
}

#[test]
fn a_map_with_signs_is_light_at_zero_and_even_to_both_sides() {
    let map = HeatMap {
        title: "change".to_owned(),
        grid: Lattice {
            x_min_m: 0.0,
            y_min_m: 0.0,
            cell_m: 1.0,
            n_cols: 2,
            values: vec![-4.0, 1.0, f64::NAN, -4.0],
        },
        quantity: "n".to_owned(),
        range: None,
        is_signed: true,
        overlays: Vec::new(),
    };
    let svg = map.svg().unwrap();
    // The bar reaches from -4 to 4: -4 is the darkest orange, +1 a quarter of the way to purple.
    let cells = svg.lines().filter(|line| line.contains("width=\"230\""));
    let fills: Vec<&str> = cells.filter_map(|line| line.split("fill=\"#").nth(1)).collect();
    assert!(fills.iter().any(|fill| fill.starts_with("B35806")), "{fills:?}");
    // Between F7F7F7 and D8DAEB, the first stop above the middle.
    let above = fills.iter().find(|fill| fill[..2] > *"D8" && fill[4..6] > *"EA").unwrap();
    assert!(fills.len() >= 3 && above[..2] < *"F8", "{fills:?}");
}

#[test]
fn the_csv_of_a_chart_holds_curves_and_bands() {
    let chart = curves();
    let text = chart.tables()[0].csv();
    assert!(text.starts_with("series,samples (1000),volume (m³)\n"));
    let labels: BTreeSet<&str> =
        text.lines().skip(1).filter_map(|l| l.rsplitn(3, ',').nth(2)).collect();
    assert_eq!(labels.len(), 5, "{labels:?}");
    assert!(text.contains("\ngreedy ± 2σ: high,39,1\n"));
    assert!(text.contains("\n\"square wave, published\",1,35\n"));
    assert!(text.contains("\ntruth,20,\n"), "what is not a number stays empty");
}

#[test]
fn a_picture_has_the_size_it_says_and_its_texts() {
    for (svg, png) in [
        (hills().svg().unwrap(), hills().png().unwrap()),
        (curves().svg().unwrap(), curves().png().unwrap()),
    ] {
        let number = |name: &str| {
            let rest = svg.split_once(&format!(" {name}=\"")).unwrap().1;
            rest.split_once('"').unwrap().0.parse::<u32>().unwrap()
        };
        // PNG's first chunk: length, IHDR, width, height.
        assert!(png.starts_with(b"\x89PNG\r\n\x1a\n") && &png[12..16] == b"IHDR");
        let sides =
            [&png[16..20], &png[20..24]].map(|bytes| u32::from_be_bytes(bytes.try_into().unwrap()));
        assert_eq!(sides, [2 * number("width"), 2 * number("height")]);
    }
    assert!(hills().svg().unwrap().contains("Height, 2σ &lt; 3 m &amp; &quot;quoted&quot;"));
    assert!(curves().svg().unwrap().contains("samples (1000)"));
}

#[test]
fn the_font_comes_along() {
    let svg = |text: &str| {
        format!(
            "<svg width=\"60\" height=\"20\" xmlns=\"http://www.w3.org/2000/svg\">\
             <text x=\"2\" y=\"15\" font-family=\"sans-serif\" font-size=\"14\">{text}</text></svg>"
        )
    };
    let blank = raster::png(&svg("")).unwrap();
    let pictures: BTreeSet<Vec<u8>> = ["σ", "μ", "³", "−", "±", "·", "x", "√", "χ", "²"]
        .iter()
        .map(|text| raster::png(&svg(text)).unwrap())
        .collect();
    // A sign that the font lacks would be drawn as nothing, or as the same box as another.
    assert_eq!(pictures.len(), 10);
    assert!(!pictures.contains(&blank));
}

#[test]
fn contradictions_are_refused() {
    let mut map = hills();
    map.grid.values.pop();
    assert!(matches!(map.svg(), Err(FigureError::BadData { .. })));
    let mut map = hills();
    map.overlays[0].points_m[1][0] = f64::NAN;
    assert!(matches!(map.svg(), Err(FigureError::BadData { .. })));
    let mut chart = curves();
    chart.y.range = Some([2.0, 1.0]);
    assert!(matches!(chart.svg(), Err(FigureError::BadData { .. })));
    let mut chart = curves();
    chart.x = Axis { range: Some([0.0, 1.0]), ..Axis::log("n") };
    assert!(matches!(chart.svg(), Err(FigureError::BadData { .. })));
}

#[test]
fn a_picture_without_known_values_is_still_a_picture() {
    let mut map = hills();
    map.grid.values.fill(f64::NAN);
    map.png().unwrap();
    let mut chart = curves();
    chart.series.clear();
    chart.bands.clear();
    chart.png().unwrap();
    chart.y = Axis::log("σ (m³)");
    chart.png().unwrap();
}

#[test]
fn a_sheet_is_written_with_all_of_its_tables() {
    let folder = tempfile::tempdir().unwrap();
    let sheet = Sheet {
        figures: vec![
            ("a".to_owned(), hills()),
            ("b".to_owned(), hills()),
            ("c".to_owned(), hills()),
        ],
        n_cols: 2,
    };
    sheet.write(folder.path(), "hills").unwrap();
    let mut names: Vec<String> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let of = |kind: &str| [format!("hills.{kind}.csv"), format!("hills.{kind}.overlay.csv")];
    let mut expected: Vec<String> = ["a", "b", "c"].iter().flat_map(|kind| of(kind)).collect();
    expected.extend(["hills.png".to_owned(), "hills.svg".to_owned()]);
    assert_eq!(names, expected);
    let one = hills().svg().unwrap();
    let all = std::fs::read_to_string(folder.path().join("hills.svg")).unwrap();
    assert_eq!(all.matches("<text").count(), 3 * one.matches("<text").count());
}

#[test]
fn the_border_of_a_level_runs_between_the_cells() {
    let map = Lattice {
        x_min_m: 10.0,
        y_min_m: 0.0,
        cell_m: 2.0,
        n_cols: 2,
        values: vec![1.0, 5.0, f64::NAN, 0.0],
    };
    // Only the lower right cell is above 3: a border to its left and one above it.
    let expected = [[12.0, 0.0], [12.0, 2.0], [12.0, 2.0], [14.0, 2.0]];
    assert_eq!(map.border_m(3.0), expected);
    assert!(map.border_m(9.0).is_empty());
}
