//! The brain's task: one event after the other, from every source.

mod ticker;

use super::clock::Clock;
use super::external_planner;
use super::recorder::Recorder;
use super::status::{ServiceStats, ServiceStatus};
use crate::link::transport::{Outgoing, Received, Transport};
use crate::link::{PAGE, Session, SessionOutput};
use crate::messages::{OperatorAnswer, OperatorVerb, Severity};
use crate::pilot::{Action, Event, Job, JobId, JobOutput, Pilot};
use crate::time::{Mono, Stamp};
use crate::web::{Feed, Pulse, Wish};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;
use ticker::Ticker;
use tokio::sync::{mpsc, watch};
use tokio::task::{JoinError, JoinSet};
use tokio_util::sync::CancellationToken;

/// Status is shown at every sixth tick: 10 Hz.
const TICKS_PER_STATUS: u64 = 6;
/// What waits in an input when a tick strikes is taken in first, but no more than this.
const MAX_BEFORE_TICK: usize = 256;
/// A landing from any usual height, and what the autopilot waits before it stops the motors.
const LANDS_WITHIN: Duration = Duration::from_secs(60);
/// Without a tick for so long, by the wall, the clock is that of a simulation which has ended.
const STANDS_AFTER: Duration = Duration::from_secs(2);
const WARN_EVERY: Duration = Duration::from_secs(1);
const WARN_AT_LEAST_EVERY: Duration = Duration::from_secs(60);
/// Frames that the guard refuses may come for as long as somebody sends them.
const WARN_OF_REFUSALS_EVERY: Duration = Duration::from_secs(10);

/// Sources of events outside this service.
#[derive(Debug)]
pub(super) struct Inputs {
    pub(super) scans: mpsc::Receiver<Event>,
    pub(super) tags: mpsc::Receiver<Event>,
    pub(super) storage: mpsc::Receiver<Event>,
    /// What people ask for on the own page.
    pub(super) wishes: mpsc::Receiver<Wish>,
}

/// Who is told what the brain does.
pub(super) struct Witnesses {
    pub(super) recorder: Option<Box<dyn Recorder>>,
    pub(super) status_tx: watch::Sender<ServiceStatus>,
    pub(super) feed: Option<Feed>,
}

/// Something that happened to the brain's task.
enum Happening {
    Stopped,
    TickDue,
    Arrived(Received),
    Sensed(Event),
    Wished(Wish),
    JobEnded(Result<(JobId, JobOutput), JoinError>),
}

/// The brain with its link, its jobs and its witnesses.
pub(super) struct Brain {
    pilot: Pilot,
    session: Session,
    clock: Clock,
    transport: Transport,
    /// Ends the transport: after the last command, so not with everything else.
    link_stop: CancellationToken,
    recorder: Option<Box<dyn Recorder>>,
    jobs: JoinSet<(JobId, JobOutput)>,
    ticker: Ticker,
    events: VecDeque<Event>,
    actions: Vec<Action>,
    out: SessionOutput,
    status: ServiceStatus,
    status_tx: watch::Sender<ServiceStatus>,
    feed: Option<Feed>,
    /// Who waits for the mission's answers to the own page, in their order.
    wished: VecDeque<Wish>,
    last_tick: Arc<AtomicI64>,
    /// When losses were told of last, how much was lost by then, and how long nothing more is said.
    warned: (Stamp<Mono>, u64, Duration),
    /// When a slow line was told of last, and how much had been replaced by then.
    warned_of_slow_line: (Stamp<Mono>, u64),
    /// When refused frames were told of last, and how many there were then.
    warned_of_refusals: Option<(Stamp<Mono>, u64)>,
    warned_of_autopilots: bool,
}

impl Brain {
    pub(super) fn new(
        pilot: Pilot,
        session: Session,
        clock: Clock,
        (transport, link_stop): (Transport, CancellationToken),
        witnesses: Witnesses,
    ) -> Self {
        let now = clock.now();
        let Witnesses { recorder, status_tx, feed } = witnesses;
        Self {
            pilot,
            session,
            transport,
            link_stop,
            recorder,
            jobs: JoinSet::new(),
            ticker: Ticker::new(now),
            events: VecDeque::new(),
            actions: Vec::new(),
            out: SessionOutput::default(),
            status: ServiceStatus::default(),
            status_tx,
            feed,
            wished: VecDeque::new(),
            last_tick: Arc::new(AtomicI64::new(now.nanos())),
            warned: (now, 0, WARN_EVERY),
            warned_of_slow_line: (now, 0),
            warned_of_refusals: None,
            warned_of_autopilots: false,
            clock,
        }
    }

    /// When the brain ticked last, ns of its clock.
    pub(super) fn last_tick(&self) -> Arc<AtomicI64> {
        Arc::clone(&self.last_tick)
    }

    /// Works until `stop` is cancelled, then has a vehicle that it steers land, and ends everything in order.
    pub(super) async fn run(mut self, mut inputs: Inputs, stop: CancellationToken) -> ServiceStats {
        loop {
            match self.next(&mut inputs, &stop).await {
                Happening::Stopped => break,
                happening => self.take(happening, &mut inputs),
            }
        }
        Box::pin(self.land_first(&mut inputs)).await;
        Box::pin(self.end()).await
    }

    fn take(&mut self, happening: Happening, inputs: &mut Inputs) {
        match happening {
            Happening::Stopped => {}
            Happening::TickDue => self.tick(inputs),
            Happening::Arrived(received) => self.arrived(&received),
            Happening::Sensed(event) => self.events.push_back(event),
            Happening::Wished(wish) => self.wished(wish),
            Happening::JobEnded(result) => self.job_ended(result),
        }
        self.work_off();
    }

    /// A vehicle in the air lands before the brain ends, with ODOMETRY to the ground: left to itself, one
    /// that has no other position than ours drifts until its own failsafe notices, and lands blind.
    async fn land_first(&mut self, inputs: &mut Inputs) {
        self.session.refuse_starts();
        if !self.is_at_rest()
            && let Some(event) = self.session.on_own_wish(OperatorVerb::Land, self.clock.now())
        {
            self.events.push_back(event);
            self.work_off();
        }
        let never = CancellationToken::new();
        let until = self.clock.now().plus(LANDS_WITHIN);
        while !self.is_at_rest() && self.clock.now() < until {
            let next = self.next(inputs, &never);
            let Ok(happening) = tokio::time::timeout(STANDS_AFTER, next).await else { break };
            self.take(happening, inputs);
        }
        if !self.is_at_rest() {
            tracing::error!("not seen to have landed: the vehicle is left to its autopilot");
        }
    }

    /// Nothing is flown, asked or worked out.
    fn is_at_rest(&self) -> bool {
        self.pilot.is_at_rest() && !self.session.awaits_answers()
    }

    /// Waits for whatever comes first. Ticks stand before data, so that no flood starves them.
    async fn next(&mut self, inputs: &mut Inputs, stop: &CancellationToken) -> Happening {
        tokio::select! {
            biased;
            () = stop.cancelled() => Happening::Stopped,
            () = self.clock.sleep_until(self.ticker.due()) => Happening::TickDue,
            Some(result) = self.jobs.join_next() => Happening::JobEnded(result),
            Some(wish) = inputs.wishes.recv() => Happening::Wished(wish),
            Some(received) = self.transport.received.recv() => Happening::Arrived(received),
            Some(event) = inputs.scans.recv() => Happening::Sensed(event),
            Some(event) = inputs.tags.recv() => Happening::Sensed(event),
            Some(event) = inputs.storage.recv() => Happening::Sensed(event),
        }
    }

    /// Everything that came before the tick goes first; then the link's duties, then the tick.
    fn tick(&mut self, inputs: &mut Inputs) {
        for _ in 0..MAX_BEFORE_TICK {
            let Ok(received) = self.transport.received.try_recv() else { break };
            self.arrived(&received);
        }
        for input in [&mut inputs.scans, &mut inputs.tags] {
            let waiting = std::iter::from_fn(|| input.try_recv().ok());
            self.events.extend(waiting.take(MAX_BEFORE_TICK));
        }
        while let Some(result) = self.jobs.try_join_next() {
            self.job_ended(result);
        }
        let now = self.clock.now();
        self.session.on_time(now, &mut self.out);
        self.take_output();
        self.status.stats.ticks_skipped += self.ticker.strike(now);
        self.status.stats.ticks += 1;
        self.events.push_back(Event::Ticked(now));
        self.last_tick.store(now.nanos(), Ordering::Relaxed);
        if self.status.stats.ticks.is_multiple_of(TICKS_PER_STATUS) {
            self.show_status(now);
        }
    }

    fn arrived(&mut self, received: &Received) {
        let Received { header, message, arrived } = received;
        self.session.on_message(header, message, *arrived, &mut self.out);
        self.take_output();
    }

    /// A person's wish goes the same way as one from the ground station.
    fn wished(&mut self, wish: Wish) {
        let now = self.clock.now();
        if let Some(said) = &wish.said {
            tracing::info!(verb = ?said.verb, by = said.by.as_str(), "declared before the start");
            if let Some(recorder) = &mut self.recorder {
                recorder.declared(now, said);
            }
        }
        match self.session.on_own_wish(wish.verb, now) {
            Some(event) => {
                self.events.push_back(event);
                self.wished.push_back(wish);
            }
            None => wish.answer(false, self.pilot.phase()),
        }
    }

    /// The mission's answer to the oldest wish from the own page.
    fn answer_page(&mut self, answer: &OperatorAnswer, now: Stamp<Mono>) {
        let is_accepted = self.session.own_answer(answer, now);
        if let Some(wish) = self.wished.pop_front() {
            wish.answer(is_accepted, self.pilot.phase());
        }
    }

    fn job_ended(&mut self, result: Result<(JobId, JobOutput), JoinError>) {
        match result {
            Ok((id, output)) => {
                if matches!(output, JobOutput::Died) {
                    self.status.stats.jobs_failed += 1;
                    tracing::error!(?id, "a job died without a result");
                }
                let (at, output) = (self.clock.now(), Box::new(output));
                self.events.push_back(Event::Finished { at, id, output });
            }
            Err(error) => {
                self.status.stats.jobs_failed += 1;
                tracing::error!(%error, "a job died without a result");
            }
        }
    }

    /// Sends the session's messages and queues its events.
    fn take_output(&mut self) {
        let header = self.session.header();
        for message in self.out.messages.drain(..) {
            if self.transport.outgoing.send(Outgoing { header, message }).is_err() {
                self.status.stats.outgoing_lost += 1;
            }
        }
        self.events.extend(self.out.events.drain(..));
    }

    /// Steps the brain until no event waits.
    fn work_off(&mut self) {
        while let Some(event) = self.events.pop_front() {
            self.status.stats.events += 1;
            self.witness_event(&event);
            let now = self.clock.now();
            if let Some(recorder) = &mut self.recorder {
                recorder.event(now, &event);
            }
            let mut actions = std::mem::take(&mut self.actions);
            self.pilot.step(event, &mut actions);
            for action in actions.drain(..) {
                self.act(now, action);
            }
            self.actions = actions;
        }
    }

    fn act(&mut self, now: Stamp<Mono>, action: Action) {
        self.witness_action(&action);
        if let Some(recorder) = &mut self.recorder {
            recorder.action(now, &action);
        }
        self.session.on_action(&action, now, &mut self.out);
        self.take_output();
        match action {
            Action::Start { id, job } => self.start(id, job),
            other => {
                if let Action::Answer(answer) = &other
                    && answer.to == PAGE
                {
                    self.answer_page(answer, now);
                }
                if let Some(feed) = &self.feed {
                    feed.action(now, other);
                }
            }
        }
    }

    fn start(&mut self, id: JobId, job: Box<Job>) {
        self.status.stats.jobs_started += 1;
        if job.outside().is_none() {
            self.jobs.spawn_blocking(move || (id, job.run()));
        } else {
            let job = Arc::from(job);
            self.jobs.spawn(async move { (id, external_planner::run(job).await) });
        }
    }

    fn witness_event(&mut self, event: &Event) {
        if let Some(feed) = &self.feed {
            feed.event(event);
        }
        match event {
            Event::Vehicle(state) => self.status.vehicle = Some(*state),
            Event::AutopilotLost(_) => tracing::warn!("the autopilot is silent"),
            Event::Operator(command) => tracing::info!(verb = ?command.verb, "asked by a person"),
            _ => {}
        }
    }

    fn witness_action(&mut self, action: &Action) {
        match action {
            Action::PublishOdometry(estimate) => {
                self.status.position_sigma_m = Some(estimate.position_sigma_m().max());
            }
            Action::ReportVolume(report) => self.status.volume = Some(*report),
            Action::PhaseChanged(change) => {
                let reason = change.reason.as_str();
                tracing::info!(from = ?change.from, to = ?change.to, reason, "phase");
                self.status.phase = Some(change.to);
                self.show_status(change.at);
            }
            Action::Ended(summary) => {
                self.status.flight = Some((**summary).clone());
                self.show_status(summary.at);
            }
            Action::Say(line) if line.severity <= Severity::Warning => {
                tracing::warn!(text = line.text.as_str(), "said");
            }
            Action::Say(line) => tracing::info!(text = line.text.as_str(), "said"),
            _ => {}
        }
    }

    fn show_status(&mut self, now: Stamp<Mono>) {
        self.status.stats.link = self.session.stats();
        self.status.stats.transport = self.transport.stats();
        self.status.is_clock_known = self.session.is_clock_known();
        self.status.stats = self.full_stats();
        self.warn_of_loss(now);
        self.warn_of_slow_line(now);
        self.warn_of_refusals(now);
        if !self.warned_of_autopilots && self.status.stats.link.refused_autopilots > 0 {
            self.warned_of_autopilots = true;
            tracing::warn!("a second autopilot, or one of another kind, is on the link");
        }
        if let Some(feed) = &self.feed {
            feed.outlook(self.pilot.outlook(), pulse(&self.status));
        }
        self.status_tx.send_replace(self.status.clone());
    }

    fn warn_of_loss(&mut self, now: Stamp<Mono>) {
        let (warned_at, lost_before, wait) = self.warned;
        let lost = self.status.stats.lost();
        if lost > lost_before && now.since(warned_at) >= wait {
            tracing::warn!(lost = lost - lost_before, stats = ?self.status.stats, "data was lost");
            // What goes on, as behind a failed disk, is told ever less often.
            self.warned = (now, lost, (2 * wait).min(WARN_AT_LEAST_EVERY));
        }
    }

    /// What is sent again and again comes late, and seldom.
    fn warn_of_slow_line(&mut self, now: Stamp<Mono>) {
        let (warned_at, n_before) = self.warned_of_slow_line;
        let superseded = self.status.stats.transport.superseded;
        if superseded > n_before && now.since(warned_at) >= WARN_EVERY {
            let n = superseded - n_before;
            tracing::warn!(superseded = n, "the line to the autopilot is slower than what is sent");
            self.warned_of_slow_line = (now, superseded);
        }
    }

    /// A wrong key makes an autopilot look silent: somebody must be told why.
    fn warn_of_refusals(&mut self, now: Stamp<Mono>) {
        let guard = self.status.stats.transport.guard;
        let n_refused = guard.refused();
        let is_due = self.warned_of_refusals.is_none_or(|(at, n_before)| {
            n_refused > n_before && now.since(at) >= WARN_OF_REFUSALS_EVERY
        });
        if n_refused > 0 && is_due {
            tracing::warn!(?guard, "frames were refused before they were read");
            self.warned_of_refusals = Some((now, n_refused));
        }
    }

    /// The counters with those of the recorder's thread.
    fn full_stats(&self) -> ServiceStats {
        let mut stats = self.status.stats;
        stats.records_lost = self.recorder.as_ref().map_or(0, |recorder| recorder.lost());
        stats
    }

    /// Flushes the recorder, joins the transport and the jobs under way.
    async fn end(mut self) -> ServiceStats {
        self.show_status(self.clock.now());
        let mut stats = self.status.stats;
        if let Some(recorder) = self.recorder.take() {
            match tokio::task::spawn_blocking(move || recorder.close()).await {
                Ok(lost) => stats.records_lost = lost,
                Err(error) => tracing::error!(%error, "the recorder died"),
            }
        }
        self.jobs.shutdown().await;
        self.link_stop.cancel();
        self.transport.join().await;
        stats
    }
}

/// The counters that the page shows.
const fn pulse(status: &ServiceStatus) -> Pulse {
    let ServiceStatus { stats, is_clock_known, .. } = status;
    Pulse {
        is_clock_known: *is_clock_known,
        ticks: stats.ticks,
        ticks_skipped: stats.ticks_skipped,
        events: stats.events,
        jobs_failed: stats.jobs_failed,
        records_lost: stats.records_lost,
        outgoing_lost: stats.outgoing_lost,
        outgoing_superseded: stats.transport.superseded,
        received_lost: stats.transport.received_lost,
        refused_frames: stats.transport.guard.refused(),
        link: stats.link,
    }
}
