use super::*;
use crate::mapping::region::Rect;
use crate::mapping::unseen_patch::OpenNode;
use crate::stats::SeedBook;
use nalgebra::{DMatrix, DVector};

fn field() -> CoarseField {
    let region = Region {
        bounds: Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 6.0, y_max_m: 5.0 },
        exclusions: Vec::new(),
        exclusion_margin_m: 0.0,
        bays: Vec::new(),
    };
    let prior = Prior { range_m: 5.0, sigma_m: 1.0, mean_m: 1.5, mean_sigma_m: 1.5 };
    let fine = region.grid(0.25);
    CoarseField::new(&region, fine, &vec![fine.cell_area_m2(); fine.n_cells()], prior)
        .expect("a prior")
}

/// Σ0, column by column.
fn prior_cov(field: &CoarseField) -> DMatrix<f64> {
    let n = field.lattice().n_nodes();
    let column = |node: usize| {
        let mut unit = vec![0.0; n];
        unit[node] = 1.0;
        let lattice = field.functional.lattice();
        let one = Functional::new(lattice, &field.prior, unit).expect("a prior");
        one.given(&Information::new(lattice)).expect("solved").q
    };
    DMatrix::from_columns(&(0..n).map(|node| DVector::from_vec(column(node))).collect::<Vec<_>>())
}

#[test]
fn coarse_variance_matches_dense_algebra() {
    let field = field();
    let n = field.lattice().n_nodes();
    let mut noise = SeedBook::new(5).stream("sightings");
    let cov = Matrix3::new(4e-4, 1e-5, 0.0, 1e-5, 9e-6, 2e-6, 0.0, 2e-6, 1e-5);
    let mut parts = Vec::new();
    // Rows, information, window and arms of all data.
    let mut data = Vec::new();
    for part in 0..2 {
        let mut seen = field.nothing_seen();
        for window in 0..2 {
            seen.windows.push(field.window(&cov));
            for _ in 0..15 {
                let (x, y) = (noise.between(0.2, 5.8), noise.between(0.2, 4.8));
                let row = field.lattice().row_at(x, y).expect("inside");
                let info = noise.between(1.0, 200.0);
                let arm = (noise.between(-4.0, 4.0), noise.between(-4.0, 4.0));
                seen.add(&row, info, arm);
                data.push((row, info, 2 * part + window, arm));
            }
        }
        parts.push(seen);
    }
    let ours = field.volume_var(&parts.iter().collect::<Vec<_>>()).expect("solved");
    // Σ = Σ0 − Σ0 Aᵀ (A Σ0 Aᵀ + R)⁻¹ A Σ0
    let prior = prior_cov(&field);
    let mut a = DMatrix::zeros(data.len(), n);
    let mut r = DMatrix::zeros(data.len(), data.len());
    for (i, (row, info, ..)) in data.iter().enumerate() {
        for (node, weight) in std::iter::zip(row.nodes, row.weights) {
            a[(i, node as usize)] += weight;
        }
        r[(i, i)] = 1.0 / info;
    }
    let gain = (&a * &prior * a.transpose() + r).try_inverse().expect("regular");
    let posterior = &prior - &prior * a.transpose() * gain * &a * &prior;
    let w = DVector::from_column_slice(field.functional.weights());
    assert!((w.sum() - 30.0).abs() < 1e-9, "6 m × 5 m");
    let dense_m6 = w.dot(&(&posterior * &w));
    assert!((ours.field_m6 / dense_m6 - 1.0).abs() < 1e-6, "{} {dense_m6}", ours.field_m6);
    // ∂V/∂z_i by the same dense matrix, and from there the pose's share.
    let q = &posterior * &w;
    let mut pose_m6 = 0.0;
    for window in 0..4 {
        let mut s = Vector3::zeros();
        for (i, (_, info, of, (x, y))) in data.iter().enumerate() {
            if *of == window {
                s += Vector3::new(1.0, *y, -*x) * (a.row(i) * &q)[0] * *info;
            }
        }
        pose_m6 += s.dot(&(cov * s));
    }
    assert!((ours.pose_m6 / pose_m6 - 1.0).abs() < 1e-6, "{} {pose_m6}", ours.pose_m6);
}

#[test]
fn a_patch_of_the_map_is_off_as_a_whole_until_it_is_looked_at() {
    let field = field();
    let lattice = field.lattice();
    let nodes = [lattice.nearest_node(2.5, 2.5), lattice.nearest_node(3.75, 2.5)];
    // Two squares of 0.5 m with σ = 30 m, far more than the field has for them.
    let (area_m2, sigma_m) = (0.25, 30.0);
    let patch = nodes.map(|node| OpenNode {
        place_m: lattice.place_m(node),
        area_m2,
        error_m3: area_m2 * sigma_m,
    });
    let mut known = field.nothing_seen();
    let var_beside = field.var_beside.as_ref().expect("patches are known of");
    known.patches =
        Some(OpenPatches::new(lattice, field.functional.weights(), &[patch.to_vec()], var_beside));
    let q_m2 = field.functional.given(&known.info).expect("solved").q;
    let by_field_m6: f64 = nodes.iter().map(|node| area_m2 * q_m2[*node]).sum();
    let patches_m6 = |parts: &[&Sightings]| field.volume_var(parts).expect("solved").patches_m6;
    let is =
        |got: f64, expected: f64| assert!((got - expected).abs() < 1e-9, "{got}, not {expected}");
    let none = |stays: f64| ((2.0 * 7.5 * stays).powi(2) - by_field_m6 * stays).max(0.0);
    assert!(none(0.5) > 10.0, "something to see");
    is(patches_m6(&[&known]), none(1.0));
    // A look at all of it that reaches it with a probability of 0.6: 0.4 of its variance stay, counted from 0.1 on.
    let mut leg = field.nothing_seen();
    for node in nodes {
        let (x, y) = lattice.place_m(node);
        let row = lattice.row_at(x, y).expect("inside");
        leg.look(&row, 10.0, Chance { open: 1.0, high: 0.6 });
    }
    is(patches_m6(&[&known, &leg]), none((0.3_f64 / 0.9).sqrt()));
    // Seen, it is as the field has it.
    let mut sure = field.nothing_seen();
    for node in nodes {
        let (x, y) = lattice.place_m(node);
        sure.look(&lattice.row_at(x, y).expect("inside"), 10.0, Chance { open: 1.0, high: 1.0 });
    }
    is(patches_m6(&[&known, &leg, &sure]), 0.0);
    is(patches_m6(&[&known, &sure]), 0.0);
}

/// A patch of the nodes of a square, each with 0.25 m² and σ = 30 m, in a map that knows all around; and its middle.
fn square_patch(field: &CoarseField) -> (Sightings, Vec<OpenNode>) {
    let lattice = field.lattice();
    let (x_m, y_m) = lattice.place_m(lattice.nearest_node(3.0, 2.5));
    let d_m = lattice.spacing_m();
    let steps = [-1.0, 0.0, 1.0];
    let places = steps.map(|dy| steps.map(|dx| (x_m + dx * d_m, y_m + dy * d_m)));
    let nodes: Vec<OpenNode> = places
        .into_iter()
        .flatten()
        .map(|place_m| OpenNode { place_m, area_m2: 0.25, error_m3: 7.5 })
        .collect();
    let mut known = field.nothing_seen();
    let (w_m2, var_beside) = (field.functional.weights(), field.var_beside.as_ref());
    let var_beside = var_beside.expect("patches are known of");
    known.patches = Some(OpenPatches::new(lattice, w_m2, std::slice::from_ref(&nodes), var_beside));
    (known, nodes)
}

/// A look at all the ground around these nodes.
fn look_at(field: &CoarseField, nodes: &[OpenNode], chance: Chance) -> Sightings {
    let mut leg = field.nothing_seen();
    for node in nodes {
        let row = field.lattice().row_at(node.place_m.0, node.place_m.1).expect("inside");
        leg.look(&row, 100.0, chance);
    }
    leg
}

#[test]
fn looks_part_a_patch_and_bring_known_ground_nearer() {
    let field = field();
    let (known, nodes) = square_patch(&field);
    // Without the field, which has little for heights of 30 m.
    let patches_m6 = |parts: &[&Sightings]| {
        let unseen = field.unseen(parts);
        field.patches_m6(parts, &unseen, &vec![0.0; field.lattice().n_nodes()])
    };
    let is = |got: f64, expected: f64| {
        assert!((got / expected - 1.0).abs() < 1e-5, "{got}, not {expected}")
    };
    let sure = Chance { open: 1.0, high: 1.0 };
    is(patches_m6(&[&known]), (9.0_f64 * 7.5).powi(2));
    // The middle column seen, three nodes to either side stay, each a step from seen ground as before; two
    // patches, correlated by 0.1.
    let column: Vec<OpenNode> = [1, 4, 7].map(|k| nodes[k]).to_vec();
    let parted = look_at(&field, &column, sure);
    is(patches_m6(&[&known, &parted]), (2.0 + 2.0 * 0.1) * (3.0_f64 * 7.5).powi(2));
    // The middle of the southern edge seen, one patch stays whose middle is one step from seen ground, not two. σ there
    // falls by (1 − r(1.25 m))/(1 − r(2.5 m)) with r(d) = κ d K₁(κ d), κ = √8/5: 0.268086/0.555657.
    let middle = 0.268_086_f64 / 0.555_657;
    let notched = look_at(&field, &nodes[1..2], sure);
    is(patches_m6(&[&known, &notched]), ((7.0 + middle) * 7.5).powi(2));
}

#[test]
fn two_patches_of_the_map_at_one_node_stay_two() {
    let field = field();
    let (mut known, nodes) = square_patch(&field);
    let (w_m2, var_beside) = (field.functional.weights(), field.var_beside.as_ref());
    // The map's nodes are finer: both lie nearest to the same node of the lattice.
    let (x_m, y_m) = nodes[4].place_m;
    let beside = OpenNode { place_m: (x_m + 0.3, y_m - 0.2), error_m3: 3.0, ..nodes[4] };
    let patches = [vec![nodes[4]], vec![beside]];
    known.patches = Some(OpenPatches::new(field.lattice(), w_m2, &patches, var_beside.unwrap()));
    let parts = [&known];
    let without_field = vec![0.0; field.lattice().n_nodes()];
    let patches_m6 = field.patches_m6(&parts, &field.unseen(&parts), &without_field);
    let expected_m6 = 7.5_f64.powi(2) + 3.0_f64.powi(2) + 2.0 * 0.1 * 7.5 * 3.0;
    assert!((patches_m6 - expected_m6).abs() < 1e-9, "{patches_m6}, not {expected_m6}");
}

#[test]
fn without_a_map_patches_are_made_of_what_is_left() {
    let field = field();
    let (_, nodes) = square_patch(&field);
    let lattice = field.lattice();
    let whole_m2 = field.functional.weights();
    let square: Vec<usize> =
        nodes.iter().map(|node| lattice.nearest_node(node.place_m.0, node.place_m.1)).collect();
    // All is seen but a square of three by three nodes.
    let mut seen = field.nothing_seen();
    seen.seen_m2.copy_from_slice(whole_m2);
    square.iter().for_each(|node| seen.seen_m2[*node] = 0.0);
    let patches_m6 = |parts: &[&Sightings]| {
        field.patches_m6(parts, &field.unseen(parts), &vec![0.0; lattice.n_nodes()])
    };
    let is = |got: f64, expected: f64| {
        assert!((got / expected - 1.0).abs() < 1e-5, "{got}, not {expected}")
    };
    // σ = 1 − r, one step and two steps from seen ground, r as above.
    let (beside, middle) = (0.268_086_f64, 0.555_657);
    let beside_m3 = |of: &[usize]| of.iter().map(|k| beside * whole_m2[square[*k]]).sum::<f64>();
    let ring_m3 = beside_m3(&[0, 1, 2, 3, 5, 6, 7, 8]);
    is(patches_m6(&[&seen]), (ring_m3 + middle * whole_m2[square[4]]).powi(2));
    let column: Vec<OpenNode> = [1, 4, 7].map(|k| nodes[k]).to_vec();
    let parted = look_at(&field, &column, Chance { open: 1.0, high: 1.0 });
    let (west_m3, east_m3) = (beside_m3(&[0, 3, 6]), beside_m3(&[2, 5, 8]));
    let both_m6 = west_m3.powi(2) + east_m3.powi(2) + 2.0 * 0.1 * west_m3 * east_m3;
    is(patches_m6(&[&seen, &parted]), both_m6);
}

#[test]
fn no_looks_leave_less_than_the_least_variance() {
    let field = field();
    let (known, nodes) = square_patch(&field);
    let mut noise = SeedBook::new(11).stream("looks");
    for case in 0..40 {
        let mut legs = Vec::new();
        for _ in 0..3 {
            let seen: Vec<OpenNode> =
                nodes.iter().filter(|_| noise.between(0.0, 1.0) < 0.5).copied().collect();
            let chance = Chance { open: noise.between(0.3, 1.0), high: noise.between(0.0, 1.0) };
            let mut leg = look_at(&field, &seen, chance);
            for node in &seen {
                let row = field.lattice().row_at(node.place_m.0, node.place_m.1).expect("inside");
                leg.info.add(&row, 0.0, field.info_per_area_seen_with(chance.open * chance.high));
            }
            legs.push(leg);
        }
        let parts: Vec<&Sightings> = std::iter::once(&known).chain(&legs).collect();
        let whole_m6 = field.volume_var(&parts).expect("solved").total_m6();
        let least_m6 = field.least_volume_var_m6(&parts);
        assert!(least_m6 <= whole_m6 * (1.0 + 1e-9), "case {case}: {least_m6} > {whole_m6}");
        // It is a bound that tells: patches of 30 m are most of what there is.
        assert!(least_m6 > 0.5 * (whole_m6 - 40.0), "case {case}: {least_m6} of {whole_m6}");
    }
}

#[test]
fn height_and_tilt_follow_the_heading() {
    // 1° of roll of a body that heads along y is tilt about y of the hall.
    let mut cov = Matrix6::zeros();
    cov[(2, 2)] = 0.04;
    cov[(3, 3)] = 3.0e-4;
    let turned = nalgebra::Rotation3::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2);
    let ours = height_and_tilt_cov(&cov, turned.matrix());
    assert!((ours - Matrix3::from_diagonal(&Vector3::new(0.04, 0.0, 3.0e-4))).norm() < 1e-12);
}
