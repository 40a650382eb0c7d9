use super::*;
use crate::mapping::polygon::Polygon;
use crate::stats::{Noise, SeedBook};

/// A concave arrow head, between two heights.
fn arrow() -> Prism {
    let corners = [(0.0, 0.0), (4.0, 1.0), (0.0, 2.0), (1.0, 1.0)];
    Prism::new(Polygon::new(&corners).expect("simple"), (1.5, 0.5))
}

fn point(noise: &mut Noise, low: f64, high: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| noise.between(low, high))
}

/// The smallest distance from points of the way, close together, to the solid: never shorter than
/// the true one, and at most half a step longer.
fn walked_m(solid: &Solid, a: &Vector3<f64>, b: &Vector3<f64>, n_steps: u32) -> f64 {
    let at = |k: u32| a.lerp(b, f64::from(k) / f64::from(n_steps));
    (0..=n_steps).map(|k| solid.distance_m(&at(k), 100.0)).fold(f64::INFINITY, f64::min)
}

#[test]
fn box_distances_have_their_closed_forms() {
    let (centre, size) = (Vector3::new(1.0, -2.0, 3.0), Vector3::new(2.0, 1.0, 0.5));
    let yaw_rad = 0.7_f64;
    let solid = Solid::from(Prism::turned_box(&centre, &size, yaw_rad).expect("a box"));
    let mut noise = SeedBook::new(3).stream("box");
    for _ in 0..2000 {
        let p = point(&mut noise, -5.0, 5.0);
        // In the box's own axes: the textbook distance from a box along its axes.
        let (sin, cos) = yaw_rad.sin_cos();
        let d = p - centre;
        let own = Vector3::new(cos * d.x + sin * d.y, cos * d.y - sin * d.x, d.z);
        let outside = (own.abs() - 0.5 * size).sup(&Vector3::zeros());
        assert!((solid.distance_m(&p, 100.0) - outside.norm()).abs() < 1e-12);
    }
}

/// A box as twelve triangles, through the mesh's code instead of the prism's.
pub(crate) fn box_triangles(low: [f64; 3], high: [f64; 3]) -> Vec<[Vector3<f64>; 3]> {
    let corner = |i: usize| {
        let pick = |axis: usize| if i >> axis & 1 == 1 { high[axis] } else { low[axis] };
        Vector3::new(pick(0), pick(1), pick(2))
    };
    let quads =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let halves = |q: [usize; 4]| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]];
    quads.into_iter().flat_map(halves).map(|t| t.map(corner)).collect()
}

#[test]
fn a_box_of_triangles_is_the_box() {
    let (low, high) = ([0.5, -1.0, 2.0], [1.5, 1.0, 2.3]);
    let mesh = Mesh::new(box_triangles(low, high)).expect("triangles");
    assert!(mesh.is_closed());
    let corners = [(0.5, -1.0), (1.5, -1.0), (1.5, 1.0), (0.5, 1.0)];
    let prism = Prism::new(Polygon::new(&corners).expect("simple"), (2.0, 2.3));
    let (mesh, prism) = (Solid::from(mesh), Solid::from(prism));
    assert_eq!(mesh.bounds(), prism.bounds());
    let mut noise = SeedBook::new(5).stream("twins");
    let (mut n_inside, mut n_cut) = (0, 0);
    for _ in 0..4000 {
        let (a, b) = (point(&mut noise, -1.0, 3.5), point(&mut noise, -1.0, 3.5));
        let (of_mesh, of_prism) = (mesh.distance_m(&a, 100.0), prism.distance_m(&a, 100.0));
        assert!((of_mesh - of_prism).abs() < 1e-12, "{a:?}");
        n_inside += u32::from(of_mesh == 0.0);
        let way = (mesh.way_distance_m(&a, &b, 100.0), prism.way_distance_m(&a, &b, 100.0));
        assert!((way.0 - way.1).abs() < 1e-9, "{a:?} {b:?} {way:?}");
        n_cut += u32::from(way.0 == 0.0);
    }
    // Both cases are there.
    assert!(n_inside > 5 && n_cut > 50, "{n_inside} {n_cut}");
}

/// A bumpy closed ball: an octahedron, each face split `n` times, pushed out to a wavy radius.
fn ball(n_splits: u32) -> Mesh {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let mut triangles = vec![
        [x, y, z],
        [y, -x, z],
        [-x, -y, z],
        [-y, x, z],
        [y, x, -z],
        [-x, y, -z],
        [-y, -x, -z],
        [x, -y, -z],
    ];
    for _ in 0..n_splits {
        triangles = triangles
            .into_iter()
            .flat_map(|[a, b, c]: [Vector3<f64>; 3]| {
                let (ab, bc, ca) = (a + b, b + c, c + a);
                let [ab, bc, ca] = [ab, bc, ca].map(|p| p.normalize());
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let wavy = |p: Vector3<f64>| p * (1.0 + 0.2 * (3.0 * p.x).sin() * (2.0 * p.y + 1.0).cos());
    Mesh::new(triangles.into_iter().map(|t| t.map(wavy)).collect()).expect("triangles")
}

#[test]
fn the_tree_of_a_mesh_finds_what_all_triangles_give() {
    let mesh = ball(3);
    assert!(mesh.is_closed() && mesh.triangles_m().len() == 512);
    let mut noise = SeedBook::new(8).stream("mesh");
    for _ in 0..400 {
        let (a, b) = (point(&mut noise, -2.5, 2.5), point(&mut noise, -2.5, 2.5));
        if !mesh.contains(&a) {
            let all = mesh.triangles_m().iter().map(|t| segment::point_triangle_m2(&a, t));
            let all_m = all.fold(f64::INFINITY, f64::min).sqrt();
            assert!((mesh.distance_m(&a, 100.0) - all_m).abs() < 1e-12);
            let all = mesh.triangles_m().iter().map(|t| segment::segment_triangle_m2(&a, &b, t));
            let all_m = all.fold(f64::INFINITY, f64::min).sqrt();
            assert!((mesh.way_distance_m(&a, &b, 100.0) - all_m).abs() < 1e-12);
        }
        // Solid angles add up to 4π inside and to nothing outside (van Oosterom, Strackee 1983).
        let angle = |[p, q, r]: &[Vector3<f64>; 3]| {
            let (p, q, r) = (p - a, q - a, r - a);
            let (l, m, n) = (p.norm(), q.norm(), r.norm());
            let det = p.dot(&q.cross(&r));
            2.0 * det.atan2(l * m * n + p.dot(&q) * n + q.dot(&r) * l + r.dot(&p) * m)
        };
        let angles: f64 = mesh.triangles_m().iter().map(angle).sum();
        let is_inside = angles.abs() > std::f64::consts::TAU;
        assert_eq!(mesh.contains(&a), is_inside, "{a:?}: {angles}");
    }
}

#[test]
fn ways_past_solids_are_as_far_as_the_nearest_of_their_points() {
    let mut noise = SeedBook::new(13).stream("ways");
    for solid in [Solid::from(arrow()), Solid::from(ball(1))] {
        for _ in 0..150 {
            let (a, b) = (point(&mut noise, -2.0, 4.5), point(&mut noise, -2.0, 4.5));
            let exact_m = solid.way_distance_m(&a, &b, 100.0);
            let walked_m = walked_m(&solid, &a, &b, 400);
            let half_step_m = 0.5 * (b - a).norm() / 400.0;
            let late_m = walked_m - exact_m;
            assert!((-1e-9..=half_step_m + 1e-9).contains(&late_m), "{a:?} {b:?} {late_m}");
            // The other way round it is the same way, and nothing moves for a way of no length.
            assert!((solid.way_distance_m(&b, &a, 100.0) - exact_m).abs() < 1e-9);
            let here_m = solid.distance_m(&a, 100.0);
            assert!((solid.way_distance_m(&a, &a, 100.0) - here_m).abs() < 1e-12);
            // A reach cuts and does not change.
            assert!((solid.way_distance_m(&a, &b, 0.3) - exact_m.min(0.3)).abs() < 1e-12);
        }
    }
}

#[test]
fn a_sheet_is_not_stepped_over_and_an_open_mesh_has_no_inside() {
    // A tenth of a millimetre thick, met at right angles in the middle of a long way.
    let sheet = Prism::turned_box(&Vector3::new(5.0, 0.0, 1.0), &Vector3::new(1e-4, 2.0, 2.0), 0.0);
    let sheet = Solid::from(sheet.expect("a box"));
    let (a, b) = (Vector3::new(0.0, 0.3, 1.2), Vector3::new(10.0, 0.1, 1.1));
    assert!(sheet.way_distance_m(&a, &b, 1.0) <= 0.0);
    assert!(blocks_sight(std::slice::from_ref(&sheet), &a, &b));
    let over = Vector3::new(0.0, 0.0, 1.5);
    assert!((sheet.way_distance_m(&(a + over), &(b + over), 1.0) - 0.65).abs() < 1e-3);
    // One triangle: a skin, met from both sides.
    let skin = vec![[Vector3::zeros(), Vector3::x(), Vector3::y()]];
    let skin = Solid::from(Mesh::new(skin).expect("a triangle"));
    let (above, below) = (Vector3::new(0.2, 0.2, 0.4), Vector3::new(0.2, 0.2, -0.4));
    assert!(blocks_sight(std::slice::from_ref(&skin), &above, &below));
    assert!((skin.distance_m(&below, 1.0) - 0.4).abs() < 1e-12);
    assert!(!blocks_sight(&[skin], &above, &(above + Vector3::x())));
}

#[test]
fn meshes_of_nothing_are_refused() {
    assert_eq!(Mesh::new(Vec::new()), Err(MeshError::Empty));
    let bad = vec![[Vector3::zeros(), Vector3::new(f64::NAN, 0.0, 0.0), Vector3::y()]];
    assert_eq!(Mesh::new(bad), Err(MeshError::NotFinite { index: 0 }));
}

#[test]
fn a_degenerate_triangle_is_its_segment() {
    let line = Mesh::new(vec![[Vector3::zeros(), Vector3::x() * 2.0, Vector3::x()]]);
    let line = Solid::from(line.expect("a triangle"));
    assert!((line.distance_m(&Vector3::new(1.5, 0.3, 0.4), 9.0) - 0.5).abs() < 1e-12);
}
