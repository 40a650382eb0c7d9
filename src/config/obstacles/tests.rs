use super::*;
use std::path::Path;

const EXAMPLE: &str = include_str!("../../../deploy/config.example.toml");

/// The example with something more at its end, loaded from a folder with these files.
fn loaded(more: &str, files: &[(&str, &[u8])]) -> Result<Config, ConfigError> {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).expect("written");
    }
    let path = folder.path().join("hall.toml");
    std::fs::write(&path, format!("{EXAMPLE}\n{more}")).expect("written");
    crate::config::load(&path, &[])
}

fn refusal(more: &str, files: &[(&str, &[u8])]) -> String {
    let refused = loaded(more, files).and_then(|config| config.pilot_settings().map(|_| ()));
    refused.expect_err("refused").to_string()
}

/// A tetrahedron with corners 0, 1000 x, 1000 y, 1000 z.
const OBJ: &str =
    "v 0 0 0\nv 1000 0 0\nv 0 1000 0\nv 0 0 1000\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
const STL: &str = "solid t
facet normal 0 0 -1\nouter loop\nvertex 0 0 0\nvertex 0 1000 0\nvertex 1000 0 0\nendloop\nendfacet
facet normal 0 -1 0\nouter loop\nvertex 0 0 0\nvertex 1000 0 0\nvertex 0 0 1000\nendloop\nendfacet
facet normal -1 0 0\nouter loop\nvertex 0 0 0\nvertex 0 0 1000\nvertex 0 1000 0\nendloop\nendfacet
facet normal 1 1 1\nouter loop\nvertex 1000 0 0\nvertex 0 1000 0\nvertex 0 0 1000\nendloop\nendfacet
endsolid t\n";

fn mesh_entry(file: &str) -> String {
    format!(
        "[[obstacles]]\nkind = \"mesh\"\nfile = {file:?}\nscale = 0.001\n\
         place_m = [4.0, 5.0, 6.0]\nrotation_deg = [0.0, 0.0, 90.0]\n"
    )
}

#[test]
fn meshes_of_both_formats_stand_scaled_and_turned_where_they_should() {
    for (name, text) in [("t.obj", OBJ), ("t.STL", STL)] {
        let config = loaded(&mesh_entry(name), &[(name, text.as_bytes())]).expect("valid");
        // The effective configuration stands for itself.
        let printed = config.to_toml().expect("printable");
        let again = Config::from_toml(&printed, Path::new("printed")).expect("valid");
        let solids = again.pilot_settings().expect("valid").planning.space.obstacles;
        let [Solid::Mesh(mesh)] = &solids[..] else { panic!("one mesh") };
        assert!(mesh.is_closed() && mesh.triangles_m().len() == 4);
        // Turned by 90° its x looks along y and its y against x.
        let bounds = mesh.bounds();
        assert!((bounds.min_m - Vector3::new(3.0, 5.0, 6.0)).norm() < 1e-12, "{bounds:?}");
        assert!((bounds.max_m - Vector3::new(4.0, 6.0, 7.0)).norm() < 1e-12, "{bounds:?}");
        assert!(mesh.contains(&Vector3::new(3.9, 5.1, 6.1)));
        assert!(!mesh.contains(&Vector3::new(3.1, 5.9, 6.9)));
    }
}

#[test]
fn bad_files_are_refused_by_name_and_reason() {
    let cut = &STL.as_bytes()[..200];
    let wild = OBJ.replace("f 2 3 4", "f 2 3 9");
    for (name, bytes, reason) in [
        ("t.ply", OBJ.as_bytes(), "neither .stl nor .obj"),
        ("t.stl", &b""[..], "is no STL"),
        ("t.stl", cut, "is no STL"),
        ("t.stl", &[7_u8; 300][..], "is no STL"),
        ("t.obj", wild.as_bytes(), "is no OBJ"),
        ("t.obj", &b"v 0 0 0\n"[..], "no triangle"),
        ("t.obj", &b"v 0 zero 0\n"[..], "is no OBJ"),
    ] {
        let message = refusal(&mesh_entry(name), &[(name, bytes)]);
        let names = message.contains("obstacles[0].file") && message.contains(name);
        assert!(names && message.contains(reason), "{message}");
    }
    let message = refusal(&mesh_entry("none.stl"), &[]);
    assert!(message.contains("cannot read") && message.contains("none.stl"), "{message}");
    let far = mesh_entry("t.obj").replace("0.001", "1000.0");
    let message = refusal(&far, &[("t.obj", OBJ.as_bytes())]);
    assert!(message.contains("obstacles[0].file") && message.contains("outside"), "{message}");
}

#[test]
fn boxes_prisms_walls_and_fence_are_checked_with_their_keys() {
    let config = loaded(
        "[[obstacles]]\nkind = \"box\"\ncentre_m = [6.0, 10.0, 5.0]\nsize_m = [0.4, 0.6, 10.0]\n\
         [[obstacles]]\nkind = \"prism\"\npolygon_m = [[0.0, 8.0], [20.0, 8.0], [20.0, 9.0]]\n\
         heights_m = [8.0, 9.2]\n\
         [fence]\npolygon_m = [[0.0, 0.0], [20.0, 0.0], [20.0, 20.0]]\nmax_height_m = 9.0\n",
        &[],
    );
    let settings = config.expect("parses").pilot_settings().expect("valid");
    let space = &settings.planning.space;
    assert_eq!(space.obstacles, settings.mapping.obstacles);
    assert_eq!(space.obstacles.len(), 2);
    // Only the box stands on the floor and covers ground that is measured.
    assert_eq!(settings.mapping.region.exclusions.len(), 1);
    assert!(
        !settings.mapping.region.accepts(6.1, 10.2, 0.0)
            && settings.mapping.region.accepts(6.0, 9.0, 0.0)
    );
    assert!(space.fence.as_ref().is_some_and(|fence| (fence.max_height_m - 9.0).abs() < 1e-12));
    for (more, reason) in [
        ("[[obstacles]]\nkind = \"ball\"\n", "ball"),
        (
            "[[obstacles]]\nkind = \"box\"\ncentre_m = [6.0, 1.0, 5.0]\nsize_m = [0.4, 0.0, 1.0]\n",
            "obstacles[0].size_m = 0 m is outside",
        ),
        (
            "[[obstacles]]\nkind = \"prism\"\npolygon_m = [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0]]\nheights_m = [1.0, 2.0]\n",
            "obstacles[0].polygon_m: the polygon crosses",
        ),
        (
            "[[obstacles]]\nkind = \"prism\"\npolygon_m = [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0]]\nheights_m = [2.0, 1.0]\n",
            "obstacles[0].heights_m = 1 m is outside",
        ),
        ("[fence]\nmax_height_m = 6.0\n", "planning.height_m inside the fence = 7 m is outside"),
        ("[fence]\nheight = 6.0\n", "height"),
    ] {
        let message = refusal(more, &[]);
        assert!(message.contains(reason), "{message}");
    }
}

#[test]
fn a_flight_too_near_to_the_ceiling_is_refused() {
    let low = EXAMPLE.replace("# ceiling_m = 10.0", "ceiling_m = 7.4");
    let config = Config::from_toml(&low, Path::new("low")).expect("parses");
    let message = config.pilot_settings().expect_err("refused").to_string();
    assert!(message.contains("planning.height_m") && message.contains("6.9"), "{message}");
}
