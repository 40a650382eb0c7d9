//! What is left out of the final sum: corners that are far off, and what they leave undetermined.

use super::normal::Problem;

/// Fewer corners than this fix no frame and no tag.
const MIN_CORNERS: u32 = 4;
/// The median length of a residual of two normal coordinates, in σ of one (Rayleigh).
const RAYLEIGH_MEDIAN: f64 = 1.177_41;

impl Problem<'_> {
    /// Leaves out corners that are farther off than this many σ; from now on squares count. Gives
    /// how many.
    ///
    /// The σ is the larger of what was said and what most corners show: with corners that scatter
    /// twice as much as was said, a gate by what was said would leave only the good half and call
    /// the map twice as sure as it is.
    pub(super) fn gate(&mut self, sigmas: f64) -> usize {
        let mut off_px = Vec::new();
        self.each_corner(|_, _, _, corner| {
            off_px.extend(corner.map(|corner| corner.residual_px.norm()));
        });
        off_px.sort_by(f64::total_cmp);
        let median_px = off_px.get(off_px.len() / 2).copied().unwrap_or(0.0);
        let gate_px = sigmas * self.corner_sigma_px().max(median_px / RAYLEIGH_MEDIAN);
        let mut off = Vec::new();
        self.each_corner(|v, i, k, corner| {
            if corner.is_none_or(|corner| corner.residual_px.norm() > gate_px) {
                off.push((v, i, k));
            }
        });
        for &(v, i, k) in &off {
            self.kept[v][i] &= !(1 << k);
        }
        self.is_robust = false;
        self.leave_out_undetermined();
        off.len()
    }

    /// Leaves out frames and tags with too few corners. Either may take the other along: a frame
    /// that shows one tag fixes that tag only if others fix the frame.
    pub(super) fn leave_out_undetermined(&mut self) {
        loop {
            let n_before = self.n_unknowns();
            self.leave_out_frames();
            self.leave_out_tags();
            self.renumber();
            if self.n_unknowns() == n_before {
                return;
            }
        }
    }

    fn leave_out_frames(&mut self) {
        for (v, view) in self.survey.views.iter().enumerate() {
            let counts = view.sightings.iter().zip(&self.kept[v]);
            let located = counts.filter(|(sighting, _)| self.tags[sighting.tag].is_some());
            let n_corners: u32 = located.map(|(_, corners)| corners.count_ones()).sum();
            if n_corners < MIN_CORNERS {
                self.bodies[v] = None;
            }
        }
    }

    fn leave_out_tags(&mut self) {
        let mut n_corners = vec![0; self.tags.len()];
        let mut which = vec![0_u8; self.tags.len()];
        for (v, view) in self.survey.views.iter().enumerate() {
            if self.bodies[v].is_none() {
                continue;
            }
            for (sighting, kept) in view.sightings.iter().zip(&self.kept[v]) {
                n_corners[sighting.tag] += kept.count_ones();
                which[sighting.tag] |= kept;
            }
        }
        for (k, tag) in self.tags.iter_mut().enumerate() {
            let is_fixed = n_corners[k] >= MIN_CORNERS && which[k].count_ones() >= 3;
            if !is_fixed && self.survey.known.iter().all(|known| known.tag != k) {
                *tag = None;
            }
        }
    }
}
