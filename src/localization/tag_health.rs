//! Which tags do not hang where the map says.
//!
//! Each tag of a frame is judged by the state and the other tags, never by itself:
//!
//! ```text
//! Λ₋, η₋ from the accepted points of the others,   C = (P̃⁻¹ + Λ₋)⁻¹,   ĉ = C η₋
//! d² = (r − J ĉ)ᵀ (I + J C Jᵀ)⁻¹ (r − J ĉ)         8 degrees of freedom
//! ```
//! Where tags may hang beside their mapped places, each of them sees a pose of its own, and C is
//! that pose's (see `tight_update::placed`): a tag that hangs as well as it was surveyed is good.
//! A tag that fails in many frames is excluded, by name; it comes back once it has agreed for long.
//! Where most tags of a frame fail, the state is at fault, and nobody is blamed.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::filter::FilterState;
use super::tight_update::placed::{self, JointPosterior, JointPrior};
use super::tight_update::{
    Frame, Information, PosePrior, Projector, Residual, Viewpoint, weight_of,
};
use crate::messages::{Severity, StatusText, TagFamily};
use nalgebra::{Matrix6, SMatrix, SVector, Vector6};
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
        let cov = state.pose_cov();
        let sigma = |k: usize| cov[(k, k)].max(0.0).sqrt();
        let is_certain = (0..3).all(|k| sigma(k) <= MAX_POSITION_SIGMA_M)
            && (3..6).all(|k| sigma(k) <= MAX_ATTITUDE_SIGMA_RAD);
        if !is_certain || tags.len() < 2 {
            return None;
        }
        let prior = Prior::new(state, view, frame, tags)?;
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
            .enumerate()
            .map(|(k, (tag, residuals))| {
                let points = if self.is_excluded(tag.name) { &[][..] } else { residuals };
                prior.accepted(k, points)
            })
            .collect();
        let all = said.iter().fold(Information::none(), |sum, one| sum.plus(one));
        let n_heard = |name: TagName, residuals: &[Residual]| {
            if self.is_excluded(name) { 0 } else { residuals.len() }
        };
        let n_all: usize =
            tags.iter().zip(&residuals).map(|(tag, points)| n_heard(tag.name, points)).sum();
        let court = prior.court(&said, all)?;
        let mut verdicts = Vec::new();
        for (k, tag) in tags.iter().enumerate() {
            let others = all.minus(&said[k]);
            let n_others = n_all - n_heard(tag.name, &residuals[k]);
            let is_supported =
                others.n_points >= MIN_OTHER_POINTS && 2 * others.n_points >= n_others;
            if is_supported
                && let Some(expected) = court.expects(k, &said[k])
                && let Some(is_good) = agrees(&residuals[k], &expected)
            {
                verdicts.push((tag.name, is_good));
            }
        }
        Some(verdicts)
    }
}

/// What the state believes of the pose that each tag sees.
enum Prior {
    /// The same pose: the tags hang where the map says.
    Exact(Box<PosePrior>),
    /// Each its own: they may hang beside it.
    Placed(Box<JointPrior>),
}

/// The same with what the tags of a frame say.
enum Court<'a> {
    Exact(&'a PosePrior, Box<Information>),
    Placed {
        posterior: Box<JointPosterior<'a>>,
        /// What the residuals of each tag leave at its own pose.
        left: Vec<Information>,
    },
}

/// The pose that a tag should see by the word of the state and the others.
struct Expected {
    shift: Vector6<f64>,
    cov: Matrix6<f64>,
    /// How the others scatter, 1 where they are as good as said.
    excess: f64,
}

impl Prior {
    fn new(
        state: &FilterState,
        view: &Viewpoint,
        frame: &Frame,
        tags: &[TagPoints],
    ) -> Option<Self> {
        let (motion, sigma_s) = (view.motion(), frame.capture_sigma_s);
        let Some(errors) = &state.places else {
            return PosePrior::new(state, &motion, sigma_s).map(Box::new).map(Self::Exact);
        };
        let place_of = |tag: &TagPoints| Some(frame.points.get(tag.range.start)?.place_idx);
        let places = tags.iter().map(place_of).collect::<Option<Vec<_>>>()?;
        JointPrior::new(state, errors, &motion, sigma_s, &places).map(Box::new).map(Self::Placed)
    }

    /// What the points of the k-th tag say that pass their gates against the state.
    fn accepted(&self, k: usize, points: &[Residual]) -> Information {
        let view_cov = match self {
            Self::Exact(_) => None,
            Self::Placed(prior) => Some(prior.view_cov(k)),
        };
        let mut said = Information::none();
        for residual in points {
            let distance2 = match (self, &view_cov) {
                (Self::Exact(prior), _) => prior.distance2(residual),
                (Self::Placed(prior), cov) => {
                    placed::distance2(cov.as_ref().unwrap_or(&prior.cov), residual)
                }
            };
            if let Some(weight) = weight_of(distance2) {
                said.add(residual, weight);
            }
        }
        said
    }

    fn court(&self, said: &[Information], all: Information) -> Option<Court<'_>> {
        Some(match self {
            Self::Exact(prior) => Court::Exact(prior, Box::new(all)),
            Self::Placed(prior) => {
                let posterior = Box::new(prior.posterior(said)?);
                let left =
                    said.iter().enumerate().map(|(k, said)| said.left_at(&posterior.view(k)));
                Court::Placed { left: left.collect(), posterior }
            }
        })
    }
}

impl Court<'_> {
    /// The pose that the k-th tag, which `said` this, should see by the word of the others.
    fn expects(&self, k: usize, said: &Information) -> Option<Expected> {
        match self {
            Self::Exact(prior, all) => {
                let others = all.minus(said);
                let cov = prior.posterior(&others.Lambda)?;
                let shift = cov * others.eta;
                Some(Expected { shift, cov, excess: others.excess_at(&shift) })
            }
            Self::Placed { posterior, left } => {
                let (shift, cov) = posterior.view_without(k, said)?;
                let others = left.iter().enumerate().filter(|(other, _)| *other != k);
                let others = others.fold(Information::none(), |sum, (_, one)| sum.plus(one));
                Some(Expected { shift, cov, excess: others.excess_at(&Vector6::zeros()) })
            }
        }
    }
}

/// Whether four corners agree with what is expected of them; `None` if not all four are seen.
fn agrees(own: &[Residual], expected: &Expected) -> Option<bool> {
    let own: &[Residual; 4] = own.try_into().ok()?;
    let Expected { shift: c, cov: C, excess } = expected;
    let mut r = SVector::<f64, 8>::zeros();
    let mut J = SMatrix::<f64, 8, 6>::zeros();
    for (k, residual) in own.iter().enumerate() {
        r.fixed_rows_mut::<2>(2 * k).copy_from(&(residual.r - residual.J * c));
        J.fixed_rows_mut::<2>(2 * k).copy_from(&residual.J);
    }
    let S = SMatrix::<f64, 8, 8>::identity() + J * C * J.transpose();
    let distance2 = r.dot(&S.cholesky()?.solve(&r));
    // Where the other corners scatter more than they should, this tag may too.
    Some(distance2 <= TAG_GATE * excess.max(1.0))
}
