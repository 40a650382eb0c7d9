use super::*;
use crate::mapping::KeptHit;
use crate::messages::GridGeometry;
use crate::time::Stamp;

/// Three columns, two rows; the last cell does not count.
fn map() -> HeightMap {
    HeightMap {
        at: Stamp::ZERO,
        grid: GridGeometry { x_min_m: -1.0, y_min_m: 2.0, cell_m: 0.5, n_cols: 3, n_rows: 2 },
        mean_m: vec![0.1, 0.2, 1.0 / 3.0, 1.1, 1.2, 1.3],
        sigma_m: vec![0.01; 6],
        disturbed_cells: Vec::new(),
    }
}

const COUNTS: [bool; 6] = [true, true, true, true, true, false];

fn hits() -> Vec<KeptHit> {
    let hit = |k: f64| KeptHit {
        at: Stamp::from_nanos(2_500_000_000),
        place_m: [0.1 * k, -0.2 * k, 0.3 * k],
        height_sigma_m: 0.01 * k,
        intensity: 7,
    };
    (1..=50).map(|k| hit(f64::from(k))).collect()
}

#[test]
fn a_grid_is_read_back_to_the_last_bit_by_the_reader_of_bases() {
    let map = map();
    let text = esri_grid(Surface { map: &map, counts: &COUNTS }, &map.mean_m);
    let lines: Vec<&str> = text.lines().collect();
    // The row with the largest y comes first.
    assert_eq!(lines[6], "1.1 1.2 -9999");
    assert_eq!(lines[7], "0.1 0.2 0.3333333333333333");
    assert_eq!(lines[2], "xllcorner -1");
}

/// Read by the same library: that the bytes mean what they should is for other readers
/// (`tests/interop`) to say.
#[test]
fn a_tiff_has_two_bands_and_its_corner() {
    let map = map();
    let bytes = geotiff(Surface { map: &map, counts: &COUNTS }).expect("a file");
    let mut reader = tiff::decoder::Decoder::new(std::io::Cursor::new(bytes)).expect("a TIFF");
    assert_eq!(reader.dimensions().expect("a size"), (3, 2));
    let corner = reader.get_tag_f64_vec(tiff::tags::Tag::ModelTiepointTag).expect("a corner");
    assert_eq!(corner, [0.0, 0.0, 0.0, -1.0, 3.0, 0.0]);
    let empty = HeightMap { grid: GridGeometry { n_cols: 0, ..map.grid }, ..map };
    assert!(geotiff(Surface { map: &empty, counts: &[] }).is_err());
}

#[test]
fn a_mesh_joins_cells_that_count_and_faces_upwards() {
    let map = map();
    let text = obj(Surface { map: &map, counts: &COUNTS });
    let starting_with = |letter: char| text.lines().filter(move |line| line.starts_with(letter));
    // The cell that has no three neighbours is a vertex without a face.
    assert_eq!(starting_with('v').count(), 5);
    assert_eq!(starting_with('f').collect::<Vec<_>>(), ["f 1 2 5", "f 1 5 4"]);
    let options = tobj::LoadOptions::default();
    let (models, _) =
        tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| Ok(Default::default()))
            .expect("an OBJ");
    // The reader keeps the vertices of faces, in the order in which they are met.
    let mesh = &models[0].mesh;
    assert_eq!((mesh.positions.len(), &mesh.indices[..3]), (4 * 3, &[0, 1, 2][..]));
    let vertex = |k: usize| &mesh.positions[3 * k..3 * k + 3];
    assert_eq!(vertex(0), [-0.75, 2.25, 0.1]);
    // (b − a) × (c − a) points up.
    let (a, b, c) = (vertex(0), vertex(1), vertex(2));
    assert!((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0);
}

#[test]
fn a_cloud_comes_back_from_laz() {
    let hits = hits();
    let cloud = Cloud { hits: &hits, began_at: Stamp::from_nanos(500_000_000) };
    let bytes = laz(cloud).expect("a file");
    assert_eq!(bytes, laz(cloud).expect("a file"), "not the same twice");
    let mut reader = las::Reader::new(std::io::Cursor::new(bytes)).expect("a LAZ");
    assert!(reader.header().has_wkt_crs());
    let read = reader.read_all().expect("points");
    let points: Vec<las::Point> = read.points().collect::<Result<_, _>>().expect("points");
    assert_eq!(points.len(), 50);
    let last = &points[49];
    assert!((last.x - 5.0).abs() < 1e-4 && (last.y + 10.0).abs() < 1e-4, "{last:?}");
    assert_eq!(last.gps_time, Some(2.0));
    assert_eq!(last.extra_bytes, 0.5_f32.to_le_bytes());
    let none = laz(Cloud { hits: &[], began_at: Stamp::ZERO }).expect("an empty file");
    assert!(none.starts_with(b"LASF"));
}

#[test]
fn a_ply_is_as_long_as_its_head_says() {
    let hits = hits();
    let bytes = ply(Cloud { hits: &hits, began_at: Stamp::ZERO });
    let head = b"end_header\n";
    let from = bytes.windows(head.len()).position(|w| w == head).expect("a head") + head.len();
    // Four doubles, a float and a byte.
    assert_eq!(bytes.len() - from, 50 * 37);
}
