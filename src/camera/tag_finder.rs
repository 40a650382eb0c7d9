//! Finds tags in grey pictures.
//!
//! The work is done by the reference library, `AprilTag` 3 in C (Wang and Olson 2016): adaptive
//! threshold, borders between dark and bright, quadrilaterals on the picture shrunk by
//! [`Settings::decimation`], edges refined on the full picture, bits. What is added here: edges are
//! fitted once more, to all pixels near them, doubtful detections are left out, and a tag that seems
//! to hang in two places (a mirror, a copy) is taken in neither.

mod edges;

use super::picture::GreyPicture;
use crate::messages::{TagDetection, TagFamily};
use apriltag::{Detector, Family, Image};

/// What is looked for, and what is believed.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The families that hang in the hall: each further one costs a whole search more and makes
    /// more chance readings.
    pub families: Vec<TagFamily>,
    /// Quadrilaterals are looked for in a picture this many times smaller; corners are refined on
    /// the full one.
    pub decimation: f32,
    /// Wrong bits that are corrected, 0 to 2.
    pub bits_corrected: usize,
    /// Detections with a smaller margin are left out: how far the brightness of a bit is from the
    /// threshold, mean over all bits, of 255.
    pub min_decision_margin: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            families: vec![TagFamily::Tag36h11],
            decimation: 1.5,
            bits_corrected: 1,
            min_decision_margin: 20.0,
        }
    }
}

/// Why nothing can be found.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the tag detector refuses: {cause}")]
pub struct TagFinderError {
    /// What the library says.
    pub cause: String,
}

impl From<apriltag::Error> for TagFinderError {
    fn from(error: apriltag::Error) -> Self {
        Self { cause: error.to_string() }
    }
}

/// What was found in one picture.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FoundTags {
    /// The tags, in order of family and id.
    pub tags: Vec<TagDetection>,
    /// Detections that were left out because they are doubtful or hang twice.
    pub n_left_out: u64,
}

/// The detector; it stays in the thread that made it.
#[derive(Debug)]
pub struct TagFinder {
    /// One for each family: the library does not tell which family it found.
    detectors: Vec<(TagFamily, Detector)>,
    min_decision_margin: f64,
}

impl TagFinder {
    /// A detector with these settings.
    ///
    /// # Errors
    /// What the library refuses.
    pub fn new(settings: &Settings) -> Result<Self, TagFinderError> {
        let detector = |family: &TagFamily| {
            let builder = Detector::builder();
            let mut detector = builder
                .add_family_bits(library_family(*family), settings.bits_corrected)
                .build()?;
            detector.set_thread_number(1);
            detector.set_decimation(settings.decimation);
            detector.set_refine_edges(true);
            Ok((*family, detector))
        };
        let detectors =
            settings.families.iter().map(detector).collect::<Result<_, TagFinderError>>()?;
        Ok(Self { detectors, min_decision_margin: settings.min_decision_margin })
    }

    /// The tags of one picture, corners as in [`TagDetection::corners_px`].
    ///
    /// # Errors
    /// If the library cannot get memory for the picture.
    pub fn find(&mut self, picture: &GreyPicture) -> Result<FoundTags, TagFinderError> {
        let image = library_image(picture)?;
        let mut tags = Vec::new();
        let mut n_left_out = 0;
        for (family, detector) in &mut self.detectors {
            for found in detector.detect(&image) {
                let decision_margin = f64::from(found.decision_margin());
                match u32::try_from(found.id()) {
                    Ok(id) if decision_margin >= self.min_decision_margin => {
                        let corners_px = edges::refined(picture, found.corners(), family.n_cells());
                        tags.push(TagDetection {
                            id,
                            family: *family,
                            corners_px,
                            decision_margin,
                        });
                    }
                    _ => n_left_out += 1,
                }
            }
        }
        tags.sort_by_key(|tag| (tag.family, tag.id));
        let n_before = tags.len();
        let name = |tag: &TagDetection| (tag.family, tag.id);
        let tags: Vec<_> = tags
            .chunk_by(|a, b| name(a) == name(b))
            .filter_map(|same| if let [only] = same { Some(*only) } else { None })
            .collect();
        n_left_out += n_before - tags.len();
        Ok(FoundTags { tags, n_left_out: n_left_out as u64 })
    }
}

fn library_family(family: TagFamily) -> Family {
    match family {
        TagFamily::Tag36h11 => Family::tag_36h11(),
        TagFamily::Tag25h9 => Family::tag_25h9(),
        TagFamily::Tag16h5 => Family::tag_16h5(),
    }
}

/// The picture in the library's own memory, with its rows aligned as the library likes them.
fn library_image(picture: &GreyPicture) -> Result<Image, TagFinderError> {
    /// The library's default.
    const ALIGNMENT: usize = 96;
    let (width, height) = (picture.width_px() as usize, picture.height_px() as usize);
    let mut image = Image::zeros_with_alignment(width, height, ALIGNMENT)?;
    let stride = image.stride();
    let rows = image.as_slice_mut().chunks_exact_mut(stride);
    for (row, pixels) in rows.zip(picture.pixels().chunks_exact(width)) {
        row[..width].copy_from_slice(pixels);
    }
    Ok(image)
}

#[cfg(test)]
mod tests;
