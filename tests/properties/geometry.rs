//! Group laws of transforms; cells and places.

use nalgebra::Vector3;
use proptest::prelude::*;
use stockpilot::geometry::{Body, Camera, Frame, Hall, Lidar, Point, Rotation, Transform};
use stockpilot::mapping::region::{Rect, Region};
use stockpilot::messages::GridGeometry;

fn transform<A: Frame, B: Frame>() -> impl Strategy<Value = Transform<A, B>> {
    let angle = || -3.1_f64..3.1;
    let metres = || -50.0_f64..50.0;
    ((angle(), angle(), angle()), (metres(), metres(), metres())).prop_map(|(r, p)| {
        Transform::new(Rotation::from_euler_rad(r.0, r.1, r.2), Point::new(p.0, p.1, p.2))
    })
}

fn place<F: Frame>() -> impl Strategy<Value = Point<F>> {
    prop::array::uniform3(-50.0_f64..50.0).prop_map(|p| Point::from_coords(Vector3::from(p)))
}

/// Rounding of coordinates up to 150 m in three products.
const ROUNDING_M: f64 = 1e-11;

proptest! {
    #[test]
    fn products_associate(
        a in transform::<Hall, Body>(),
        b in transform::<Body, Lidar>(),
        c in transform::<Lidar, Camera>(),
        p in place::<Camera>(),
    ) {
        let (left, right) = (((a * b) * c) * p, (a * (b * c)) * p);
        prop_assert!((left - right).coords.norm() < ROUNDING_M);
        prop_assert!((a * (b * (c * p)) - left).coords.norm() < ROUNDING_M);
    }

    #[test]
    fn inverses_undo_from_both_sides_and_turn_products_around(
        a in transform::<Hall, Body>(),
        b in transform::<Body, Camera>(),
        p in place::<Hall>(),
    ) {
        prop_assert!((a * (a.inverse() * p) - p).coords.norm() < ROUNDING_M);
        let (left, right) = ((a * b).inverse() * p, b.inverse() * (a.inverse() * p));
        prop_assert!((left - right).coords.norm() < ROUNDING_M);
    }

    #[test]
    fn distances_stay(a in transform::<Hall, Body>(), p in place::<Body>(), q in place::<Body>()) {
        let (before, after) = ((p - q).coords.norm(), (a * p - a * q).coords.norm());
        prop_assert!((before - after).abs() < ROUNDING_M);
    }

    #[test]
    fn cell_and_centre_are_each_others_inverse(
        x_min_m in -30.0_f64..30.0,
        y_min_m in -30.0_f64..30.0,
        cell_m in 0.05_f64..2.0,
        n_cols in 1_usize..200,
        n_rows in 1_usize..200,
        share in 0.0_f64..1.0,
    ) {
        let grid = GridGeometry { x_min_m, y_min_m, cell_m, n_cols, n_rows };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::cast_precision_loss,
            reason = "a share of a small count"
        )]
        let index = (share * grid.n_cells() as f64) as usize;
        let (x, y) = grid.centre_m(index);
        prop_assert_eq!(grid.cell_at(x, y), Some(index));
        // Anywhere in the cell but on its rim.
        for (dx, dy) in [(-0.499, -0.499), (0.499, -0.499), (-0.499, 0.499), (0.499, 0.499)] {
            prop_assert_eq!(grid.cell_at(x + dx * cell_m, y + dy * cell_m), Some(index));
        }
        let (x_max, y_max) = grid.max_corner_m();
        prop_assert_eq!(grid.cell_at(x_max + 1e-6, y), None);
        prop_assert_eq!(grid.cell_at(x, y_min_m - 1e-6), None);
        prop_assert!(x < x_max && y < y_max);
    }

    #[test]
    fn exclusions_split_the_area_and_lose_nothing(
        split_m in 1.0_f64..9.0,
        cell_m in 0.2_f64..0.6,
    ) {
        let bounds = Rect { x_min_m: 0.0, y_min_m: 0.0, x_max_m: 10.0, y_max_m: 6.0 };
        let left = Rect { x_max_m: split_m, ..bounds };
        let right = Rect { x_min_m: split_m, ..bounds };
        let area = |exclusion: Option<Rect>| {
            let exclusions = exclusion.into_iter().map(Into::into).collect();
            let region = Region { bounds, exclusions, exclusion_margin_m: 0.0, bays: vec![] };
            let grid = region.grid(cell_m);
            region.cell_areas_m2(&grid).iter().sum::<f64>()
        };
        let (whole, without_left, without_right) = (area(None), area(Some(left)), area(Some(right)));
        let tolerance_m2 = 1e-10;
        prop_assert!((whole - 60.0).abs() < tolerance_m2, "{}", whole);
        prop_assert!((without_left + without_right - whole).abs() < tolerance_m2);
        prop_assert!((without_right - split_m * 6.0).abs() < tolerance_m2);
    }
}
