//! Which tags do not hang where the map says.
//!
//! Each tag of a frame is judged by the state and the other tags, never by itself:
//!
//! ```text
//! Λ₋, η₋ from the accepted points of the others,   C = (P̃⁻¹ + Λ₋)⁻¹,   ĉ = C η₋
//! d² = (r − J ĉ)ᵀ (I + J C Jᵀ)⁻¹ (r − J ĉ)         8 degrees of freedom
//! ```
//! A tag that fails in many frames is excluded, by name; it comes back once it has agreed for long.
//! Where most tags of a frame fail, the state is at fault, and nobody is blamed.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::filter::FilterState;
use super::tight_update::{
    Frame, Information, PosePrior, Projector, Residual, Viewpoint, weight_of,
};
use crate::messages::{Severity, StatusText, TagFamily};
use nalgebra::{SMatrix, SVector};
use std::collections::BTreeMap;
use std::ops::Range;

/// A tag by its name.
pub(super) type TagName = (TagFamily, u32);

/// The points of one tag in a frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TagPoints {
    pub(super) name: TagName,
    /// Where its four corners stand in [`Frame::points`].
    pub(super) range: Range<usize>,
}

/// The 99.9 % quantile of χ² with 8 degrees of freedom (Abramowitz and Stegun 1964, table 26.8).
const TAG_GATE: f64 = 26.1245;
/// So many more bad frames than good ones exclude a tag: half a second at 20 Hz.
const EXCLUDED_AT: u32 = 10;
/// So many good frames in a row bring it back: five seconds at 20 Hz.
const BACK_AFTER: u32 = 100;
/// Points of other tags that a judgement needs.
const MIN_OTHER_POINTS: usize = 4;
/// A state less certain than this judges nobody, m and rad: the linearisation would be judged.
const MAX_POSITION_SIGMA_M: f64 = 0.1;
const MAX_ATTITUDE_SIGMA_RAD: f64 = 0.05;

/// What is known of one tag.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Score {
    n_bad: u32,
    n_good_in_row: u32,
    is_excluded: bool,
}

/// What is known of all tags.
#[derive(Debug, Clone, Default)]
pub(super) struct TagHealth {
    scores: BTreeMap<TagName, Score>,
}

impl TagHealth {
    /// True if a tag must not be used.
    pub(super) fn is_excluded(&self, name: TagName) -> bool {
        self.scores.get(&name).is_some_and(|score| score.is_excluded)
    }

    /// Judges the tags of a frame; says whom it excludes and whom it takes back.
    pub(super) fn judge(
        &mut self,
        state: &FilterState,
        view: &Viewpoint,
        frame: &Frame,
        tags: &[TagPoints],
    ) -> Vec<StatusText> {
        let verdicts = self.verdicts(state, view, frame, tags).unwrap_or_default();
        let n_bad = verdicts.iter().filter(|(_, is_good)| !is_good).count();
        if 2 * n_bad > tags.len() {
            return Vec::new();
        }
        verdicts.into_iter().filter_map(|(name, is_good)| self.count(name, is_good)).collect()
    }

    fn count(&mut self, name: TagName, is_good: bool) -> Option<StatusText> {
        let score = self.scores.entry(name).or_default();
        let (family, id) = (name.0.name(), name.1);
        if is_good {
            score.n_bad = score.n_bad.saturating_sub(1);
            score.n_good_in_row += 1;
            if score.is_excluded && score.n_good_in_row >= BACK_AFTER {
                *score = Score::default();
                let text = format!("tag {family} {id} agrees with the others again");
                return Some(StatusText { severity: Severity::Notice, text });
            }
            return None;
        }
        score.n_good_in_row = 0;
        score.n_bad = (score.n_bad + 1).min(EXCLUDED_AT);
        if score.n_bad < EXCLUDED_AT || score.is_excluded {
            return None;
        }
        score.is_excluded = true;
        let text = format!("tag {family} {id} is not where the map says: excluded");
        Some(StatusText { severity: Severity::Warning, text })
    }

    /// For each tag that can be judged: whether it agrees with the others.
    fn verdicts(
        &self,
        state: &FilterState,
        view: &Viewpoint,
        frame: &Frame,
        tags: &[TagPoints],
    ) -> Option<Vec<(TagName, bool)>> {
        let sigma = |k: usize| state.P[(k, k)].max(0.0).sqrt();
        let is_certain = (0..3).all(|k| sigma(k) <= MAX_POSITION_SIGMA_M)
            && (3..6).all(|k| sigma(k) <= MAX_ATTITUDE_SIGMA_RAD);
        if !is_certain || tags.len() < 2 {
            return None;
        }
        let prior = PosePrior::new(state, &view.motion(), frame.capture_sigma_s)?;
        let projector = Projector::new(frame, view);
        let residuals: Vec<Vec<Residual>> = tags
            .iter()
            .map(|tag| {
                let points = frame.points.get(tag.range.clone()).unwrap_or_default();
                points.iter().filter_map(|point| projector.residual(point)).collect()
            })
            .collect();
        let said: Vec<Information> = tags
            .iter()
            .zip(&residuals)
            .map(|(tag, residuals)| {
                let points = if self.is_excluded(tag.name) { &[][..] } else { residuals };
                accepted(&prior, points)
            })
            .collect();
        let all = said.iter().fold(Information::none(), |sum, one| sum.plus(one));
        let n_heard = |name: TagName, residuals: &[Residual]| {
            if self.is_excluded(name) { 0 } else { residuals.len() }
        };
        let n_all: usize =
            tags.iter().zip(&residuals).map(|(tag, points)| n_heard(tag.name, points)).sum();
        let mut verdicts = Vec::new();
        for (k, tag) in tags.iter().enumerate() {
            let others = all.minus(&said[k]);
            let n_others = n_all - n_heard(tag.name, &residuals[k]);
            let is_supported =
                others.n_points >= MIN_OTHER_POINTS && 2 * others.n_points >= n_others;
            if is_supported && let Some(is_good) = agrees(&prior, &residuals[k], &others) {
                verdicts.push((tag.name, is_good));
            }
        }
        Some(verdicts)
    }
}

/// What the points say that pass their gates against the prior.
fn accepted(prior: &PosePrior, points: &[Residual]) -> Information {
    let mut said = Information::none();
    for residual in points {
        if let Some(weight) = weight_of(prior.distance2(residual)) {
            said.add(residual, weight);
        }
    }
    said
}

/// Whether four corners agree with the state and other points; `None` if not all four are seen.
fn agrees(prior: &PosePrior, own: &[Residual], others: &Information) -> Option<bool> {
    let own: &[Residual; 4] = own.try_into().ok()?;
    let C = prior.posterior(&others.Lambda)?;
    let c = C * others.eta;
    let mut r = SVector::<f64, 8>::zeros();
    let mut J = SMatrix::<f64, 8, 6>::zeros();
    for (k, residual) in own.iter().enumerate() {
        r.fixed_rows_mut::<2>(2 * k).copy_from(&(residual.r - residual.J * c));
        J.fixed_rows_mut::<2>(2 * k).copy_from(&residual.J);
    }
    let S = SMatrix::<f64, 8, 8>::identity() + J * C * J.transpose();
    let distance2 = r.dot(&S.cholesky()?.solve(&r));
    // Where the other corners scatter more than they should, this tag may too.
    Some(distance2 <= TAG_GATE * others.excess_at(&c).max(1.0))
}
