//! What the fuzz targets share: the scene of the property tests and a hall.

#[path = "../../tests/properties/support.rs"]
#[allow(dead_code, reason = "the property tests use all of it")]
mod support;
#[path = "../../tests/properties/wire_scene.rs"]
#[allow(dead_code, reason = "the property tests use all of it")]
mod wire_scene;

use std::time::Duration;
use stockpilot::mapping::Method;
use stockpilot::geometry::{Body, Hall, Point, Rotation, Transform};
use stockpilot::messages::TagDetections;
use stockpilot::pilot::{Action, Event};
use stockpilot::time::{Mono, Stamp};
use wire_scene::WireScene;

/// How the surface is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Map {
    /// The height grid: a solve takes microseconds.
    Grid,
    /// The Gauss-Markov field: a solve takes a hundred milliseconds.
    Field,
}

/// Brain and session.
pub struct Scene(WireScene);

thread_local! {
    // Free space and quality of fixes are computed once: that takes longer than a hundred inputs.
    static WITH_GRID: WireScene = WireScene::new(settings(Map::Grid));
    static WITH_FIELD: WireScene = WireScene::new(settings(Map::Field));
}

fn settings(map: Map) -> stockpilot::pilot::Settings {
    let mut settings = support::settings();
    settings.mapping.method = match map {
        Map::Grid => Method::KalmanGrid,
        Map::Field => Method::MaternField,
    };
    settings
}

impl Scene {
    /// In a small hall, with an autopilot that has spoken.
    #[must_use]
    pub fn new(map: Map) -> Self {
        Self(match map {
            Map::Grid => WITH_GRID.with(WireScene::fork),
            Map::Field => WITH_FIELD.with(WireScene::fork),
        })
    }

    /// The present instant.
    #[must_use]
    pub fn now(&self) -> Stamp<Mono> {
        self.0.now
    }

    /// Bytes from the wire.
    pub fn hear(&mut self, bytes: &[u8]) {
        self.0.hear(bytes);
    }

    /// A frame with a right checksum around any payload.
    pub fn hear_frame(&mut self, from: (u8, u8), id: u32, payload: &[u8]) {
        self.0.hear(&wire_scene::frame(from, id, payload));
    }

    /// Tells the brain something; its jobs are done at once.
    pub fn tell(&mut self, event: Event) {
        let actions = self.0.tell(event);
        self.finish(actions);
    }

    /// Moves the clock on and ticks.
    pub fn tick(&mut self, by: Duration) {
        let actions = self.0.tick(by);
        self.finish(actions);
    }

    fn finish(&mut self, actions: Vec<Action>) {
        let mut waiting = actions;
        while let Some(action) = waiting.pop() {
            assert_finite(&action);
            if let Action::Start { id, job } = action {
                let output = Box::new(job.run());
                let at = self.0.now;
                waiting.extend(self.0.tell(Event::Finished { at, id, output }));
            }
        }
    }
}

/// What the camera sees from (1, 1) at this height.
#[must_use]
pub fn frame_at(height_m: f64, captured_at: Stamp<Mono>) -> TagDetections {
    let pose = Transform::<Hall, Body>::new(Rotation::identity(), Point::new(1.0, 1.0, height_m));
    support::frame(&pose, captured_at)
}

fn assert_finite(action: &Action) {
    if matches!(action, Action::Steer(_) | Action::PublishOdometry(_) | Action::PublishSight(_) | Action::ReportVolume(_)) {
        let text = format!("{action:?}");
        let mut words = text.split(|c: char| !c.is_alphanumeric());
        assert!(!words.any(|word| matches!(word, "NaN" | "inf")), "{text}");
    }
}
