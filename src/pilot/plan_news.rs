//! Which plans the people hear of.

use super::event::PlanChoice;
use crate::messages::VolumeAccount;

/// What they heard last.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PlanNews {
    told_sigma_end_m3: Option<f64>,
}

/// A prediction that differs by less from the one told last is no news.
const NEWS_RATIO: f64 = 1.5;

impl PlanNews {
    /// The line for a plan whose predicted end is news: the first one, and later ones that lead to
    /// something else.
    pub(super) fn news(
        &mut self,
        choice: &PlanChoice,
        whole: Option<&VolumeAccount>,
    ) -> Option<String> {
        let prediction = choice.prediction?;
        let end_m3 = prediction.sigma_end_m3;
        let is_old = |told_m3: f64| (told_m3 / end_m3).max(end_m3 / told_m3) < NEWS_RATIO;
        if choice.ahead.is_empty() || self.told_sigma_end_m3.is_some_and(is_old) {
            return None;
        }
        self.told_sigma_end_m3 = Some(end_m3);
        let length_m = prediction.length_m;
        Some(match whole.map(|account| account.estimate.volume_m3.abs()).filter(|v| *v > 0.0) {
            Some(volume_m3) => {
                let percent = 100.0 * end_m3 / volume_m3;
                format!(
                    "plan: {length_m:.0} m to sigma {end_m3:.2} m3, {percent:.2} % of the volume"
                )
            }
            None => format!("plan: {length_m:.0} m to sigma {end_m3:.2} m3"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point;
    use crate::planning::Waypoint;
    use crate::planning::planner::{PlanEnd, Prediction};
    use crate::time::Stamp;

    #[test]
    fn the_first_plan_and_those_that_lead_elsewhere_are_told() {
        let choice = |sigma_end_m3| PlanChoice {
            at: Stamp::ZERO,
            ahead: vec![Waypoint { place: Point::new(1.0, 2.0, 7.0), yaw_rad: 0.0 }],
            end: PlanEnd::Target,
            prediction: Some(Prediction { sigma_now_m3: 90.0, sigma_end_m3, length_m: 31.4 }),
        };
        let mut news = PlanNews::default();
        let first = news.news(&choice(5.0), None);
        assert_eq!(first.as_deref(), Some("plan: 31 m to sigma 5.00 m3"));
        assert_eq!(news.news(&choice(5.9), None), None);
        assert_eq!(news.news(&choice(4.0), None), None);
        assert!(news.news(&choice(9.0), None).is_some() && news.news(&choice(9.0), None).is_none());
        let unknown = PlanChoice { prediction: None, ..choice(1.0) };
        assert_eq!(news.news(&unknown, None), None);
    }
}
