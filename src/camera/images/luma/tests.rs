use super::*;

fn offered(formats: &[(&[u8; 4], Option<f64>)]) -> Vec<OfferedFormat> {
    formats
        .iter()
        .map(|(code, fastest_hz)| OfferedFormat { code: **code, fastest_hz: *fastest_hz })
        .collect()
}

#[test]
fn grey_is_taken_before_colours_colours_before_jpeg_and_jpeg_before_nothing() {
    let best = |codes: &[&[u8; 4]]| {
        let formats: Vec<_> = codes.iter().map(|code| (*code, None)).collect();
        choose_layout(&offered(&formats), 20).map(|(code, _)| code)
    };
    assert_eq!(best(&[b"MJPG", b"YUYV"]), Some(*b"YUYV"));
    assert_eq!(best(&[b"YUYV", b"GREY", b"NV12"]), Some(*b"GREY"));
    assert_eq!(best(&[b"MJPG", b"H264"]), Some(*b"MJPG"));
    assert_eq!(best(&[b"H264", b"RGB3", b"BA81"]), None);
}

/// What a usual webcam says at 1280 × 800: USB 2 carries ten uncompressed pictures in a second.
#[test]
fn a_format_that_is_fast_enough_goes_before_a_better_one_that_is_not() {
    let webcam = offered(&[(b"YUYV", Some(10.0)), (b"MJPG", Some(29.97))]);
    let layout_at = |rate_hz| choose_layout(&webcam, rate_hz).map(|(_, layout)| layout);
    assert_eq!(layout_at(10), Some(LumaLayout::EvenBytes));
    assert_eq!(layout_at(20), Some(LumaLayout::Jpeg));
    assert_eq!(layout_at(30), Some(LumaLayout::Jpeg), "29.97 is 30");
    assert_eq!(layout_at(60), Some(LumaLayout::Jpeg), "the fastest if none is fast enough");
    let alike = offered(&[(b"MJPG", Some(15.0)), (b"YUYV", Some(15.0))]);
    assert_eq!(choose_layout(&alike, 60).map(|(code, _)| code), Some(*b"YUYV"));
}

/// Two rows of two pixels with two bytes of padding, written by hand from the kernel's format
/// pages: YUYV is Y0 U Y1 V, UYVY is U Y0 V Y1.
#[test]
fn brightness_is_found_between_colours_and_padding() {
    let yuyv = [10, 1, 20, 2, 0, 0, 30, 3, 40, 4, 0, 0];
    let uyvy = [1, 10, 2, 20, 0, 0, 3, 30, 4, 40, 0, 0];
    let planar = [10, 20, 0, 30, 40, 0, 128, 128];
    let grey = |layout: LumaLayout, row_bytes, buffer: &[u8]| {
        layout.grey([2, 2], row_bytes, buffer).map(|picture| picture.pixels().to_vec())
    };
    assert_eq!(grey(LumaLayout::EvenBytes, 6, &yuyv).unwrap(), [10, 20, 30, 40]);
    assert_eq!(grey(LumaLayout::OddBytes, 6, &uyvy).unwrap(), [10, 20, 30, 40]);
    assert_eq!(grey(LumaLayout::Plane, 3, &planar).unwrap(), [10, 20, 30, 40]);
    assert!(grey(LumaLayout::EvenBytes, 6, &yuyv[..9]).is_err(), "cut");
    assert!(grey(LumaLayout::EvenBytes, 3, &yuyv).is_err(), "rows that overlap");
}

/// 40 × 24 px, written by libjpeg (Pillow, quality 92, 4:2:2) with brightness 40 + 4 x + y and other
/// numbers as colours; then its Huffman tables were cut out, as cameras do.
const NO_TABLES: &[u8] = include_bytes!("no_tables.jpg");
const NO_TABLES_PX: [u32; 2] = [40, 24];

/// The largest difference of a decoded picture from what was written.
fn off(jpeg: &[u8]) -> u32 {
    let picture = LumaLayout::Jpeg.grey(NO_TABLES_PX, 0, jpeg).unwrap();
    let places = (0..24_u32).flat_map(|row| (0..40_u32).map(move |col| 40 + 4 * col + row));
    let pairs = std::iter::zip(picture.pixels(), places);
    pairs.map(|(seen, drawn)| u32::from(*seen).abs_diff(drawn)).max().unwrap()
}

#[test]
fn a_jpeg_of_a_camera_has_the_brightness_that_was_drawn() {
    // Quality 92 rounds the coefficients to 1 to 16 steps; a ramp needs few of them.
    assert!(off(NO_TABLES) <= 3, "{}", off(NO_TABLES));
    // Some cameras do not say AVI1 either: its segment, the first, is 18 bytes long.
    let bare = [&NO_TABLES[..2], &NO_TABLES[20..]].concat();
    assert!(off(&bare) <= 3);
    // Drivers hand on the whole buffer, zeros behind the picture.
    let padded = [NO_TABLES, &[0; 500]].concat();
    assert!(off(&padded) <= 3);
}

#[test]
fn a_damaged_jpeg_and_one_of_another_size_are_refused() {
    let read = |size_px, jpeg: &[u8]| LumaLayout::Jpeg.grey(size_px, 0, jpeg);
    let cut = read(NO_TABLES_PX, &NO_TABLES[..NO_TABLES.len() - 40]).unwrap_err();
    assert!(cut.to_string().contains("no end"), "{cut}");
    for n in [0, 1, 2, 3, 19] {
        assert!(read(NO_TABLES_PX, &NO_TABLES[..n]).is_err());
    }
    assert!(read([24, 40], NO_TABLES).is_err());
    assert!(matches!(
        read([48, 24], NO_TABLES).unwrap_err(),
        PictureError::OtherSize { got: [40, 24], expected: [48, 24] }
    ));
    // Any byte may be wrong: never more than a refusal.
    for at in 0..NO_TABLES.len() {
        let mut damaged = NO_TABLES.to_vec();
        damaged[at] ^= 0xff;
        drop(read(NO_TABLES_PX, &damaged));
    }
}
