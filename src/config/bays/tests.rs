use super::*;
use crate::config::load;
use crate::messages::GridGeometry;

const EXAMPLE: &str = include_str!("../../../deploy/config.example.toml");

/// The example with its commented bays made real.
fn example_with_bays() -> String {
    let (shown, commented) = EXAMPLE.split_once("# [[bays]]").expect("the example shows bays");
    let commented = commented.replace("\n# ", "\n");
    format!("{shown}[[bays]]{commented}")
}

/// A folder with the example, its bays and the grids that they name.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let grid = GridGeometry { x_min_m: 14.0, y_min_m: -1.0, cell_m: 0.5, n_cols: 13, n_rows: 23 };
    let values = |value| ascii_grid::write(&grid, &vec![value; grid.n_cells()]);
    for (name, text) in [
        ("hall.toml", example_with_bays()),
        ("floor.asc", values(0.125)),
        ("floor-sigma.asc", values(0.02)),
    ] {
        std::fs::write(folder.path().join(name), text).expect("written");
    }
    folder
}

fn region_of(text: &str) -> Result<Region, ConfigError> {
    Config::from_toml(text, Path::new("hall.toml"))?.region(0.25)
}

/// The example with one bay or exclusion of this text.
fn with(section: &str) -> Result<Region, ConfigError> {
    region_of(&format!("{EXAMPLE}\n{section}"))
}

fn refusal(section: &str) -> String {
    with(section).expect_err(section).to_string()
}

#[test]
fn the_commented_bays_of_the_example_are_valid_and_survive_printing() {
    let folder = folder();
    let config = load(&folder.path().join("hall.toml"), &[]).expect("valid");
    let region = config.region(0.25).expect("fits");
    assert_eq!((region.bays.len(), region.exclusions.len()), (4, 2));
    let heights: Vec<f64> = region.bays.iter().map(|bay| bay.base.height_m(16.0, 10.0)).collect();
    // Level; plane 0.05 + 0.01 · 0; survey; a point on the edge between 0.02 and 0.
    for (ours, expected) in heights.iter().zip([0.0, 0.05, 0.125, 0.016]) {
        assert!((ours - expected).abs() < 1e-12, "{heights:?}");
    }
    let density = region.bays[0].density.expect("gravel has one");
    assert!((density.mass(100.0, 0.0).sigma_t - 3.0).abs() < 1e-12);

    // A log keeps this text and nothing else.
    let printed = config.to_toml().expect("printable");
    assert_eq!(region_of(&printed).expect("valid without its files"), region);
}

#[test]
fn a_missing_file_is_named_with_its_folder() {
    let folder = folder();
    std::fs::remove_file(folder.path().join("floor.asc")).expect("there");
    let error = load(&folder.path().join("hall.toml"), &[]).unwrap_err().to_string();
    let path = folder.path().join("floor.asc");
    assert!(error.contains(&path.display().to_string()), "{error}");
}

#[test]
fn broken_and_foreign_grids_are_refused() {
    let folder = folder();
    let refused = |name: &str, text: &str| {
        let path = folder.path().join(name);
        let before = std::fs::read_to_string(&path).expect("there");
        std::fs::write(&path, text).expect("written");
        let config = load(&folder.path().join("hall.toml"), &[]).expect("read");
        std::fs::write(&path, before).expect("written");
        config.region(0.25).unwrap_err().to_string()
    };
    let error = refused("floor.asc", "ncols 3\n");
    assert!(error.contains("bays[2].base.height_file") && error.contains("cellsize"), "{error}");
    let small = GridGeometry { x_min_m: 15.0, y_min_m: 0.0, cell_m: 0.5, n_cols: 9, n_rows: 20 };
    let error = refused("floor-sigma.asc", &ascii_grid::write(&small, &[0.01; 180]));
    assert!(error.contains("not that of the heights"), "{error}");
}

#[test]
fn without_bays_the_whole_region_is_one_with_the_hall_s_sigma() {
    let region = region_of(EXAMPLE).expect("valid");
    let bay = &region.bays[0];
    assert_eq!((region.bays.len(), bay.name.as_str()), (1, WHOLE_REGION));
    assert_eq!(bay.base, BaseSurface::Level { height_m: 0.0, sigma_m: 0.01 });
    assert!((bay.outline.area_m2() - 400.0).abs() < 1e-9);
}

#[test]
fn polygons_that_are_none_are_refused_with_the_reason() {
    let error = refusal("[[bays]]\nname = \"A\"\npolygon_m = [[0, 0], [9, 9], [9, 0], [0, 9]]");
    assert!(error.starts_with("bays[0].polygon_m: the polygon crosses"), "{error}");
    let error = refusal("[[bays]]\nname = \"A\"\npolygon_m = [[0, 0], [9, 9], [nan, 0]]");
    assert!(error.contains("bays[0].polygon_m = NaN m"), "{error}");
    let error = refusal("[[exclusions]]\npolygon_m = [[0, 0], [9, 9]]");
    assert!(error.contains("exclusions[0].polygon_m") && error.contains("3 corners"), "{error}");
    assert!(refusal("[[exclusions]]").contains("either rect or polygon_m"));
}

#[test]
fn bays_that_do_not_fit_are_refused_with_the_area() {
    let square = |name: &str, x: f64| {
        let right = x + 6.0;
        format!(
            "[[bays]]\nname = \"{name}\"\n\
             polygon_m = [[{x}, 0.0], [{right}, 0.0], [{right}, 5.0], [{x}, 5.0]]\n"
        )
    };
    assert!(with(&(square("A", 0.0) + &square("B", 6.0))).is_ok());
    let error = refusal(&(square("A", 0.0) + &square("B", 5.5)));
    assert_eq!(error, "bays: bays \"A\" and \"B\" overlap by 2.500 m²");
    assert!(refusal(&(square("A", 0.0) + &square("A", 6.0))).contains("called \"A\""));
    assert!(refusal(&square("A", 15.0)).contains("out of the region by 5.000 m²"));
}

#[test]
fn bases_and_densities_that_are_none_are_refused() {
    let bay = "[[bays]]\nname = \"A\"\npolygon_m = [[0, 0], [9, 0], [9, 9]]\n";
    let refused = |rest: &str| refusal(&format!("{bay}{rest}"));
    let error = refused("base = { kind = \"bowl\", height_m = 1.0 }");
    assert!(error.contains("bowl") && error.contains("triangulated"), "{error}");
    let error = refused("base = { kind = \"level\", height_m = 1.0, depth_m = 2.0 }");
    assert!(error.contains("depth_m"), "{error}");
    let error = refused("base = { kind = \"level\", height_m = 1.0, sigma_m = -0.01 }");
    assert!(error.contains("bays[0].base.sigma_m = -0.01"), "{error}");
    let error = refused("base = { kind = \"triangulated\", points_m = [[0, 0, 0], [1, 1, 0]] }");
    assert!(error.contains("2 points span no triangle"), "{error}");
    let error = refused("base = { kind = \"survey\", height_file = \"floor.asc\" }");
    assert!(error.contains("not read yet"), "{error}");
    assert!(refused("density_sigma_t_per_m3 = 0.1").contains("no density_t_per_m3"));
    for word in ["density_source = \"drum\"", "density_date = \"2026-03-01\"", "moisture = \"4 %\""]
    {
        assert!(refused(word).contains("no density_t_per_m3"), "{word}");
    }
    let dated = |date: &str| format!("density_t_per_m3 = 1.6\ndensity_date = \"{date}\"");
    assert!(with(&format!("{bay}{}", dated("2026-02-28"))).is_ok());
    for date in ["2026-02-30", "28.2.2026", ""] {
        assert!(refused(&dated(date)).contains("bays[0].density_date"), "{date}");
    }
    assert!(refused("material = \" \"").contains("bays[0].material"));
    assert!(refused("density_t_per_m3 = 0.0").contains("outside 0.01 to 25 t/m³"));
}

#[test]
fn a_hall_without_bays_has_tonnes_of_its_own() {
    let heap = "density_t_per_m3 = 1.6\ndensity_sigma_t_per_m3 = 0.05\n[link]";
    let text = EXAMPLE.replacen("[link]", heap, 1);
    let bay = "[[bays]]\nname = \"A\"\npolygon_m = [[0, 0], [9, 0], [9, 9]]\n";
    let config = Config::from_toml(&text, Path::new("hall.toml")).expect("valid");
    let region = config.measured_region().expect("a region");
    let mass = region.bays[0].density.expect("the hall's").mass(100.0, 0.0);
    // 100 m³ · 1.6 t/m³, and 100 · 0.05
    assert!((mass.mass_t - 160.0).abs() < 1e-9 && (mass.sigma_t - 5.0).abs() < 1e-9, "{mass:?}");
    let measured = region.whole_and_bays_on(&region.grid(0.25), &BaseSurface::level(0.0));
    assert_eq!((measured.len(), measured[0].density), (1, region.bays[0].density));
    let refused = |text: &str| {
        let config = Config::from_toml(text, Path::new("hall.toml")).expect("parses");
        config.measured_region().unwrap_err().to_string()
    };
    let error = refused(&format!("{text}\n{bay}"));
    assert!(error.contains("hall.density_t_per_m3") && error.contains("without bays"), "{error}");
    let error = refused(&text.replacen("\ndensity_t_per_m3 = 1.6\n", "\n", 1));
    assert!(error.contains("hall.density_sigma_t_per_m3"), "{error}");
}

#[test]
fn the_hall_may_have_any_base() {
    let plane = "base = { kind = \"plane\", pivot_m = [0, 0], height_m = 0.1, slope = [0.01, 0] }";
    let text = EXAMPLE.replace("base_height_m = 0.0", plane);
    let region = region_of(&text).expect("valid");
    assert!((region.bays[0].base.height_m(10.0, 3.0) - 0.2).abs() < 1e-12);
    let twice = EXAMPLE.replace("base_height_m = 0.0", &format!("base_height_m = 0.5\n{plane}"));
    assert!(region_of(&twice).unwrap_err().to_string().contains("give one of them"));
}
