//! The brain under everything that finite numbers can say.

use crate::support::{at_s, frame, settings};
use nalgebra::Vector3;
use std::time::Duration;
use stockpilot::geometry::{Body, Direction, Hall, Point, Rotation, Transform};
use stockpilot::messages::{
    AutopilotPose, BatterySample, Beam, CameraId, CommandOutcome, FlightMode, ImuSample,
    LandedState, OperatorCommand, OperatorRequest, OperatorVerb, Scan, Setpoint, TagDetections,
    TakeOff, VehicleCommand, VehicleState,
};
use stockpilot::mission::Phase;
use stockpilot::pilot::{Action, Event, JobId, JobOutput, Pilot};
use stockpilot::stats::{Noise, SeedBook};
use stockpilot::time::{Mono, Stamp};

/// A vehicle that does what it is asked, as the brain sees it, and now and then says nonsense.
pub(crate) struct Source {
    noise: Noise,
    nonsense: f64,
    k: i64,
    /// What is flown exactly, once armed.
    setpoint: Option<Setpoint>,
    place: Vector3<f64>,
    is_armed: bool,
    mode: FlightMode,
    jobs: Vec<(JobId, JobOutput)>,
}

impl Source {
    pub(crate) fn new(seed: u64, nonsense: f64) -> Self {
        Self {
            noise: SeedBook::new(seed).stream("events"),
            nonsense,
            k: 0,
            setpoint: None,
            place: Vector3::new(1.0, 1.0, 0.1),
            is_armed: false,
            mode: FlightMode::Hold,
            jobs: Vec::new(),
        }
    }

    pub(crate) fn now(&self) -> Stamp<Mono> {
        Stamp::from_nanos(self.k * 5_000_000)
    }

    fn pose(&self) -> Transform<Hall, Body> {
        Transform::new(Rotation::identity(), Point::from_coords(self.place))
    }

    /// The events of the next 5 ms.
    pub(crate) fn events(&mut self) -> Vec<Event> {
        self.k += 1;
        let now = self.now();
        let mut accel_mps2 = Vector3::z() * 9.80665;
        if let Some(setpoint) = self.setpoint.filter(|_| self.is_armed) {
            let dt = now.seconds_since(setpoint.at);
            let (v, a) = (setpoint.velocity_mps.coords, setpoint.accel_mps2.coords);
            self.place = setpoint.position.coords + v * dt + a * (0.5 * dt * dt);
            accel_mps2 += a;
        }
        let mut events = vec![Event::Imu(ImuSample {
            at: now,
            accel_mps2: accel_mps2 + self.noise.normal3() * 0.02,
            gyro_radps: self.noise.normal3() * 0.002,
        })];
        if self.k % 10 == 0 {
            // Frames arrive with the next sample; lateness is among the nonsense.
            events.push(Event::TagsSeen(frame(&self.pose(), now)));
        }
        if self.k % 20 == 0 {
            events.push(Event::Scanned(self.scan(now)));
            events.push(Event::Vehicle(self.vehicle(now)));
            events.push(Event::AutopilotPose(AutopilotPose {
                at: now,
                position: Point::from_coords(self.place),
                velocity_mps: Direction::from_coords(Vector3::zeros()),
                hall_from_body_rot: Some(Rotation::identity()),
            }));
            let battery =
                BatterySample { at: now, voltage_v: 15.2, current_a: 12.0, remaining_ratio: 0.9 };
            events.push(Event::Battery(battery));
        }
        if self.k == 600 {
            let from = OperatorRequest { system: 255, component: 190 };
            let verb = OperatorVerb::Start;
            events.push(Event::Operator(OperatorCommand { at: now, verb, from }));
        }
        events.extend(self.jobs.drain(..).map(|(id, output)| Event::Finished {
            at: now,
            id,
            output: Box::new(output),
        }));
        if self.k % 3 == 0 {
            events.push(Event::Ticked(now));
        }
        if self.noise.chance(self.nonsense) {
            let event = self.absurd(now);
            events.push(event);
        }
        events
    }

    /// Follows the brain, as an autopilot would.
    pub(crate) fn obey(&mut self, action: &Action) {
        match action {
            Action::Steer(setpoint) => self.setpoint = Some(*setpoint),
            Action::Command(VehicleCommand::Arm) => self.is_armed = true,
            Action::Command(VehicleCommand::EnterCompanionMode) => {
                self.mode = FlightMode::Companion;
            }
            Action::Command(VehicleCommand::EnterLand) => {
                self.is_armed = false;
                self.mode = FlightMode::Land;
            }
            Action::Start { id, job } => self.jobs.push((*id, job.run())),
            _ => {}
        }
    }

    /// The payload of the HEARTBEAT that PX4 would send.
    pub(crate) fn heartbeat(&self) -> [u8; 9] {
        let [_, _, main, sub] = match self.mode {
            FlightMode::Companion => 0x0006_0000_u32,
            FlightMode::Land => 0x0604_0000,
            _ => 0x0304_0000,
        }
        .to_le_bytes();
        let base = if self.is_armed { 0x91 } else { 0x11 };
        [0, 0, main, sub, 2, 12, base, 3, 3]
    }

    fn vehicle(&self, at: Stamp<Mono>) -> VehicleState {
        let landed = if self.is_armed { LandedState::InAir } else { LandedState::OnGround };
        VehicleState {
            at,
            is_armed: self.is_armed,
            mode: self.mode,
            landed,
            in_failsafe: false,
            is_ready: true,
            is_contested: false,
            is_mode_prompt: true,
            takes_off: TakeOff::BySetpoints,
        }
    }

    fn scan(&mut self, start: Stamp<Mono>) -> Scan {
        #[expect(clippy::cast_possible_truncation, reason = "beams are single precision")]
        let beam = |k: u32| {
            let angle_rad = f64::from(k) * 0.05 - 1.5;
            let range_m = self.place.z / angle_rad.cos();
            Beam {
                offset_ns: k * 1_000_000,
                angle_rad: angle_rad as f32,
                range_m: range_m as f32,
                intensity: 80,
            }
        };
        Scan { start, beams: (0..60).map(beam).collect() }
    }

    /// Finite, of any size and sign.
    fn wild(&mut self) -> f64 {
        match self.noise.bits() % 8 {
            0 => 0.0,
            1 => f64::MAX,
            2 => f64::MIN,
            3 => f64::MIN_POSITIVE,
            4 => self.noise.normal(),
            _ => self.noise.normal() * 10_f64.powf(self.noise.between(-300.0, 300.0)),
        }
    }

    fn wild3(&mut self) -> Vector3<f64> {
        Vector3::new(self.wild(), self.wild(), self.wild())
    }

    #[expect(clippy::cast_possible_truncation, reason = "any number will do")]
    fn wild_single(&mut self) -> f32 {
        (self.wild() as f32).clamp(f32::MIN, f32::MAX)
    }

    fn wild_stamp(&mut self, now: Stamp<Mono>) -> Stamp<Mono> {
        let shift_s = match self.noise.bits() % 6 {
            0 => return Stamp::from_nanos(i64::MAX),
            1 => return Stamp::from_nanos(i64::MIN),
            2 => self.noise.normal() * 1e5,
            3 => self.noise.normal() * 3.0,
            _ => self.noise.normal() * 0.05,
        };
        let shift = Duration::from_secs_f64(shift_s.abs());
        if shift_s > 0.0 { now.plus(shift) } else { now.minus(shift) }
    }

    fn absurd(&mut self, now: Stamp<Mono>) -> Event {
        let at = self.wild_stamp(now);
        match self.noise.bits() % 9 {
            0 => Event::Imu(ImuSample { at, accel_mps2: self.wild3(), gyro_radps: self.wild3() }),
            1 => Event::Imu(ImuSample {
                at: now,
                accel_mps2: self.noise.normal3() * 100.0,
                gyro_radps: self.noise.normal3() * 20.0,
            }),
            2 => Event::TagsSeen(self.absurd_frame(at)),
            3 => Event::TagsSeen(TagDetections { captured_at: at, ..frame(&self.pose(), now) }),
            4 => Event::Scanned(Scan { start: at, beams: Vec::new() }),
            5 => Event::Scanned(self.absurd_scan(at)),
            6 => Event::Battery(BatterySample {
                at,
                voltage_v: self.wild(),
                current_a: self.wild(),
                remaining_ratio: self.noise.between(0.3, 1.0),
            }),
            7 => Event::AutopilotPose(AutopilotPose {
                at,
                position: Point::from_coords(self.wild3()),
                velocity_mps: Direction::from_coords(self.wild3()),
                hall_from_body_rot: None,
            }),
            _ => Event::CommandAnswered(CommandOutcome {
                at,
                command: VehicleCommand::Arm,
                is_accepted: self.noise.chance(0.5),
            }),
        }
    }

    fn absurd_frame(&mut self, captured_at: Stamp<Mono>) -> TagDetections {
        let mut seen = frame(&self.pose(), captured_at);
        let is_all = self.noise.chance(0.3);
        for tag in &mut seen.tags {
            if is_all || self.noise.chance(0.3) {
                tag.corners_px = [0; 4].map(|_| [self.wild(), self.wild()]);
            }
            if self.noise.chance(0.1) {
                tag.corners_px = [tag.corners_px[0]; 4];
            }
        }
        if self.noise.chance(0.2) {
            seen.camera = CameraId(7);
        }
        seen
    }

    fn absurd_scan(&mut self, start: Stamp<Mono>) -> Scan {
        let beams = (0..50).map(|_| Beam {
            offset_ns: u32::try_from(self.noise.bits() >> 32).unwrap_or(0),
            angle_rad: self.wild_single(),
            range_m: self.wild_single(),
            intensity: 255,
        });
        Scan { start, beams: beams.collect() }
    }
}

/// True if any number in the action is NaN or infinite, wherever it stands.
fn has_no_number(action: &Action) -> bool {
    format!("{action:?}")
        .split(|c: char| !c.is_alphanumeric())
        .any(|word| matches!(word, "NaN" | "inf"))
}

/// Runs for `seconds`; every action passes `check`.
fn run(seed: u64, nonsense: f64, seconds: f64, mut check: impl FnMut(&Action)) -> Vec<Phase> {
    let mut source = Source::new(seed, nonsense);
    let mut pilot = Pilot::new(settings());
    let mut phases = Vec::new();
    let mut actions = Vec::new();
    while source.now() < at_s(seconds) {
        for event in source.events() {
            pilot.step(event, &mut actions);
        }
        for action in actions.drain(..) {
            check(&action);
            source.obey(&action);
            if let Action::PhaseChanged(change) = &action {
                phases.push(change.to);
            }
        }
    }
    phases
}

#[test]
fn the_source_without_nonsense_flies_a_whole_survey() {
    // The premise of the tests below: the brain gets far enough to steer and to solve.
    let phases = run(1, 0.0, 60.0, |action| assert!(!has_no_number(action), "{action:?}"));
    let expected = [Phase::Preflight, Phase::TakeOff, Phase::Survey, Phase::Return, Phase::Land];
    assert_eq!(phases[..5], expected, "{phases:?}");
}

#[test]
fn no_action_ever_holds_what_is_not_a_number() {
    let mut n_steered = 0;
    for seed in 0..3 {
        let nonsense = [0.02, 0.2, 0.9][usize::try_from(seed % 3).expect("small")];
        run(seed, nonsense, 20.0, |action| {
            assert!(!has_no_number(action), "seed {seed}: {action:?}");
            n_steered += u32::from(matches!(action, Action::Steer(_)));
        });
    }
    assert!(n_steered > 300, "only {n_steered} setpoints: the premise does not hold");
}

#[test]
fn nonsense_now_and_then_does_not_end_the_survey() {
    // One absurd event every two seconds must not cost the position for good.
    for seed in 10..12 {
        let phases = run(seed, 0.0025, 60.0, |_| {});
        assert!(phases.contains(&Phase::Return), "seed {seed}: {phases:?}");
    }
}

#[test]
fn same_events_same_actions() {
    let mut first = Vec::new();
    run(3, 0.2, 15.0, |action| first.push(action.clone()));
    let mut k = 0;
    run(3, 0.2, 15.0, |action| {
        assert_eq!(Some(action), first.get(k), "action {k}");
        k += 1;
    });
    assert_eq!(k, first.len());
    assert!(k > 400, "only {k} actions");
}
