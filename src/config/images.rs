//! Cameras whose tags stockpilot finds itself, and the detector.

use super::convert::{invalid, seconds, within};
use super::error::ConfigError;
use super::file::Config;
use crate::camera::images::{self, Source};
use crate::camera::tag_finder;
use crate::messages::{CameraId, TagFamily};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::time::Duration;

/// Which kind of source a camera's pictures have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SourceName {
    /// A video device of the kernel.
    V4l2,
    /// A folder that PNG and PGM files are moved into.
    Folder,
    /// A Unix socket that takes PGM pictures one after the other.
    PgmStream,
}

/// Where the pictures of a camera come from. Without it an external detector sends the tags.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImagesSection {
    /// `v4l2`, `folder` or `pgm-stream`.
    pub source: SourceName,
    /// The device, folder or socket.
    pub path: PathBuf,
    /// For pictures that carry no stamp: from the middle of the exposure of the middle row to the arrival, ms. A
    /// video device's pictures are stamped by the kernel, and this is taken off its stamps beside half
    /// the exposure and half the readout; 0 if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stamp_delay_ms: Option<f64>,
    /// Frames asked of a video device, 1/s.
    #[serde(default = "default_frames_per_s")]
    pub frames_per_s: u32,
    /// Fixed exposure of a video device, ms; the camera decides for itself without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_ms: Option<f64>,
}

const fn default_frames_per_s() -> u32 {
    20
}

/// The own tag detector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DetectorSection {
    /// Families that hang in the hall: `36h11`, `25h9`, `16h5`.
    pub families: Vec<String>,
    /// Tags are looked for in a picture this many times smaller: 1, 1.5, 2 …
    pub decimation: f32,
    /// Wrong bits that are corrected, 0 to 2.
    pub bits_corrected: usize,
    /// Detections whose bits stand out less are left out, of 255.
    pub min_decision_margin: f64,
}

impl Default for DetectorSection {
    fn default() -> Self {
        let settings = tag_finder::Settings::default();
        Self {
            families: settings.families.iter().map(|family| family.name().to_owned()).collect(),
            decimation: settings.decimation,
            bits_corrected: settings.bits_corrected,
            min_decision_margin: settings.min_decision_margin,
        }
    }
}

impl DetectorSection {
    fn settings(&self) -> Result<tag_finder::Settings, ConfigError> {
        let family = |name: &String| {
            let refuse =
                || invalid("detector.families", format!("{name:?} is not 36h11, 25h9 or 16h5"));
            TagFamily::from_name(name).ok_or_else(refuse)
        };
        let families = self.families.iter().map(family).collect::<Result<Vec<_>, _>>()?;
        if families.is_empty() {
            return Err(invalid("detector.families", "is empty"));
        }
        within("detector.decimation", f64::from(self.decimation), (1.0, 8.0), "")?;
        if self.bits_corrected > 2 {
            return Err(invalid("detector.bits_corrected", "is 0 to 2"));
        }
        let margin = self.min_decision_margin;
        Ok(tag_finder::Settings {
            families,
            decimation: self.decimation,
            bits_corrected: self.bits_corrected,
            min_decision_margin: within("detector.min_decision_margin", margin, (0.0, 255.0), "")?,
        })
    }
}

impl ImagesSection {
    fn source(&self, key: &dyn Fn(&str) -> String) -> Result<Source, ConfigError> {
        let path = self.path.clone();
        Ok(match self.source {
            SourceName::Folder => Source::Folder { path },
            SourceName::PgmStream => Source::PgmStream { path },
            SourceName::V4l2 => {
                let rate = f64::from(self.frames_per_s);
                within(&key("frames_per_s"), rate, (1.0, 240.0), "1/s")?;
                let exposure = self.exposure_ms.map(|ms| milliseconds(&key("exposure_ms"), ms));
                let exposure = exposure.transpose()?;
                Source::V4l2 { device: path, frames_per_s: self.frames_per_s, exposure }
            }
        })
    }

    fn stamp_delay(&self, key: &dyn Fn(&str) -> String) -> Result<Option<Duration>, ConfigError> {
        let delay = self.stamp_delay_ms.map(|ms| milliseconds(&key("stamp_delay_ms"), ms));
        delay.transpose()
    }
}

fn milliseconds(key: &str, value_ms: f64) -> Result<Duration, ConfigError> {
    seconds(key, value_ms / 1e3, (0.0, 1.0))
}

impl Config {
    /// The cameras whose tags are found here.
    ///
    /// # Errors
    /// A value that cannot be, or a source without what it needs.
    pub fn image_settings(&self) -> Result<Vec<images::Settings>, ConfigError> {
        let detector = self.detector.settings()?;
        let mut all = Vec::new();
        for (number, (index, section)) in (0..).zip(self.cameras.iter().enumerate()) {
            let Some(images) = &section.images else { continue };
            let key = |name: &str| format!("cameras[{index}].images.{name}");
            all.push(images::Settings {
                camera: CameraId(number),
                size_px: section.intrinsics(index)?.size_px,
                readout: section.model(index)?.readout,
                source: images.source(&key)?,
                stamp_delay: images.stamp_delay(&key)?,
                detector: detector.clone(),
            });
        }
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn section(source: SourceName) -> ImagesSection {
        ImagesSection {
            source,
            path: "/dev/video0".into(),
            stamp_delay_ms: None,
            frames_per_s: 20,
            exposure_ms: Some(4.0),
        }
    }

    #[test]
    fn a_video_device_gets_its_exposure_and_a_delay_only_if_it_is_told() {
        let key = |name: &str| name.to_owned();
        let bare = section(SourceName::V4l2);
        assert_eq!(bare.stamp_delay(&key).unwrap(), None);
        let told = ImagesSection { stamp_delay_ms: Some(21.5), ..bare };
        assert_eq!(told.stamp_delay(&key).unwrap(), Some(Duration::from_micros(21_500)));
        let negative = ImagesSection { stamp_delay_ms: Some(-1.0), ..told.clone() };
        assert!(negative.stamp_delay(&key).unwrap_err().to_string().contains("stamp_delay_ms"));
        let Source::V4l2 { exposure, .. } = told.source(&key).unwrap() else { panic!() };
        assert_eq!(exposure, Some(Duration::from_millis(4)));
    }

    #[test]
    fn a_detector_without_sense_is_refused() {
        let refusal = |section: DetectorSection| section.settings().unwrap_err().to_string();
        let usual = DetectorSection::default;
        assert_eq!(usual().settings().unwrap(), tag_finder::Settings::default());
        assert!(refusal(DetectorSection { families: vec![], ..usual() }).contains("families"));
        let aruco = vec!["4x4_50".to_owned()];
        assert!(refusal(DetectorSection { families: aruco, ..usual() }).contains("4x4_50"));
        assert!(refusal(DetectorSection { decimation: 0.5, ..usual() }).contains("decimation"));
        assert!(refusal(DetectorSection { bits_corrected: 3, ..usual() }).contains("bits"));
    }
}
