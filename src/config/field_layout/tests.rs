use super::*;

/// Two tags in the form of `WPILib`: one looks along +x of the field, one along −y and is tilted.
const LAYOUT: &str = r#"{"tags": [
  {"ID": 3, "pose": {"translation": {"x": 0.25, "y": 4.0, "z": 1.5},
    "rotation": {"quaternion": {"W": 1.0, "X": 0.0, "Y": 0.0, "Z": 0.0}}}},
  {"ID": 7, "pose": {"translation": {"x": 8.0, "y": 8.0, "z": 2.0},
    "rotation": {"quaternion": {"W": 0.7071067811865476, "X": 0.0, "Y": 0.0,
      "Z": -0.7071067811865476}}}}],
  "field": {"length": 16.54, "width": 8.21}}"#;

fn is_near(a: &[[f64; 3]; 4], b: &[[f64; 3]; 4]) -> bool {
    a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-12)
}

#[test]
fn corners_follow_from_pose_and_size() {
    let tags = parse(LAYOUT, "36h11", 0.5).unwrap();
    assert_eq!(tags.iter().map(|tag| tag.id).collect::<Vec<_>>(), [3, 7]);
    // Tag 3 on the wall x = 0.25 looks along +x. Who stands before it looks along −x and has +y at
    // the right hand.
    let [y, z] = [4.0, 1.5];
    let expected = [(-0.25, -0.25), (0.25, -0.25), (0.25, 0.25), (-0.25, 0.25)]
        .map(|(right, up)| [0.25, y + right, z + up]);
    assert!(is_near(&tags[0].corners_m, &expected), "{:?}", tags[0]);
    // Tag 7 on the wall y = 8 looks along −y: the onlooker looks along +y and has +x at the right.
    let expected = [(-0.25, -0.25), (0.25, -0.25), (0.25, 0.25), (-0.25, 0.25)]
        .map(|(right, up)| [8.0 + right, 8.0, 2.0 + up]);
    assert!(is_near(&tags[1].corners_m, &expected), "{:?}", tags[1]);
}

#[test]
fn each_fault_says_what_and_which_tag() {
    let refusal = |from: &str, to: &str| {
        assert!(LAYOUT.contains(from), "{from}");
        parse(&LAYOUT.replace(from, to), "36h11", 0.5).unwrap_err()
    };
    let short = refusal("\"W\": 0.7071067811865476", "\"W\": 0.5");
    assert!(matches!(short, LayoutError::NotUnit { id: 7, .. }), "{short}");
    assert!(short.to_string().starts_with("tag 7 has a quaternion of length 0.86"), "{short}");
    assert!(matches!(refusal("\"W\": 1.0", "\"W\": 0.0"), LayoutError::NotUnit { id: 3, .. }));
    for (from, to) in
        [("\"x\": 0.25, ", ""), ("\"ID\": 3", "\"ID\": -3"), ("8.0,", "1e999,"), ("}}}}]", "}}}]")]
    {
        assert!(matches!(refusal(from, to), LayoutError::Json(_)), "{to}");
    }
    assert_eq!(parse(r#"{"tags": []}"#, "36h11", 0.5), Err(LayoutError::Empty));
}
