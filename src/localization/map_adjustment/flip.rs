//! Tags that were begun with as their own mirror image.
//!
//! A tag and its mirror image about the line of sight look alike from afar; a search that began at
//! the wrong one of the two stays there. So each tag is tried the other way round, with the frames
//! as they are: where that explains its pictures better, it is turned, and where it explains them
//! about as well, nothing is claimed of the tag.
#![expect(non_snake_case, reason = "matrices carry the letters of the equations")]

use super::normal::Problem;
use super::{corners_in_tag, pose_of_corners};
use crate::geometry::{Camera, Hall, Tag, Transform};
use crate::localization::planar_pose;
use crate::localization::vision_fix::Reprojector;
use nalgebra::{Matrix6, Vector3, Vector6};

/// Two poses whose χ² differ by less than this both explain the pixels: odds of 1 in 1000.
const AMBIGUOUS_CHI2: f64 = 13.8;
const MAX_ITERATIONS: usize = 12;
/// Two poses this near to each other are one: rad.
const SAME_RAD: f64 = 0.02;

impl Problem<'_> {
    /// Turns tags that fit better as their mirror image, leaves out those that fit both ways.
    pub(super) fn turn_flipped_tags(&mut self) {
        for k in 0..self.tags.len() {
            if self.survey.known.iter().any(|known| known.tag == k) {
                continue;
            }
            let Some(pose) = self.tags[k] else { continue };
            let Some(other) = self.flipped(k, &pose) else { continue };
            let (as_is, pose) = self.refined(k, pose);
            let (turned, other) = self.refined(k, other);
            if other.rotation.minus(&pose.rotation).norm() < SAME_RAD {
                continue;
            }
            if 2.0 * (as_is - turned).abs() < AMBIGUOUS_CHI2 {
                self.tags[k] = None;
            } else if turned < as_is {
                self.tags[k] = Some(other);
            }
        }
        self.leave_out_undetermined();
    }

    /// The tag mirrored about the line of sight of the frame that sees it largest.
    fn flipped(&self, tag: usize, pose: &Transform<Hall, Tag>) -> Option<Transform<Hall, Tag>> {
        let corners = corners_in_tag(self.survey.edges_m[tag]).map(|corner| *pose * corner);
        let places: Vec<Vector3<f64>> = corners.iter().map(|corner| corner.coords).collect();
        let cameras = self.views_of(tag).filter_map(|(v, _)| {
            let camera = &self.survey.cameras[self.survey.views[v].camera];
            Some(self.bodies[v]? * camera.body_from_camera)
        });
        let off_m = |camera: &Transform<Hall, Camera>| (camera.origin - pose.origin).coords.norm();
        let nearest = cameras.min_by(|a, b| off_m(a).total_cmp(&off_m(b)))?;
        let flipped = planar_pose::flipped(&nearest.inverse(), &places)?;
        Some(pose_of_corners(&corners.map(|corner| nearest * (flipped * corner))))
    }

    /// Located views that show the tag, and the place of the sighting.
    fn views_of(&self, tag: usize) -> impl Iterator<Item = (usize, usize)> {
        let views = self.survey.views.iter().enumerate();
        let located = views.filter(|(v, _)| self.bodies[*v].is_some());
        located.flat_map(move |(v, view)| {
            let sightings = view.sightings.iter().enumerate();
            sightings.filter(move |(_, s)| s.tag == tag).map(move |(i, _)| (v, i))
        })
    }

    /// The cost of a tag at the pose that its pictures lead to, with the frames as they are.
    fn refined(&self, tag: usize, start: Transform<Hall, Tag>) -> (f64, Transform<Hall, Tag>) {
        let mut alone = self.clone();
        alone.tags[tag] = Some(start);
        let (mut cost, mut H, mut b) = alone.tag_equations(tag);
        for _ in 0..MAX_ITERATIONS {
            let damped = H + Matrix6::from_diagonal(&H.diagonal()) * 1e-3;
            let Some(step) = damped.cholesky().map(|factor| factor.solve(&b)) else { break };
            let before = alone.tags[tag];
            alone.tags[tag] = before.map(|pose| {
                let part = |from: usize| step.fixed_rows::<3>(from).into_owned();
                pose.perturbed(&part(0), &part(3))
            });
            let next = alone.tag_equations(tag);
            if next.0 >= cost {
                alone.tags[tag] = before;
                break;
            }
            (cost, H, b) = next;
        }
        (cost, alone.tags[tag].unwrap_or(start))
    }

    /// Cost and normal equations of one tag.
    fn tag_equations(&self, tag: usize) -> (f64, Matrix6<f64>, Vector6<f64>) {
        let (mut cost, mut H, mut b) = (0.0, Matrix6::zeros(), Vector6::zeros());
        let sigma_px = self.corner_sigma_px();
        for (v, i) in self.views_of(tag) {
            let view = &self.survey.views[v];
            let Some(body) = &self.bodies[v] else { continue };
            let reprojector = Reprojector::new(&self.survey.cameras[view.camera], body);
            for (k, seen_px) in view.sightings[i].corners_px.into_iter().enumerate() {
                let Some(corner) = self.corner(&reprojector, tag, k, seen_px) else {
                    cost += self.loss(super::normal::UNSEEN_SIGMAS).0;
                    continue;
                };
                let (loss, weight) = self.loss(corner.residual_px.norm() / sigma_px);
                let weight = weight / sigma_px.powi(2);
                cost += loss;
                H += corner.by_tag.transpose() * corner.by_tag * weight;
                b += corner.by_tag.transpose() * corner.residual_px * weight;
            }
        }
        (cost, H, b)
    }
}
