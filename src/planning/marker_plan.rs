//! Where to hang how many markers: the fewest candidates that serve every pose.
//!
//! ```text
//! Φ = Σ_χ [ min(n(χ)/n₀, 1) + min(q(χ)/q₀, 1) ]
//! ```
//! - `χ`: the poses that are to be served; `n(χ)`: markers that a detector reads from there; `n₀`: how many are
//!   wanted, so that one may be hidden or doubted
//! - `q(χ)`: [`q_pos`] of a fix from them; `q₀`: how good it is to be
//!
//! The candidate that raises Φ most is hung, again and again; then each marker is taken down that nothing
//! needs any more. Greedy choice of a sum that saturates is near the best: at least 1 − 1/e of it for the first
//! term (Nemhauser, Wolsey, Fisher 1978).
//! Checked: `every_pose_is_served_and_no_marker_can_be_spared`.

use super::quality_grid::Sensing;
use super::what_if::Candidate;
use crate::geometry::{Body, Hall, Point, Transform};
use crate::localization::vision_fix::q_pos;
use nalgebra::Matrix6;

/// What every pose is to have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Demand {
    /// Markers in view.
    pub n_markers: usize,
    /// Quality of a fix.
    pub quality: f64,
    /// No more markers than this are hung.
    pub n_most: usize,
}

/// What was chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkerPlan {
    /// Places in the list of candidates, in the order of choice.
    pub chosen: Vec<usize>,
    /// Poses that have all that is demanded.
    pub n_served: usize,
    /// Poses that no choice of candidates would serve.
    pub n_hopeless: usize,
    /// All poses.
    pub n_poses: usize,
}

/// A marker gains less than this at the end, in poses: it is not worth its sheet.
const LEAST_GAIN: f64 = 0.05;

/// Chooses among candidates, beside what hangs already in `sensing`.
///
/// Cost: a millisecond for each pose at first, then some microseconds for each pose and candidate in sight
/// of each other, for each marker that is hung.
#[must_use]
pub fn choose(
    sensing: &Sensing,
    poses: &[Transform<Hall, Body>],
    candidates: &[Candidate],
    demand: &Demand,
) -> MarkerPlan {
    let hung = poses.iter().map(|pose| {
        let mut view = View::nothing(sensing);
        sensing.tags.iter().for_each(|tag| view.add(&Part::of(sensing, tag, pose)));
        view
    });
    let mut views: Vec<View> = hung.collect();
    let parts: Vec<Vec<(usize, Part)>> = candidates
        .iter()
        .map(|candidate| {
            let part = |pose| Part::of(sensing, &candidate.corners, pose);
            let all = poses.iter().map(part).enumerate();
            all.filter(|(_, part)| part.is_seen).collect()
        })
        .collect();
    let chooser = Chooser { sensing, demand };
    let mut best_case = views.clone();
    for (pose, part) in parts.iter().flatten() {
        best_case[*pose].add(part);
    }
    let n_hopeless = best_case.iter().filter(|view| !chooser.is_served(view)).count();
    let mut chosen: Vec<usize> = Vec::new();
    while chosen.len() < demand.n_most {
        let gains = (0..candidates.len())
            .filter(|c| !chosen.contains(c))
            .map(|c| (chooser.gain(&views, &parts[c]), c));
        let Some((gain, best)) = gains.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        if gain < LEAST_GAIN {
            break;
        }
        parts[best].iter().for_each(|(pose, part)| views[*pose].add(part));
        chosen.push(best);
    }
    chooser.spare(&mut chosen, &mut views, &parts);
    let n_served = views.iter().filter(|view| chooser.is_served(view)).count();
    MarkerPlan { chosen, n_served, n_hopeless, n_poses: poses.len() }
}

/// What one marker adds at one pose.
#[derive(Debug, Clone, PartialEq)]
struct Part {
    is_seen: bool,
    normal_matrices: Vec<Matrix6<f64>>,
}

impl Part {
    fn of(sensing: &Sensing, tag: &[Point<Hall>; 4], pose: &Transform<Hall, Body>) -> Self {
        let normal_matrices = sensing.normal_matrices(std::slice::from_ref(tag), pose);
        let is_seen = normal_matrices.iter().any(|normal| normal.trace() > 0.0);
        Self { is_seen, normal_matrices }
    }
}

/// What is seen from one pose.
#[derive(Debug, Clone, PartialEq)]
struct View {
    n_markers: usize,
    normal_matrices: Vec<Matrix6<f64>>,
}

impl View {
    fn nothing(sensing: &Sensing) -> Self {
        Self { n_markers: 0, normal_matrices: vec![Matrix6::zeros(); sensing.cameras.len()] }
    }

    fn add(&mut self, part: &Part) {
        self.n_markers += usize::from(part.is_seen);
        self.normal_matrices.iter_mut().zip(&part.normal_matrices).for_each(|(sum, n)| *sum += n);
    }

    fn remove(&mut self, part: &Part) {
        self.n_markers -= usize::from(part.is_seen);
        self.normal_matrices.iter_mut().zip(&part.normal_matrices).for_each(|(sum, n)| *sum -= n);
    }
}

struct Chooser<'a> {
    sensing: &'a Sensing,
    demand: &'a Demand,
}

impl Chooser<'_> {
    fn quality(&self, view: &View) -> f64 {
        self.sensing.cov_of(&view.normal_matrices).as_ref().map_or(0.0, q_pos)
    }

    #[expect(clippy::cast_precision_loss, reason = "counts of markers")]
    fn potential(&self, view: &View) -> f64 {
        let share = view.n_markers as f64 / self.demand.n_markers.max(1) as f64;
        share.min(1.0) + (self.quality(view) / self.demand.quality).min(1.0)
    }

    fn is_served(&self, view: &View) -> bool {
        view.n_markers >= self.demand.n_markers && self.quality(view) >= self.demand.quality
    }

    fn gain(&self, views: &[View], parts: &[(usize, Part)]) -> f64 {
        let gain = |(pose, part): &(usize, Part)| {
            let before = &views[*pose];
            if self.is_served(before) {
                return 0.0;
            }
            let mut after = before.clone();
            after.add(part);
            self.potential(&after) - self.potential(before)
        };
        parts.iter().map(gain).sum()
    }

    /// Takes down what no served pose needs, the latest first: those were chosen for the fewest.
    fn spare(&self, chosen: &mut Vec<usize>, views: &mut [View], parts: &[Vec<(usize, Part)>]) {
        for k in (0..chosen.len()).rev() {
            let is_needed = parts[chosen[k]].iter().any(|(pose, part)| {
                let with_it = &views[*pose];
                let mut without = with_it.clone();
                without.remove(part);
                let is_lost = self.is_served(with_it) && !self.is_served(&without);
                // A pose that is not served anyhow still wants what it has.
                is_lost
                    || (!self.is_served(with_it)
                        && self.potential(&without) < self.potential(with_it))
            });
            if !is_needed {
                let spared = chosen.remove(k);
                parts[spared].iter().for_each(|(pose, part)| views[*pose].remove(part));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::free_space::tests::{marker_map, settings, space_of, walls};
    use crate::planning::what_if::{Layout, candidates};

    const LAYOUT: Layout = Layout { spacing_m: 2.0, rows_m: (2.0, 7.5), edge_m: 0.5 };

    /// Recounts everything by a map that holds the chosen markers, and tries to take down each.
    #[test]
    fn every_pose_is_served_and_no_marker_can_be_spared() {
        let mut settings = settings();
        settings.space.grid_m = 2.0;
        settings.space.n_headings = 2;
        let bare = marker_map(|_| false);
        let space = space_of(&settings, &bare);
        let axes = space.quality().axes();
        let poses: Vec<_> = (0..axes.n_nodes())
            .filter(|node| axes.is_of_survey(*node))
            .map(|node| axes.waypoint(node))
            .filter(|waypoint| space.clearance().is_clear(&waypoint.place.coords))
            .map(|waypoint| waypoint.level_pose())
            .collect();
        let candidates = candidates(&walls(), &LAYOUT, &[]);
        let demand = Demand { n_markers: 3, quality: 4.0, n_most: 60 };
        let plan = choose(space.quality().sensing(), &poses, &candidates, &demand);
        assert!(poses.len() > 10 && plan.chosen.len() > 3, "{plan:?}");
        assert_eq!(plan.n_served + plan.n_hopeless, poses.len(), "{plan:?}");
        let served = |tags: &[usize]| {
            let sensing = Sensing {
                tags: tags.iter().map(|c| candidates[*c].corners).collect(),
                ..space.quality().sensing().clone()
            };
            let n_seen = |pose: &Transform<Hall, Body>| {
                let seen = |tag: &&[Point<Hall>; 4]| {
                    let normals = sensing.normal_matrices(&[**tag], pose);
                    normals.iter().any(|normal| normal.trace() > 0.0)
                };
                sensing.tags.iter().filter(seen).count()
            };
            let quality = |pose| sensing.fix_cov(pose).as_ref().map_or(0.0, q_pos);
            poses.iter().filter(|pose| n_seen(pose) >= 3 && quality(pose) >= 4.0).count()
        };
        assert_eq!(served(&plan.chosen), plan.n_served);
        if plan.n_hopeless == 0 {
            for k in 0..plan.chosen.len() {
                let mut fewer = plan.chosen.clone();
                fewer.remove(k);
                assert!(served(&fewer) < plan.n_served, "marker {k} can be spared");
            }
        }
    }
}
