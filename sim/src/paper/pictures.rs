//! The pictures of the experiment.

use super::command::Settings;
use super::{Experiment, Method};
use crate::hall::{Devices, config};
use crate::judge::fix_quality;
use crate::scenario::Scenario;
use crate::survey::{StepMap, Survey};
use crate::world::{Region, World};
use anyhow::Context;
use std::path::Path;
use stockpilot::figure::{
    Axis, Band, Figure, HeatMap, Ink, Lattice, LineChart, Overlay, Series, Shape, Sheet, Stroke,
};
use stockpilot::geometry::{Point, Rotation, Transform};

/// One experiment and what it showed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Flown {
    pub(super) experiment: Experiment,
    pub(super) survey: Survey,
}

/// Pitch of the picture of the truth, m.
const TRUTH_CELL_M: f64 = 0.25;

/// Writes all of them.
pub(super) fn write(
    scenario: &Scenario,
    flown: &[Flown],
    settings: &Settings,
    out: &Path,
) -> anyhow::Result<()> {
    let put = |figure: &dyn Figure, name: &str| {
        figure.write(out, name).with_context(|| format!("picture {name}"))
    };
    let truth = ground_truth(&scenario.world);
    put(&truth, "ground_truth")?;
    put(&quality_of_fix(scenario, settings.quality_cell_m), "quality_of_fix")?;
    for method in Method::ALL {
        let of_method: Vec<&Flown> =
            flown.iter().filter(|flown| flown.experiment.method == method).collect();
        if of_method.is_empty() {
            continue;
        }
        let maps = maps(&scenario.world, &truth, &of_method);
        for (name, map) in &maps {
            put(map, name)?;
        }
        let overview = Sheet { figures: maps, n_cols: 2 * settings.maps_after.len().max(1) };
        // Its numbers are those of its parts.
        let name = format!("{}_overview", method.name());
        overview.write_pictures(out, &name).with_context(|| format!("picture {name}"))?;
        let truth_m3 = scenario.world.volume_m3();
        put(&volume_chart(method, &of_method, truth_m3), &format!("{}_volume", method.name()))?;
        put(&sigma_chart(method, &of_method, truth_m3), &format!("{}_sigma", method.name()))?;
    }
    Ok(())
}

/// Values at the middles of the cells of a rectangle.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss,
    reason = "pictures have few cells"
)]
fn sampled(area: &Region, cell_m: f64, value: impl Fn(f64, f64) -> f64) -> Lattice {
    let count = |length_m: f64| (length_m / cell_m).round().max(1.0) as usize;
    let (n_cols, n_rows) = (count(area.length_m()), count(area.width_m()));
    let middle = |from_m: f64, k: usize| from_m + (k as f64 + 0.5) * cell_m;
    let values = (0..n_rows * n_cols)
        .map(|k| value(middle(area.x_min_m, k % n_cols), middle(area.y_min_m, k / n_cols)))
        .collect();
    Lattice { x_min_m: area.x_min_m, y_min_m: area.y_min_m, cell_m, n_cols, values }
}

fn corners_m(area: &Region) -> Vec<[f64; 2]> {
    vec![
        [area.x_min_m, area.y_min_m],
        [area.x_max_m, area.y_min_m],
        [area.x_max_m, area.y_max_m],
        [area.x_min_m, area.y_max_m],
    ]
}

fn walls(world: &World) -> impl Iterator<Item = Overlay> + '_ {
    world.walls_inside.iter().map(|wall| {
        Overlay::new("wall of a bay", Shape::Outline, Ink::Black, corners_m(&wall.footprint()))
    })
}

fn ground_truth(world: &World) -> HeatMap {
    HeatMap {
        title: format!("Ground truth: {}, {:.1} m³", world.name, world.volume_m3()),
        grid: sampled(&world.region, TRUTH_CELL_M, |x, y| world.height_at(x, y)),
        quantity: "height over the floor (m)".to_owned(),
        range: None,
        is_signed: false,
        overlays: walls(world).collect(),
    }
}

fn quality_of_fix(scenario: &Scenario, cell_m: f64) -> HeatMap {
    let world = &scenario.world;
    let planning = config(scenario, Devices::none()).planning;
    let (height_m, min_quality) = (planning.height_m, planning.min_fix_quality);
    let level = Rotation::from_euler_rad(0.0, 0.0, planning.yaw_deg.to_radians());
    let grid = sampled(&world.hall.footprint(), cell_m, |x, y| {
        let pose = Transform::new(level, Point::new(x, y, height_m));
        fix_quality(world, &scenario.camera, &pose)
    });
    let border = grid.border_m(min_quality);
    // Right before a marker the quality is many times that of everywhere else.
    let brightest = quantile(&grid.values, 0.98).max(2.0 * min_quality);
    let pad = world.pad.position.coords;
    let mut tags_m: Vec<[f64; 2]> =
        world.tags.iter().map(|tag| [tag.centre().coords.x, tag.centre().coords.y]).collect();
    // Markers hang above each other: one mark for all of them.
    tags_m.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    tags_m.dedup_by(|a, b| (a[0] - b[0]).hypot(a[1] - b[1]) < 0.3);
    let region = corners_m(&world.region);
    HeatMap {
        title: format!("Quality of fix at {height_m:.1} m, heading {:.0}°", planning.yaw_deg),
        quantity: format!("q_pos (1/√(m² + rad²)); {brightest:.0} and above are one colour"),
        range: Some([0.0, brightest]),
        is_signed: false,
        overlays: [
            Overlay::new("region", Shape::Outline, Ink::Grey, region),
            Overlay::new(format!("q_pos = τ = {min_quality}"), Shape::Segments, Ink::Red, border),
            Overlay::new("markers", Shape::Triangles, Ink::Orange, tags_m),
            Overlay::new("pad", Shape::Dots, Ink::White, vec![[pad.x, pad.y]]),
        ]
        .into_iter()
        .filter(|overlay| !overlay.points_m.is_empty())
        .collect(),
        grid,
    }
}

/// The value that this share of all values does not exceed.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index of a list")]
#[expect(clippy::cast_precision_loss, reason = "pictures have few cells")]
fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1);
    sorted.get((share * last as f64).round() as usize).copied().unwrap_or(0.0)
}

/// Uncertainty and reconstruction of every flight at every kept step, named as their files are.
fn maps(world: &World, truth: &HeatMap, flown: &[&Flown]) -> Vec<(String, HeatMap)> {
    // The same colours for all planners after the same number of steps.
    let sigma_max = |asked_steps: usize| {
        let maps = flown.iter().flat_map(|flown| &flown.survey.maps);
        let sigmas_m = maps.filter(|m| m.asked_steps == asked_steps).flat_map(|m| &m.map.sigma_m);
        sigmas_m.copied().fold(0.0, f64::max)
    };
    let heights = truth.grid.values.iter().copied();
    let height_max = heights.fold(f64::NEG_INFINITY, f64::max);
    let height_min = truth.grid.values.iter().copied().fold(f64::INFINITY, f64::min);
    let mut figures = Vec::new();
    for flown in flown {
        for kept in &flown.survey.maps {
            let name =
                |what: &str| format!("{}_{:02}_{what}", flown.experiment.name(), kept.asked_steps);
            figures.push((
                name("uncertainty"),
                step_map(world, flown, kept, Part::Uncertainty, [0.0, sigma_max(kept.asked_steps)]),
            ));
            figures.push((
                name("reconstruction"),
                step_map(world, flown, kept, Part::Reconstruction, [height_min, height_max]),
            ));
        }
    }
    figures
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Uncertainty,
    Reconstruction,
}

fn step_map(world: &World, flown: &Flown, kept: &StepMap, part: Part, range: [f64; 2]) -> HeatMap {
    let (what, quantity, values) = match part {
        Part::Uncertainty => ("σ", "σ of the height (m)", &kept.map.sigma_m),
        Part::Reconstruction => ("height", "height over the floor (m)", &kept.map.mean_m),
    };
    let geometry = &kept.map.grid;
    let track: Vec<[f64; 2]> =
        flown.survey.track_m.iter().take(kept.n_track).map(|p| [p[0], p[1]]).collect();
    let here: Vec<[f64; 2]> = track.last().copied().into_iter().collect();
    let experiment = &flown.experiment;
    let (planner, method) = (experiment.planner.name(), experiment.method.title());
    HeatMap {
        title: format!("{planner}, {method}: {what} after {} steps", kept.sample.steps),
        grid: Lattice {
            x_min_m: geometry.x_min_m,
            y_min_m: geometry.y_min_m,
            cell_m: geometry.cell_m,
            n_cols: geometry.n_cols,
            values: values.clone(),
        },
        quantity: quantity.to_owned(),
        range: Some(range),
        is_signed: false,
        overlays: walls(world)
            .chain([
                Overlay::new("true path of the survey", Shape::Path, Ink::Red, track),
                Overlay::new("vehicle", Shape::Dots, Ink::White, here),
            ])
            .filter(|overlay| !overlay.points_m.is_empty())
            .collect(),
    }
}

/// Thousands of samples; counts stay far below 2^53.
#[expect(clippy::cast_precision_loss, reason = "counts stay far below 2^53")]
fn thousands(n_samples: u64) -> f64 {
    n_samples as f64 / 1000.0
}

/// Each flight with a colour of its own.
fn inked<'a>(flown: &'a [&'a Flown]) -> impl Iterator<Item = (&'a Flown, Ink)> + 'a {
    std::iter::zip(flown.iter().copied(), Ink::CURVES.into_iter().cycle())
}

fn volume_chart(method: Method, flown: &[&Flown], truth_m3: f64) -> LineChart {
    let bands = inked(flown).map(|(flown, ink)| Band {
        label: format!("{} ± 2σ", flown.experiment.planner.name()),
        ink,
        borders: flown
            .survey
            .samples
            .iter()
            .map(|s| {
                let two_sigma_m3 = 2.0 * s.sigma_m3;
                [thousands(s.n_samples), s.volume_m3 - two_sigma_m3, s.volume_m3 + two_sigma_m3]
            })
            .collect(),
    });
    let curves = inked(flown).map(|(flown, ink)| Series {
        label: flown.experiment.planner.name().to_owned(),
        ink,
        stroke: Stroke::Full,
        points: points(flown, |_, volume_m3| volume_m3),
    });
    let samples = || flown.iter().flat_map(|flown| &flown.survey.samples);
    let last = samples().map(|s| thousands(s.n_samples)).fold(0.0, f64::max);
    let volumes_m3 = || samples().map(|s| s.volume_m3).chain([truth_m3]);
    let air_m3 = 0.05 * truth_m3;
    let lowest_m3 = volumes_m3().fold(f64::INFINITY, f64::min) - air_m3;
    let highest_m3 = volumes_m3().fold(f64::NEG_INFINITY, f64::max) + air_m3;
    let truth = Series {
        label: "truth".to_owned(),
        ink: Ink::Black,
        stroke: Stroke::Dashed,
        points: vec![[0.0, truth_m3], [last, truth_m3]],
    };
    LineChart {
        title: format!("Volume against samples, {}", method.title()),
        x: Axis::linear("LiDAR samples since the survey began (1000)"),
        y: Axis {
            // The first guesses may be far off and are of no interest.
            range: Some([lowest_m3.max(0.5 * truth_m3), highest_m3.min(1.5 * truth_m3)]),
            ..Axis::linear("volume (m³)")
        },
        bands: bands.collect(),
        series: curves.chain([truth]).collect(),
    }
}

fn sigma_chart(method: Method, flown: &[&Flown], truth_m3: f64) -> LineChart {
    let sigma = inked(flown).map(|(flown, ink)| Series {
        label: format!("{}: claimed σ", flown.experiment.planner.name()),
        ink,
        stroke: Stroke::Full,
        points: points(flown, |sigma_m3, _| 100.0 * sigma_m3 / truth_m3),
    });
    let error = inked(flown).map(|(flown, ink)| Series {
        label: format!("{}: true error", flown.experiment.planner.name()),
        ink,
        stroke: Stroke::Dashed,
        points: points(flown, |_, volume_m3| 100.0 * (volume_m3 - truth_m3).abs() / truth_m3),
    });
    LineChart {
        title: format!("Claimed σ and true error against samples, {}", method.title()),
        x: Axis::linear("LiDAR samples since the survey began (1000)"),
        y: Axis::log("share of the true volume (%)"),
        bands: Vec::new(),
        series: sigma.chain(error).collect(),
    }
}

/// Something of σ and V at every sample.
fn points(flown: &Flown, value: impl Fn(f64, f64) -> f64) -> Vec<[f64; 2]> {
    let samples = flown.survey.samples.iter();
    samples.map(|s| [thousands(s.n_samples), value(s.sigma_m3, s.volume_m3)]).collect()
}
