//! A camera that looks at the markers of the true hall.
//!
//! [`CameraModel::view`] is the exact picture of the markers; [`CameraSimulator`] takes frames of
//! it at a steady rate and hands them over late, noisy and incomplete, as a detector does.
//! [`PictureCamera`] takes pictures instead, for a real detector.

mod args;
mod lens;
mod line;
mod model;
mod picture;
mod renderer;
mod simulator;
mod view;

pub use args::{CameraArgs, CameraOutput};
pub use lens::Lens;
pub use line::detections_line;
pub use model::{CameraModel, DetectorModel, mounted};
pub use picture::{Picture, PictureCamera, PictureModel};
pub use renderer::Renderer;
pub use simulator::CameraSimulator;
pub use view::SeenTag;

#[cfg(test)]
mod tests;
