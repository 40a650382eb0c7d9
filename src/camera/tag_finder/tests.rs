use super::*;
use crate::messages::TagPattern;

const FAMILIES: [TagFamily; 3] = [TagFamily::Tag36h11, TagFamily::Tag25h9, TagFamily::Tag16h5];

/// Tags that hang upright on a white ground, each cell `cell_px` pixels large.
struct Sheet {
    width: usize,
    pixels: Vec<u8>,
}

impl Sheet {
    fn new(width: usize, height: usize) -> Self {
        Self { width, pixels: vec![230; width * height] }
    }

    /// Draws a tag whose upper left corner is at this pixel.
    fn hang(&mut self, family: TagFamily, id: u32, (left, top): (usize, usize), cell_px: usize) {
        let pattern = TagPattern::new(family, id).unwrap();
        let edge_px = usize::from(pattern.n_cells()) * cell_px;
        for row in 0..edge_px {
            for col in 0..edge_px {
                let cell = |at: usize| i32::try_from(at / cell_px).unwrap();
                let grey = if pattern.is_white(cell(col), cell(row)) { 230 } else { 25 };
                self.pixels[(top + row) * self.width + left + col] = grey;
            }
        }
    }

    fn picture(self) -> GreyPicture {
        let height = u32::try_from(self.pixels.len() / self.width).unwrap();
        GreyPicture::new(u32::try_from(self.width).unwrap(), height, self.pixels).unwrap()
    }
}

fn finder(families: &[TagFamily]) -> TagFinder {
    let settings =
        Settings { families: families.to_vec(), bits_corrected: 0, ..Settings::default() };
    TagFinder::new(&settings).unwrap()
}

/// The library has tables of its own: it reads every tag of every family as the pattern it is, upright,
/// with its corners where they were drawn. Edges along the pixels without any blur are the worst
/// case for a fit of a blurred edge.
#[test]
fn the_detector_reads_every_pattern() {
    const CELL_PX: usize = 6;
    const PITCH_PX: usize = 84;
    for family in FAMILIES {
        let mut finder = finder(&[family]);
        let edge_px = usize::from(family.n_cells()) * CELL_PX;
        let ids: Vec<u32> = (0..family.n_tags()).collect();
        for some in ids.chunks(80) {
            let mut sheet = Sheet::new(10 * PITCH_PX, 8 * PITCH_PX);
            let place = |i: usize| (i % 10 * PITCH_PX + 18, i / 10 * PITCH_PX + 17);
            some.iter().enumerate().for_each(|(i, id)| sheet.hang(family, *id, place(i), CELL_PX));
            let found = finder.find(&sheet.picture()).unwrap();
            let read: Vec<u32> = found.tags.iter().map(|tag| tag.id).collect();
            assert_eq!(read, some, "{}", family.name());
            for (i, tag) in found.tags.iter().enumerate() {
                let (left, top) = place(i);
                let [left, top, edge] = [left, top, edge_px].map(|px| px as f64);
                let expected = [
                    [left, top + edge],
                    [left + edge, top + edge],
                    [left + edge, top],
                    [left, top],
                ];
                for (seen, drawn) in tag.corners_px.iter().flatten().zip(expected.iter().flatten())
                {
                    assert!((seen - drawn).abs() < 0.2, "{}: {seen} {drawn}", tag.id);
                }
            }
        }
    }
}

#[test]
fn families_are_told_apart_and_others_left_alone() {
    let picture = || {
        let mut sheet = Sheet::new(400, 150);
        sheet.hang(TagFamily::Tag36h11, 7, (30, 30), 8);
        sheet.hang(TagFamily::Tag25h9, 7, (150, 30), 8);
        sheet.hang(TagFamily::Tag16h5, 7, (270, 30), 8);
        sheet.picture()
    };
    let names = |found: FoundTags| found.tags.iter().map(|t| (t.family, t.id)).collect::<Vec<_>>();
    let all = finder(&FAMILIES).find(&picture()).unwrap();
    assert_eq!(names(all), FAMILIES.map(|family| (family, 7)));
    let one = finder(&[TagFamily::Tag25h9]).find(&picture()).unwrap();
    assert_eq!(names(one), [(TagFamily::Tag25h9, 7)]);
}

#[test]
fn a_tag_that_hangs_twice_is_taken_in_neither_place() {
    let mut sheet = Sheet::new(400, 150);
    sheet.hang(TagFamily::Tag36h11, 3, (30, 30), 8);
    sheet.hang(TagFamily::Tag36h11, 3, (150, 30), 8);
    sheet.hang(TagFamily::Tag36h11, 4, (270, 30), 8);
    let found = finder(&[TagFamily::Tag36h11]).find(&sheet.picture()).unwrap();
    assert_eq!(found.tags.iter().map(|tag| tag.id).collect::<Vec<_>>(), [4]);
    assert_eq!(found.n_left_out, 2);
}

#[test]
fn a_faint_tag_is_left_out() {
    let mut sheet = Sheet::new(200, 150);
    sheet.hang(TagFamily::Tag36h11, 3, (30, 30), 8);
    sheet.pixels.iter_mut().for_each(|grey| *grey = 120 + *grey / 16);
    let found = finder(&[TagFamily::Tag36h11]).find(&sheet.picture()).unwrap();
    assert_eq!((found.tags.len(), found.n_left_out), (0, 1));
}
