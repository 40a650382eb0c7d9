use super::*;

/// On the wall at x = 5 m, facing −x: seen from the front, right is −y.
fn square(edge_m: f64) -> [Point<Hall>; 4] {
    [
        Point::new(5.0, 0.0, 2.0),
        Point::new(5.0, -edge_m, 2.0),
        Point::new(5.0, -edge_m, 2.0 + edge_m),
        Point::new(5.0, 0.0, 2.0 + edge_m),
    ]
}

/// The same tag as somebody gives it who starts on the wrong side.
fn mirrored(edge_m: f64) -> [Point<Hall>; 4] {
    let [low_left, low_right, up_right, up_left] = square(edge_m);
    [low_right, low_left, up_left, up_right]
}

/// A hall of 4 m × 4 m × 3 m before the wall.
fn region() -> (Point<Hall>, Point<Hall>) {
    (Point::new(0.0, -2.0, 0.0), Point::new(4.0, 2.0, 3.0))
}

const FAMILY: TagFamily = TagFamily::Tag36h11;

#[test]
fn duplicates_and_bent_tags_are_refused() {
    let mut map = MarkerMap::default();
    map.insert(FAMILY, 4, square(0.5)).expect("a good tag");
    assert_eq!(
        map.insert(FAMILY, 4, square(0.4)),
        Err(MarkerMapError::Duplicate { family: FAMILY, id: 4 })
    );
    assert_eq!(map.corners(FAMILY, 4), Some(&square(0.5)), "the first stays");
    let mut bent = square(0.5);
    bent[2].coords.z += 0.1;
    assert!(matches!(map.insert(FAMILY, 5, bent), Err(MarkerMapError::NotSquare { id: 5, .. })));
    let mut crossed = square(0.5);
    crossed.swap(2, 3);
    assert!(matches!(map.insert(FAMILY, 6, crossed), Err(MarkerMapError::NotSquare { id: 6, .. })));
    let mut broken = square(0.5);
    broken[1].coords.y = f64::NAN;
    assert!(matches!(map.insert(FAMILY, 7, broken), Err(MarkerMapError::NotFinite { id: 7, .. })));
}

#[test]
fn sizes_in_other_units_are_refused() {
    let mut map = MarkerMap::default();
    for (id, edge) in [(1, 160.0), (2, 0.0016)] {
        let error = map.insert(FAMILY, id, square(edge)).unwrap_err();
        assert!(matches!(error, MarkerMapError::AbsurdSize { .. }), "{error}");
        assert!(error.to_string().contains("metres"), "{error}");
    }
    map.insert(FAMILY, 3, square(0.02 + 1e-9)).expect("a small one");
    map.insert(FAMILY, 4, square(5.0 - 1e-9)).expect("a large one");
}

#[test]
fn mirrored_corners_are_noticed_by_what_lies_behind_them() {
    let mut map = MarkerMap::default();
    map.insert(FAMILY, 1, square(0.5)).expect("a square");
    map.insert(FAMILY, 2, square(0.6)).expect("a square");
    assert_eq!(map.check_facing(region(), |_, _| false), Ok(()));
    map.insert(FAMILY, 3, mirrored(0.5)).expect("a mirrored square is a square");
    let error = MarkerMapError::FacesAway { family: FAMILY, id: 3 };
    assert_eq!(map.check_facing(region(), |_, _| false), Err(error));
    assert_eq!(map.check_facing(region(), |_, id| id == 3), Ok(()), "meant that way");
    let mut all = MarkerMap::default();
    all.insert(FAMILY, 1, mirrored(0.5)).expect("a square");
    all.insert(FAMILY, 2, mirrored(0.6)).expect("a square");
    let error = MarkerMapError::AllFaceAway { n_tags: 2 };
    assert_eq!(all.check_facing(region(), |_, _| false), Err(error));
}

#[test]
fn tags_on_floor_and_ceiling_see_the_region() {
    let mut map = MarkerMap::default();
    // On the floor, seen from above: right is +x, up is +y.
    let floor = [(1.0, 1.0), (1.5, 1.0), (1.5, 1.5), (1.0, 1.5)];
    map.insert(FAMILY, 1, floor.map(|(x, y)| Point::new(x, y, 0.0))).expect("a square");
    let ceiling = [(1.5, 1.0), (1.0, 1.0), (1.0, 1.5), (1.5, 1.5)];
    map.insert(FAMILY, 2, ceiling.map(|(x, y)| Point::new(x, y, 3.0))).expect("a square");
    assert_eq!(map.check_facing(region(), |_, _| false), Ok(()));
    let mut swapped = MarkerMap::default();
    swapped.insert(FAMILY, 2, floor.map(|(x, y)| Point::new(x, y, 3.0))).expect("a square");
    let error = MarkerMapError::FacesAway { family: FAMILY, id: 2 };
    assert_eq!(swapped.check_facing(region(), |_, _| false), Err(error));
}

#[test]
fn points_have_numbers_of_their_own() {
    let mut map = MarkerMap::default();
    assert!(map.is_empty());
    let lamp = Point::new(3.0, 1.0, 6.5);
    map.insert_point(4, lamp).expect("a point");
    assert_eq!(map.point(4), Some(lamp));
    assert_eq!((map.point(5), map.len(), map.is_empty()), (None, 0, false));
    assert_eq!(map.insert_point(4, lamp), Err(MarkerMapError::DuplicatePoint { id: 4 }));
    let nowhere = Point::new(f64::INFINITY, 0.0, 0.0);
    assert_eq!(map.insert_point(5, nowhere), Err(MarkerMapError::PointNotFinite { id: 5 }));
    assert_eq!(map.points().collect::<Vec<_>>(), [(4, lamp)]);
}

#[test]
fn the_index_counts_in_the_order_of_the_iteration() {
    let mut map = MarkerMap::default();
    let names = [(TagFamily::Tag16h5, 0), (FAMILY, 9), (FAMILY, 2), (TagFamily::Tag25h9, 5)];
    for (family, id) in names {
        map.insert(family, id, square(0.5)).expect("a square");
    }
    for (k, (family, id, _)) in map.iter().enumerate() {
        assert_eq!(map.index(family, id), Some(k));
    }
    assert_eq!(map.index(FAMILY, 3), None);
}
