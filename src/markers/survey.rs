//! `stockpilot markers survey`: the marker map from the log of a carried flight.

use super::constraints::{ConstraintError, Constraints, TagName};
use crate::config::{Config, ConfigError, TagSection};
use crate::geometry::Point;
use crate::localization::map_adjustment::{
    self as adjustment, AdjustError, AdjustedMap, KnownTag, Sighting, Survey, Tape, View,
};
use crate::localization::vision_fix::{PointFeature, Settings, Start, solve_from};
use crate::messages::{CameraId, TagDetections};
use crate::pilot::Event;
use crate::record::{LogItem, LogReader, RecordedEvent};
use crate::time::{Mono, Stamp};
use nalgebra::Vector2;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// How a log is evaluated.
#[derive(Debug, Clone, PartialEq)]
pub struct SurveyRequest {
    /// Tags whose places in the log's configuration are trusted.
    pub fixed: Vec<TagName>,
    /// σ of each of their corners, each axis, m.
    pub fixed_sigma_m: f64,
    /// Edge of tags that neither the configuration nor the constraints tell, m.
    pub edge_m: Option<f64>,
    /// σ of the common factor of all edges.
    pub scale_sigma: f64,
    /// Frames of a camera that follow each other faster are left out, s.
    pub every_s: f64,
    /// σ of a corner, px; that of the log's configuration if left out.
    pub corner_sigma_px: Option<f64>,
    /// Known places, tapes and edges beside the configuration.
    pub constraints: Constraints,
}

/// A log that gives no map.
#[derive(Debug, thiserror::Error)]
pub enum SurveyError {
    /// The log cannot be opened.
    #[error("{}: {source}", path.display())]
    Open {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// There is no configuration at its head.
    #[error("{}: no configuration at its head, is this a log of stockpilot?", path.display())]
    NoConfig {
        /// Which.
        path: PathBuf,
    },
    /// The configuration does not work with this build.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The constraints contradict the rest.
    #[error(transparent)]
    Constraint(#[from] ConstraintError),
    /// A tag without a size.
    #[error(
        "tag {0} was seen, but nothing tells its edge: --edge-m, or [[edges]] in the constraints"
    )]
    NoEdge(TagName),
    /// No frame with a tag.
    #[error("the log holds no frame with tags")]
    NoFrames,
    /// The adjustment fails.
    #[error(transparent)]
    Adjust(#[from] AdjustError),
}

/// A surveyed tag.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SurveyedTag {
    /// Its name.
    pub name: TagName,
    /// Its middle, m.
    pub place_m: [f64; 3],
    /// σ of its middle, each axis, m.
    pub sigma_m: [f64; 3],
    /// σ of its attitude about its own axes right, up, out, deg.
    pub turn_sigma_deg: [f64; 3],
    /// Frames in which it counted.
    pub n_views: usize,
    /// It held the axes.
    pub is_known: bool,
    /// Its corners, m.
    pub corners_m: [[f64; 3]; 4],
}

/// A tape against the map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TapeLine {
    /// From the middle of this tag.
    pub from: TagName,
    /// To the middle of this one.
    pub to: TagName,
    /// Measured, m.
    pub measured_m: f64,
    /// In a map that did not use this tape, m.
    pub predicted_m: f64,
    /// σ of the difference, m.
    pub sigma_m: f64,
    /// It was used for the final map.
    pub is_used: bool,
    /// The difference is within 2σ.
    pub agrees: bool,
}

/// How well frames fit that the map was not made of.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct HeldOut {
    /// Frames held out that fix their pose.
    pub n_frames: usize,
    /// χ² of their corners over its degrees of freedom.
    pub variance_factor: f64,
    /// The same of the frames the map was made of.
    pub variance_factor_used: f64,
    /// The map explains what it has not seen about as well: less than one and a half times the variance.
    pub agrees: bool,
}

/// The answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SurveyReport {
    /// The tags of the new map.
    pub tags: Vec<SurveyedTag>,
    /// Tags that were seen but that no chain of frames ties to the known ones.
    pub not_tied: Vec<TagName>,
    /// Frames with tags in the log, after thinning.
    pub n_frames: usize,
    /// Of them, used.
    pub n_frames_used: usize,
    /// Corners used.
    pub n_corners: usize,
    /// Corners left out as wrong.
    pub n_outliers: usize,
    /// Root mean square of the residuals, each coordinate, px.
    pub residual_rms_px: f64,
    /// χ² over its degrees of freedom.
    pub variance_factor: f64,
    /// Root mean square of the σ of all tags along all axes, m: `surface.uncertainty.marker_sigma_m`.
    pub marker_sigma_m: f64,
    /// True edges over those that were told.
    pub edge_factor: f64,
    /// Its σ.
    pub edge_factor_sigma: f64,
    /// Frames held out.
    pub held_out: Option<HeldOut>,
    /// Tapes, each predicted without itself.
    pub tapes: Vec<TapeLine>,
    /// The log has its proper end.
    pub is_complete: bool,
}

/// Each so-manieth frame is held out for the check.
const HELD_OUT_EVERY: usize = 5;
/// No more frames than this; a longer log is thinned.
const MAX_FRAMES: usize = 1200;

/// A survey by names, ready to be adjusted.
struct Named {
    names: Vec<TagName>,
    survey: Survey,
    /// Tapes that only check.
    checks: Vec<Tape>,
}

/// Makes the marker map of a log.
///
/// # Errors
/// [`SurveyError`] says what is missing.
pub fn survey(log: &Path, request: &SurveyRequest) -> Result<SurveyReport, SurveyError> {
    let (config, frames, is_complete) = read(log)?;
    let frames = thinned(frames, request.every_s);
    if frames.is_empty() {
        return Err(SurveyError::NoFrames);
    }
    let named = named(&config, &frames, request)?;
    let map = adjustment::adjust(&named.survey)?;
    let held_out = held_out(&named.survey);
    Ok(report(&named, &map, held_out, is_complete))
}

fn read(log: &Path) -> Result<(Config, Vec<TagDetections>, bool), SurveyError> {
    let open = |source| SurveyError::Open { path: log.to_owned(), source };
    let mut reader = LogReader::open(log).map_err(open)?;
    let Some(LogItem::Config { config_toml, .. }) = reader.next() else {
        return Err(SurveyError::NoConfig { path: log.to_owned() });
    };
    let config = Config::from_log(&config_toml, log)?;
    let mut frames = Vec::new();
    for item in reader.by_ref() {
        if let LogItem::Event { event: RecordedEvent::Plain(Event::TagsSeen(frame)), .. } = item
            && !frame.tags.is_empty()
        {
            frames.push(frame);
        }
    }
    Ok((config, frames, reader.is_complete()))
}

/// In the order of exposure, at most one of each camera in this time.
fn thinned(mut frames: Vec<TagDetections>, every_s: f64) -> Vec<TagDetections> {
    frames.sort_by_key(|frame| (frame.captured_at, frame.camera));
    let mut last: BTreeMap<CameraId, Stamp<Mono>> = BTreeMap::new();
    frames.retain(|frame| {
        let before = last.get(&frame.camera);
        let is_due = before.is_none_or(|at| frame.captured_at.seconds_since(*at) >= every_s);
        if is_due {
            last.insert(frame.camera, frame.captured_at);
        }
        is_due
    });
    let step = frames.len().div_ceil(MAX_FRAMES).max(1);
    frames.into_iter().step_by(step).collect()
}

fn named(
    config: &Config,
    frames: &[TagDetections],
    request: &SurveyRequest,
) -> Result<Named, SurveyError> {
    let settings = config.pilot_settings()?.localization;
    let constraints = &request.constraints;
    let mut index: BTreeMap<TagName, usize> = BTreeMap::new();
    let seen = frames.iter().flat_map(|f| f.tags.iter().map(|t| TagName::new(t.family, t.id)));
    for name in seen.chain(request.fixed.iter().copied()).chain(constraints.names()) {
        index.insert(name, 0);
    }
    for (k, place) in index.values_mut().enumerate() {
        *place = k;
    }
    let names: Vec<TagName> = index.keys().copied().collect();
    let mapped = |name: &TagName| settings.marker_map.corners(name.family, name.id);
    let edge_m = |name: &TagName| {
        let of_map = || mapped(name).map(mean_edge_m);
        let told = constraints.edge_m(*name).or_else(of_map).or(request.edge_m);
        told.ok_or(SurveyError::NoEdge(*name))
    };
    let edges_m = names.iter().map(edge_m).collect::<Result<_, _>>()?;
    let mut known = Vec::new();
    for name in &request.fixed {
        let corners = mapped(name).ok_or(ConstraintError::NotMapped(*name))?;
        let hall_from_tag = adjustment::pose_of_corners(corners);
        let corner_sigma_m = request.fixed_sigma_m;
        known.push(KnownTag { tag: index[name], hall_from_tag, corner_sigma_m });
    }
    for place in &constraints.known {
        let name: TagName = place.tag;
        let corners = place.corners_m.map(|[x, y, z]| Point::new(x, y, z));
        let hall_from_tag = adjustment::pose_of_corners(&corners);
        known.push(KnownTag { tag: index[&name], hall_from_tag, corner_sigma_m: place.sigma_m });
    }
    let tape = |tape: &super::constraints::TapeSection| Tape {
        tags: [index[&tape.from], index[&tape.to]],
        distance_m: tape.distance_m,
        sigma_m: tape.sigma_m,
    };
    let used = constraints.tapes.iter().filter(|t| !t.check).map(tape).collect();
    let checks = constraints.tapes.iter().filter(|t| t.check).map(tape).collect();
    let view = |frame: &TagDetections| View {
        camera: usize::from(frame.camera.0),
        sightings: frame
            .tags
            .iter()
            .map(|tag| Sighting {
                tag: index[&TagName::new(tag.family, tag.id)],
                corners_px: tag.corners_px,
            })
            .collect(),
    };
    let n_cameras = settings.cameras.len();
    let views = frames.iter().map(view).filter(|view| view.camera < n_cameras).collect();
    let survey = Survey {
        cameras: settings.cameras,
        edges_m,
        views,
        known,
        tapes: used,
        corner_sigma_px: request.corner_sigma_px.unwrap_or(settings.vision.corner_sigma_px),
        scale_sigma: request.scale_sigma,
    };
    Ok(Named { names, survey, checks })
}

fn mean_edge_m(corners: &[Point<crate::geometry::Hall>; 4]) -> f64 {
    (0..4).map(|k| (corners[k] - corners[(k + 1) % 4]).coords.norm()).sum::<f64>() / 4.0
}

/// Makes the map of four fifths of the frames and fits the rest to it.
#[expect(clippy::cast_precision_loss, reason = "counts of corners")]
fn held_out(survey: &Survey) -> Option<HeldOut> {
    let is_out = |v: usize| v % HELD_OUT_EVERY == HELD_OUT_EVERY - 1;
    let pick = |out: bool| {
        let views = survey.views.iter().enumerate().filter(move |(v, _)| is_out(*v) == out);
        views.map(|(_, view)| view.clone()).collect::<Vec<_>>()
    };
    let map = adjustment::adjust(&Survey { views: pick(false), ..survey.clone() }).ok()?;
    let settings =
        Settings { corner_sigma_px: survey.corner_sigma_px, max_position_sigma_m: f64::INFINITY };
    let (mut squares, mut dof, mut n_frames) = (0.0, 0.0, 0);
    for view in pick(true) {
        let mut features = Vec::new();
        for sighting in &view.sightings {
            let Some(corners) = map.corners(sighting.tag, survey.edges_m[sighting.tag]) else {
                continue;
            };
            features.extend(
                corners
                    .into_iter()
                    .zip(sighting.corners_px)
                    .map(|(place, pixel)| PointFeature { place, pixel: Vector2::from(pixel) }),
            );
        }
        let start = Start::Cold { gravity_body: None };
        let Ok(fix) = solve_from(&survey.cameras[view.camera], &features, start, &settings) else {
            continue;
        };
        let n_rows = 2 * fix.n_points;
        squares += fix.residual_rms_px.powi(2) * n_rows as f64;
        dof += (n_rows - 6) as f64;
        n_frames += 1;
    }
    let variance_factor = squares / dof / survey.corner_sigma_px.powi(2);
    (n_frames > 0 && dof > 0.0).then_some(HeldOut {
        n_frames,
        variance_factor,
        variance_factor_used: map.variance_factor,
        agrees: variance_factor < 1.5 * map.variance_factor.max(0.2),
    })
}

fn report(
    named: &Named,
    map: &AdjustedMap,
    held_out: Option<HeldOut>,
    is_complete: bool,
) -> SurveyReport {
    let Named { names, survey, .. } = named;
    let tag = |(k, name): (usize, &TagName)| {
        let pose = map.tags[k]?;
        let cov = map.pose_cov(k)?;
        let sigma = |row: usize| cov[(row, row)].max(0.0).sqrt();
        Some(SurveyedTag {
            name: *name,
            place_m: pose.origin.coords.into(),
            sigma_m: [0, 1, 2].map(sigma),
            turn_sigma_deg: [3, 4, 5].map(|row| sigma(row).to_degrees()),
            n_views: map.n_views[k],
            is_known: survey.known.iter().any(|known| known.tag == k),
            corners_m: map.corners(k, survey.edges_m[k])?.map(|corner| corner.coords.into()),
        })
    };
    let is_seen = |k: usize| {
        survey.views.iter().any(|view| view.sightings.iter().any(|sighting| sighting.tag == k))
    };
    let open = names.iter().enumerate().filter(|(k, _)| map.tags[*k].is_none() && is_seen(*k));
    let tags: Vec<SurveyedTag> = names.iter().enumerate().filter_map(tag).collect();
    SurveyReport {
        marker_sigma_m: rms_sigma_m(&tags),
        tags,
        not_tied: open.map(|(_, name)| *name).collect(),
        n_frames: survey.views.len(),
        n_frames_used: map.bodies.iter().flatten().count(),
        n_corners: map.n_corners,
        n_outliers: map.n_outliers,
        residual_rms_px: map.residual_rms_px,
        variance_factor: map.variance_factor,
        edge_factor: map.edge_factor,
        edge_factor_sigma: map.edge_factor_sigma,
        held_out,
        tapes: tape_lines(named, map),
        is_complete,
    }
}

/// The one σ that the budget has for the places of all markers, m.
fn rms_sigma_m(tags: &[SurveyedTag]) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "counts of tags")]
    let n_axes = (3 * tags.len()).max(1) as f64;
    let squares: f64 = tags.iter().flat_map(|tag| tag.sigma_m).map(|sigma| sigma * sigma).sum();
    (squares / n_axes).sqrt()
}

/// Each tape against a map without it.
fn tape_lines(named: &Named, map: &AdjustedMap) -> Vec<TapeLine> {
    let line = |tape: &Tape, map: &AdjustedMap, is_used: bool| {
        let (predicted_m, map_sigma_m) = map.distance(tape.tags)?;
        let sigma_m = map_sigma_m.hypot(tape.sigma_m);
        Some(TapeLine {
            from: named.names[tape.tags[0]],
            to: named.names[tape.tags[1]],
            measured_m: tape.distance_m,
            predicted_m,
            sigma_m,
            is_used,
            agrees: (tape.distance_m - predicted_m).abs() <= 2.0 * sigma_m,
        })
    };
    let mut lines: Vec<TapeLine> =
        named.checks.iter().filter_map(|tape| line(tape, map, false)).collect();
    for (k, tape) in named.survey.tapes.iter().enumerate() {
        let mut without = named.survey.clone();
        without.tapes.remove(k);
        let predicted = adjustment::adjust(&without).ok();
        lines.extend(predicted.and_then(|map| line(tape, &map, true)));
    }
    lines
}

impl SurveyReport {
    /// The tags as sections of a configuration, or of a marker file.
    #[must_use]
    pub fn sections(&self) -> Vec<TagSection> {
        let section = |tag: &SurveyedTag| TagSection {
            family: tag.name.family.name().to_owned(),
            id: tag.name.id,
            corners_m: tag.corners_m,
            faces_away: false,
        };
        self.tags.iter().map(section).collect()
    }
}
