//! Somebody carries the vehicle through the hall so that the tags can be surveyed: a log of what its camera sees,
//! and what a tape measure says.

use crate::camera::{CameraModel, CameraSimulator};
use crate::hall::{Devices, config};
use crate::scenario::Scenario;
use crate::world::{PlacedTag, World};
use anyhow::Context;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;
use std::time::Duration;
use stockpilot::config::TagSection;
use stockpilot::geometry::{Body, Hall, Point, Rotation, Transform};
use stockpilot::messages::TagDetections;
use stockpilot::pilot::Event;
use stockpilot::record::{LogHeader, Recorder};
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::{Mono, Stamp};

/// How long the walk takes.
const WALK: Duration = Duration::from_secs(330);
/// Eyes of a person over the ground, m.
const CARRIED_M: f64 = 1.6;
/// The vehicle is turned around once in this time, s, and nods in this one.
const TURN_S: f64 = 19.0;
const NOD_S: f64 = 7.0;
/// The camera looks 10° down; held up, it sees the upper rows.
const NOD_RAD: (f64, f64) = (-0.45, 0.25);
/// A tape over some metres, and a total station's target on a sheet, m.
const TAPE_SIGMA_M: f64 = 0.003;
const KNOWN_SIGMA_M: f64 = 0.002;
/// How much a printer shrinks or stretches, relative.
pub const PRINTER_SIGMA: f64 = 0.002;

/// What a carried survey leaves behind.
#[derive(Debug)]
pub struct Carried {
    /// What a person writes down: `[[known]]`, `[[tapes]]`, `[[edges]]`.
    pub constraints_toml: String,
    /// All tags of the hall, as they hang.
    pub truth: Vec<PlacedTag>,
}

impl Carried {
    /// The truth as `[[tags]]` sections.
    #[must_use]
    pub fn truth_toml(&self) -> String {
        let tag = |tag: &PlacedTag| {
            let corners =
                tag.corners.map(|c| format!("[{}, {}, {}]", c.coords.x, c.coords.y, c.coords.z));
            let (family, id) = (tag.family.name(), tag.id);
            format!(
                "[[tags]]\nfamily = \"{family}\"\nid = {id}\ncorners_m = [{}]\n",
                corners.join(", ")
            )
        };
        self.truth.iter().map(tag).collect()
    }
}

/// Carries the camera through the scenario's hall and writes the log; the file must not exist.
///
/// # Errors
/// A log that cannot be written, a hall with too few tags.
pub fn carry(scenario: &Scenario, log: &Path) -> anyhow::Result<Carried> {
    let world = &scenario.world;
    let mut config = config(scenario, Devices::none());
    // The service must know one tag to start at all; here that is the first known one.
    let known = known_tags(world)?;
    config.tags = vec![section(known[0])];
    let header = LogHeader {
        started_at: Stamp::ZERO,
        config_toml: config.to_toml()?,
        notes: BTreeMap::from([("carried".to_owned(), "simulated".to_owned())]),
        body_from_lidar: None,
    };
    let mut recorder = Recorder::create(log, &header)?.waiting();
    for frame in frames(world, &scenario.camera, scenario.seed) {
        recorder.event(frame.received_at, &Event::TagsSeen(frame.clone()));
    }
    let stats = recorder.close();
    let n_lost = stats.lost_in_queue + stats.lost_on_disk;
    anyhow::ensure!(n_lost == 0, "{n_lost} records were lost");
    let noise = SeedBook::new(scenario.seed).stream("carry.tape");
    Ok(Carried { constraints_toml: constraints(world, &known, noise), truth: world.tags.clone() })
}

/// Every frame of the walk.
fn frames(world: &World, camera: &CameraModel, seed: u64) -> Vec<TagDetections> {
    let mut simulator = CameraSimulator::new(camera.clone(), SeedBook::new(seed), Stamp::ZERO);
    let end = Stamp::ZERO.plus(WALK + Duration::from_secs(1));
    simulator.advance(world, end, |at| pose(world, at))
}

/// Around near the walls, around half way in, and around farther in; turning and nodding all the time.
fn pose(world: &World, at: Stamp<Mono>) -> Transform<Hall, Body> {
    let t_s = at.seconds();
    let share = (t_s / WALK.as_secs_f64()).min(1.0);
    let (low, high) = (world.hall.min_m, world.hall.max_m);
    let across_m = (high.x - low.x).min(high.y - low.y);
    let inset_m = match 3.0 * share {
        first if first < 1.0 => 1.2,
        second if second < 2.0 => 0.27 * across_m,
        _ => 0.38 * across_m,
    };
    let corners = [
        [low.x + inset_m, low.y + inset_m],
        [high.x - inset_m, low.y + inset_m],
        [high.x - inset_m, high.y - inset_m],
        [low.x + inset_m, high.y - inset_m],
    ];
    let along = 4.0 * (3.0 * share).fract();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 4")]
    let side = along.floor() as usize % 4;
    let (from, to, part) = (corners[side], corners[(side + 1) % 4], along.fract());
    let [x, y] = [0, 1].map(|k| from[k] + (to[k] - from[k]) * part);
    let z = world.height_at(x, y) + CARRIED_M + 0.1 * (TAU * t_s / 1.1).sin();
    let nod = 0.5 - 0.5 * (TAU * t_s / NOD_S).cos();
    let pitch = NOD_RAD.0 + (NOD_RAD.1 - NOD_RAD.0) * nod;
    let roll = 0.08 * (TAU * t_s / 3.3).sin();
    Transform::new(Rotation::from_euler_rad(roll, pitch, TAU * t_s / TURN_S), Point::new(x, y, z))
}

/// One tag in the middle of each wall, low enough to be reached.
fn known_tags(world: &World) -> anyhow::Result<Vec<&PlacedTag>> {
    let (low, high) = (world.hall.min_m, world.hall.max_m);
    let walls = [
        [high.x, 0.5 * (low.y + high.y)],
        [0.5 * (low.x + high.x), high.y],
        [low.x, 0.5 * (low.y + high.y)],
    ];
    walls
        .into_iter()
        .map(|[x, y]| {
            let off_m = |tag: &&PlacedTag| {
                let p = tag.centre().coords;
                (p.x - x).hypot(p.y - y).hypot(p.z - 2.0)
            };
            world.tags.iter().min_by(|a, b| off_m(a).total_cmp(&off_m(b))).context("no tags")
        })
        .collect()
}

fn section(tag: &PlacedTag) -> TagSection {
    TagSection {
        family: tag.family.name().to_owned(),
        id: tag.id,
        corners_m: tag.corners.map(|corner| corner.coords.into()),
        faces_away: false,
    }
}

/// Known corners and tapes as wrong as they say, and edges that a printer has changed.
fn constraints(world: &World, known: &[&PlacedTag], mut noise: Noise) -> String {
    let name = |tag: &PlacedTag| format!("{}:{}", tag.family.name(), tag.id);
    let mut text = String::new();
    for tag in known {
        // Each corner is measured by itself.
        let corners = tag.corners.map(|corner| {
            let [x, y, z]: [f64; 3] = (corner.coords + noise.normal3() * KNOWN_SIGMA_M).into();
            format!("[{x:.5}, {y:.5}, {z:.5}]")
        });
        text += &format!(
            "[[known]]\ntag = \"{}\"\ncorners_m = [{}]\nsigma_m = {KNOWN_SIGMA_M}\n\n",
            name(tag),
            corners.join(", ")
        );
    }
    let n_tags = world.tags.len();
    for k in 0..6 {
        let (a, b) =
            (&world.tags[k * n_tags / 7], &world.tags[(k * n_tags / 7 + n_tags / 2) % n_tags]);
        let distance_m = (a.centre() - b.centre()).coords.norm() + TAPE_SIGMA_M * noise.normal();
        text += &format!(
            "[[tapes]]\nfrom = \"{}\"\nto = \"{}\"\ndistance_m = {distance_m:.5}\nsigma_m = \
             {TAPE_SIGMA_M}\ncheck = {}\n\n",
            name(a),
            name(b),
            k >= 3
        );
    }
    let factor = 1.0 + PRINTER_SIGMA * noise.normal();
    let mut by_edge: BTreeMap<u64, Vec<String>> = BTreeMap::new();
    for tag in &world.tags {
        by_edge.entry(tag.edge_m.to_bits()).or_default().push(format!("\"{}\"", name(tag)));
    }
    for (bits, names) in by_edge {
        let edge_m = f64::from_bits(bits) * factor;
        text += &format!("[[edges]]\ntags = [{}]\nedge_m = {edge_m:.6}\n\n", names.join(", "));
    }
    text
}
