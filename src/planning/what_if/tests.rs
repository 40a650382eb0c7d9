use super::*;
use crate::planning::free_space::tests::{marker_map, settings, space_of, walls};

const LAYOUT: Layout = Layout { spacing_m: 3.0, rows_m: (3.5, 6.5), edge_m: 0.6 };

#[test]
fn the_wall_without_markers_is_where_one_more_helps_most() {
    // The wall ahead of the survey's heading, at high x, is bare.
    let map = marker_map(|facing| facing.x > -0.5);
    let mut settings = settings();
    settings.min_fix_quality = 4.0;
    settings.space.grid_m = 2.0;
    settings.space.height_step_m = 4.0;
    settings.space.n_headings = 4;
    let space = space_of(&settings, &map);
    let tags: Vec<[Point<Hall>; 4]> = map.iter().map(|(_, _, corners)| *corners).collect();
    let candidates = candidates(&walls(), &LAYOUT, &tags);
    let what_if = WhatIf::new(&space);
    let mut gains: Vec<Gain> = candidates.iter().map(|c| what_if.gain(c)).collect();
    rank(&mut gains);
    assert_eq!(gains.len(), candidates.len());
    let best = gains[0];
    assert!((best.candidate.place().coords.x - 16.0).abs() < 1e-9, "{best:?}");
    assert!((best.candidate.facing + Vector3::x()).norm() < 1e-12);
    assert!(best.area_m2 > 10.0 && best.n_nodes > 3, "{best:?}");
    // The count by the long way: the free space of a map that has it.
    let mut with_it = map.clone();
    let family = crate::messages::TagFamily::Tag36h11;
    with_it.insert(family, 500, best.candidate.corners).expect("a square");
    let after = space_of(&settings, &with_it);
    let count = |space: &FreeSpace, only_survey: bool| {
        let axes = space.quality().axes();
        let is_free = |node: &usize| space.is_free(&axes.waypoint(*node));
        let counts = |node: &usize| !only_survey || axes.is_of_survey(*node);
        (0..axes.n_nodes()).filter(counts).filter(is_free).count()
    };
    assert_eq!(count(&after, false) - count(&space, false), best.n_nodes);
    let opened = u32::try_from(count(&after, true) - count(&space, true)).expect("few");
    assert!((f64::from(opened) * 4.0 - best.area_m2).abs() < 1e-9, "{opened}");
    // A list of places that differ.
    let few = distinct(&gains, 4.0, 3);
    assert_eq!((few.len(), few[0]), (3, best));
    assert!((few[1].candidate.place() - best.candidate.place()).coords.norm() >= 4.0);
}

#[test]
fn candidates_face_the_hall_and_leave_tags_alone() {
    let free = candidates(&walls(), &LAYOUT, &[]);
    for candidate in &free {
        let p = candidate.place().coords;
        let ahead = p + candidate.facing;
        assert!(walls().contains(ahead.x, ahead.y) && (3.5..6.5).contains(&p.z));
        let [low_left, low_right, _, up_left] = candidate.corners;
        // Right × up points to whoever reads the marker.
        let outwards = (low_right - low_left).coords.cross(&(up_left - low_left).coords);
        assert!((outwards / 0.36 - candidate.facing).norm() < 1e-9);
    }
    let without_one = candidates(&walls(), &LAYOUT, &[free[3].corners]);
    assert_eq!(without_one.len() + 1, free.len());
}
