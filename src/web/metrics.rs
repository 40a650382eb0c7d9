//! Numbers for Prometheus, in the OpenMetrics text format.

use super::shared::Shared;
use super::state::{Level, State};
use crate::mission::Phase;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;
use rustix::time::{ClockId, clock_gettime};
use std::sync::atomic::{AtomicU64, Ordering};

/// The type to answer with.
pub(super) const CONTENT_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

type Number = Gauge<f64, AtomicU64>;
type Label = Vec<(&'static str, String)>;

/// Everything as it is now. Made anew for each scrape, since nothing else counts it.
///
/// # Errors
/// A number that cannot be written.
pub(super) fn text(shared: &Shared) -> Result<String, std::fmt::Error> {
    let mut registry = Registry::with_prefix("stockpilot");
    let state = shared.picture();
    volumes(&mut registry, &state);
    health(&mut registry, &state);
    phase(&mut registry, &state);
    brain(&mut registry, shared);
    page(&mut registry, shared);
    let mut text = String::new();
    encode(&mut text, &registry)?;
    Ok(text)
}

fn gauge(registry: &mut Registry, name: &str, help: &str, value: Option<f64>) {
    // What is not known is left out rather than 0.
    if let Some(value) = value {
        let number = Number::default();
        number.set(value);
        registry.register(name, help, number);
    }
}

fn counter(registry: &mut Registry, name: &str, help: &str, value: u64) {
    let number: Counter = Counter::default();
    number.inc_by(value);
    registry.register(name, help, number);
}

fn volumes(registry: &mut Registry, state: &State) {
    let (volume, expanded) =
        (Family::<Label, Number>::default(), Family::<Label, Number>::default());
    let shares = Family::<Label, Number>::default();
    for bay in &state.volumes {
        let label = vec![("bay", bay.name.clone())];
        volume.get_or_create(&label).set(bay.volume_m3);
        expanded.get_or_create(&label).set(bay.expanded_m3);
        for (share, kind) in
            bay.shares.iter().zip(["measured", "interpolated", "unseen", "disturbed"])
        {
            let label = vec![("bay", bay.name.clone()), ("kind", kind.to_owned())];
            shares.get_or_create(&label).set(*share);
        }
    }
    registry.register("volume_m3", "Volume between surface and base", volume);
    registry.register("volume_expanded_m3", "U of the volume, k = 2", expanded);
    registry.register("volume_share", "Share of the volume by how it is known", shares);
}

fn health(registry: &mut Registry, state: &State) {
    let levels = Family::<Label, Number>::default();
    for (subject, level) in [
        ("fix", state.fix.level),
        ("lidar", state.lidar.level),
        ("camera", state.camera.level),
        ("battery", state.battery.level),
        ("link", state.link.level),
        ("computer", state.computer.level),
    ] {
        let value = match level {
            Level::Good => 0.0,
            Level::Degraded => 1.0,
            Level::Bad => 2.0,
            Level::Unknown => 3.0,
        };
        levels.get_or_create(&vec![("subject", subject.to_owned())]).set(value);
    }
    registry.register("level", "0 good, 1 degraded, 2 bad, 3 unknown", levels);
    gauge(registry, "position_sigma_xy_m", "Larger horizontal 1-sigma", state.fix.sigma_xy_m);
    gauge(registry, "position_sigma_z_m", "Vertical 1-sigma", state.fix.sigma_z_m);
    gauge(registry, "fix_age_seconds", "Age of the last frame used", state.fix.age_s);
    gauge(registry, "lidar_turns_hz", "Turns of the head", Some(state.lidar.turns_hz));
    gauge(registry, "lidar_return_ratio", "Beams that come back", state.lidar.return_ratio);
    gauge(registry, "camera_frames_hz", "Frames", Some(state.camera.frames_hz));
    gauge(registry, "battery_ratio", "State of charge", state.battery.percent.map(|p| p / 100.0));
    gauge(registry, "link_missed_ratio", "Frames lost on the way", Some(state.link.missed_ratio));
    #[expect(clippy::cast_precision_loss, reason = "bytes of a disk")]
    let free = state.computer.free_bytes.map(|bytes| bytes as f64);
    gauge(registry, "disk_free_bytes", "Room where the log is written", free);
}

fn phase(registry: &mut Registry, state: &State) {
    use Phase::{Abort, Hold, Idle, Land, Preflight, Return, Survey, TakeOff};
    let phases = Family::<Label, Number>::default();
    for phase in [Idle, Preflight, TakeOff, Survey, Return, Land, Hold, Abort] {
        let is_now = f64::from(u8::from(phase.name() == state.phase));
        phases.get_or_create(&vec![("phase", phase.name().to_owned())]).set(is_now);
    }
    registry.register("phase", "1 for the mission's present phase", phases);
}

fn brain(registry: &mut Registry, shared: &Shared) {
    let pulse = *shared.collector().pulse();
    counter(registry, "brain_ticks", "Ticks of the brain", pulse.ticks);
    counter(registry, "brain_ticks_skipped", "Ticks left out", pulse.ticks_skipped);
    counter(registry, "brain_events", "Events taken in", pulse.events);
    counter(registry, "jobs_failed", "Jobs that died", pulse.jobs_failed);
    counter(registry, "log_entries_lost", "Log entries lost", pulse.records_lost);
    counter(registry, "messages_out_lost", "Messages dropped on the way out", pulse.outgoing_lost);
    let superseded = pulse.outgoing_superseded;
    counter(
        registry,
        "messages_out_superseded",
        "Replaced by newer ones on a slow line",
        superseded,
    );
    counter(registry, "messages_in_lost", "Messages nobody took in time", pulse.received_lost);
    counter(registry, "frames_refused", "Frames refused unread", pulse.refused_frames);
    counter(registry, "autopilot_messages", "Messages of the autopilot", pulse.link.messages_in);
}

fn page(registry: &mut Registry, shared: &Shared) {
    let counters = &shared.counters;
    let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
    #[expect(clippy::cast_precision_loss, reason = "at most some dozens")]
    let viewers = shared.viewers().now as f64;
    gauge(registry, "page_viewers", "Viewers now", Some(viewers));
    counter(registry, "page_requests", "Requests", read(&counters.requests));
    counter(registry, "page_requests_refused", "Requests refused", read(&counters.refused));
    counter(registry, "page_wishes", "Commands passed to the mission", read(&counters.wishes));
    counter(registry, "page_states_sent", "States sent", read(&counters.states_sent));
    let dropped = read(&counters.viewers_dropped);
    counter(registry, "page_viewers_dropped", "Viewers that did not keep up", dropped);
    let turned_away = read(&counters.viewers_turned_away);
    counter(registry, "page_viewers_turned_away", "Viewers beyond the limit", turned_away);
    counter(registry, "page_news_lost", "News that found no room", shared.feed.lost());
    // Everything of the page runs on the thread that answers this.
    let cpu = clock_gettime(ClockId::ThreadCPUTime);
    #[expect(clippy::cast_precision_loss, reason = "seconds of a flight")]
    let cpu_s = cpu.tv_sec as f64 + 1e-9 * cpu.tv_nsec as f64;
    let seconds: Counter<f64, AtomicU64> = Counter::default();
    seconds.inc_by(cpu_s);
    registry.register("page_cpu_seconds", "CPU time of the page's thread", seconds);
}
