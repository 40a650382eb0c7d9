use super::*;
use crate::config::load;

const EXAMPLE: &str = include_str!("../../../deploy/config.example.toml");
const FILE: &str = "[[tags]]
family = \"36h11\"
id = 20
corners_m = [[22.0, 8.25, 2.0], [22.0, 7.75, 2.0], [22.0, 7.75, 2.5], [22.0, 8.25, 2.5]]

[[points]]
id = 4
place_m = [21.0, 3.0, 6.5]
";
const LAYOUT: &str = r#"{"tags": [{"ID": 30, "pose": {"translation": {"x": 21.0, "y": 4.0, "z": 3.0},
    "rotation": {"quaternion": {"W": 0.0, "X": 0.0, "Y": 0.0, "Z": 1.0}}}}]}"#;

/// A folder with the example, its `[markers]` extended, and the files beside it.
fn folder(markers: &str, files: &[(&str, &str)]) -> tempfile::TempDir {
    let directory = tempfile::tempdir().unwrap();
    let text = EXAMPLE.replace("[markers]\n", &format!("[markers]\n{markers}\n"));
    std::fs::write(directory.path().join("hall.toml"), text).unwrap();
    for (name, contents) in files {
        std::fs::write(directory.path().join(name), contents).unwrap();
    }
    directory
}

fn loaded(markers: &str, files: &[(&str, &str)]) -> Result<Config, ConfigError> {
    load(&folder(markers, files).path().join("hall.toml"), &[])
}

const BOTH: &str = "file = \"markers.toml\"
field_layout = \"layout.json\"
field_layout_edge_m = 0.4
field_layout_family = \"16h5\"";

#[test]
fn the_effective_configuration_holds_what_stood_in_the_files() {
    let config = loaded(BOTH, &[("markers.toml", FILE), ("layout.json", LAYOUT)]).unwrap();
    let map = config.marker_map().unwrap();
    assert!((map.place_sigma_m() - 0.005).abs() < 1e-15, "surface.uncertainty.marker_sigma_m");
    assert_eq!(map.len(), 4, "two of the example, one of each file");
    assert!(map.corners(TagFamily::Tag36h11, 20).is_some());
    // It looks along −x, so right for the onlooker is −y.
    let low_left = map.corners(TagFamily::Tag16h5, 30).unwrap()[0];
    assert!((low_left - Point::new(21.0, 4.2, 2.8)).coords.norm() < 1e-12);
    assert_eq!(map.point(4), Some(Point::new(21.0, 3.0, 6.5)));
    // A log needs no other file.
    let printed = config.to_toml().unwrap();
    let again = Config::from_toml(&printed, Path::new("log")).unwrap();
    assert_eq!(again, config);
    assert_eq!(again.marker_map().unwrap(), map);
}

#[test]
fn a_file_may_hold_all_tags() {
    let text = &EXAMPLE[..EXAMPLE.find("\n[[tags]]").unwrap()];
    let directory = folder("", &[("markers.toml", FILE)]);
    let text = text.replace("[markers]\n", "[markers]\nfile = \"markers.toml\"\n");
    let path = directory.path().join("hall.toml");
    std::fs::write(&path, &text).unwrap();
    assert_eq!(load(&path, &[]).unwrap().marker_map().unwrap().len(), 1);
    std::fs::write(&path, text.replace("file = \"markers.toml\"", "")).unwrap();
    let error = load(&path, &[]).unwrap().marker_map().unwrap_err().to_string();
    assert!(error.contains("without tags"), "{error}");
}

#[test]
fn each_fault_names_file_tag_and_reason() {
    let refusal = |file: &str, layout: &str| {
        let result = loaded(BOTH, &[("markers.toml", file), ("layout.json", layout)]);
        result.unwrap_err().to_string()
    };
    let twice = refusal(&format!("{FILE}{}", FILE.replace("id = 4", "id = 5")), LAYOUT);
    assert!(twice.contains("markers.toml") && twice.contains("tag 36h11 20"), "{twice}");
    let bent = refusal(&FILE.replace("[22.0, 7.75, 2.5]", "[22.0, 7.75, 2.6]"), LAYOUT);
    assert!(bent.contains("markers.toml") && bent.contains("36h11 20 is not a square"), "{bent}");
    let broken = refusal(&FILE.replace("[22.0, 7.75, 2.5]", "[nan, 7.75, 2.5]"), LAYOUT);
    assert!(broken.contains("tag 36h11 20 has a corner that is not a number"), "{broken}");
    let family = refusal(&FILE.replace("36h11", "36h12"), LAYOUT);
    assert!(family.contains("markers.toml") && family.contains("tag 20"), "{family}");
    let key = refusal(&FILE.replace("place_m", "place"), LAYOUT);
    assert!(key.contains("markers.toml") && key.contains("line"), "{key}");
    let layout = refusal(FILE, &LAYOUT.replace("\"Z\": 1.0", "\"Z\": 1.1"));
    assert!(layout.contains("layout.json") && layout.contains("tag 30"), "{layout}");
    let absent = loaded(BOTH, &[("layout.json", LAYOUT)]).unwrap_err().to_string();
    assert!(absent.starts_with("cannot read") && absent.contains("markers.toml"), "{absent}");
}

#[test]
fn a_layout_needs_size_and_family() {
    for (key, rest) in [
        ("field_layout_edge_m", "field_layout_family = \"36h11\""),
        ("field_layout_family", "field_layout_edge_m = 0.2"),
    ] {
        let markers = format!("field_layout = \"layout.json\"\n{rest}");
        let error = loaded(&markers, &[("layout.json", LAYOUT)]).unwrap_err().to_string();
        assert!(error.contains(key) && error.contains("is missing"), "{error}");
    }
    let markers = BOTH.replace("0.4", "16.51");
    let files = [("markers.toml", FILE), ("layout.json", LAYOUT)];
    let error = loaded(&markers, &files).unwrap_err().to_string();
    assert!(error.starts_with("markers.field_layout_edge_m = 16.51 m is outside"), "{error}");
}

#[test]
fn tags_of_two_files_may_not_share_a_name() {
    let file = FILE.replace("id = 20", "id = 1");
    let config = loaded("file = \"markers.toml\"", &[("markers.toml", &file)]).unwrap();
    let error = config.marker_map().unwrap_err().to_string();
    assert_eq!(error, "markers: tag 36h11 1 stands in the map twice");
}

#[test]
fn a_mirrored_tag_is_refused_unless_it_is_meant() {
    let mirrored = FILE.replace(
        "[[22.0, 8.25, 2.0], [22.0, 7.75, 2.0], [22.0, 7.75, 2.5], [22.0, 8.25, 2.5]]",
        "[[22.0, 7.75, 2.0], [22.0, 8.25, 2.0], [22.0, 8.25, 2.5], [22.0, 7.75, 2.5]]",
    );
    assert_ne!(mirrored, FILE);
    let map = |file: &str| {
        loaded("file = \"markers.toml\"", &[("markers.toml", file)]).unwrap().marker_map()
    };
    let error = map(&mirrored).unwrap_err().to_string();
    assert!(error.contains("tag 36h11 20 turns its back"), "{error}");
    map(&mirrored.replace("id = 20", "id = 20\nfaces_away = true")).unwrap();
}

#[test]
fn files_that_nobody_has_read_are_no_map() {
    let text = EXAMPLE.replace("[markers]\n", &format!("[markers]\n{BOTH}\n"));
    let config = Config::from_toml(&text, Path::new("hall.toml")).unwrap();
    assert!(config.marker_map().unwrap_err().to_string().starts_with("markers:"));
}
