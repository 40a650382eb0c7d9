//! The one place that asks what time it is.

use crate::link::transport::Timer;
use crate::time::{Mono, Stamp};
use std::future::Future;
use std::time::Duration;
use tokio::sync::watch;

/// The service's clock; clones show the same time.
///
/// The real one is the computer's `CLOCK_MONOTONIC`, which also stamps camera frames. The driven
/// one stands still until its [`ClockDriver`] moves it.
#[derive(Debug, Clone)]
pub struct Clock {
    kind: Kind,
}

#[derive(Debug, Clone)]
enum Kind {
    Real,
    Driven(watch::Receiver<Stamp<Mono>>),
}

/// The time of day at which driven clocks begin: 2026-01-01T00:00:00Z.
const DRIVEN_CLOCKS_BEGIN: Duration = Duration::from_secs(1_767_225_600);

/// Moves a driven clock.
#[derive(Debug)]
pub struct ClockDriver {
    now: watch::Sender<Stamp<Mono>>,
}

impl Clock {
    /// The computer's clock.
    #[must_use]
    pub const fn real() -> Self {
        Self { kind: Kind::Real }
    }

    /// A clock at [`Stamp::ZERO`], and what moves it.
    #[must_use]
    pub fn driven() -> (Self, ClockDriver) {
        let (sender, receiver) = watch::channel(Stamp::ZERO);
        (Self { kind: Kind::Driven(receiver) }, ClockDriver { now: sender })
    }

    /// The present instant.
    #[must_use]
    pub fn now(&self) -> Stamp<Mono> {
        match &self.kind {
            Kind::Real => monotonic_now(),
            Kind::Driven(now) => *now.borrow(),
        }
    }

    /// The time of day in UTC, as long after 1970 as it says; it may jump.
    #[must_use]
    pub fn since_1970(&self) -> Duration {
        match &self.kind {
            Kind::Real => {
                let time = rustix::time::clock_gettime(rustix::time::ClockId::Realtime);
                let nanos = u32::try_from(time.tv_nsec).unwrap_or(0);
                Duration::new(u64::try_from(time.tv_sec).unwrap_or(0), nanos)
            }
            Kind::Driven(now) => DRIVEN_CLOCKS_BEGIN + now.borrow().since(Stamp::ZERO),
        }
    }

    /// Returns once `deadline` has come. On a driven clock without a driver that is never.
    pub async fn sleep_until(&self, deadline: Stamp<Mono>) {
        match &self.kind {
            Kind::Real => {
                // Timers count another clock and may fire a little early against this one.
                while monotonic_now() < deadline {
                    tokio::time::sleep(deadline.since(monotonic_now())).await;
                }
            }
            Kind::Driven(now) => {
                let mut now = now.clone();
                if now.wait_for(|now| *now >= deadline).await.is_err() {
                    std::future::pending::<()>().await;
                }
            }
        }
    }
}

impl Timer for Clock {
    fn now(&self) -> Stamp<Mono> {
        Self::now(self)
    }

    fn sleep_until(&self, deadline: Stamp<Mono>) -> impl Future<Output = ()> + Send {
        Self::sleep_until(self, deadline)
    }
}

impl ClockDriver {
    /// Moves the clock forward to `at` and wakes who waited for it; an earlier `at` changes
    /// nothing.
    pub fn advance_to(&self, at: Stamp<Mono>) {
        self.now.send_if_modified(|now| {
            let is_later = at > *now;
            *now = (*now).max(at);
            is_later
        });
    }

    /// The present instant of the clock.
    #[must_use]
    pub fn now(&self) -> Stamp<Mono> {
        *self.now.borrow()
    }
}

fn monotonic_now() -> Stamp<Mono> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    Stamp::from_nanos(time.tv_sec.saturating_mul(1_000_000_000).saturating_add(time.tv_nsec))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_driven_clock_wakes_sleepers_at_their_time_and_not_before() {
        let (clock, driver) = Clock::driven();
        let deadline = Stamp::ZERO.plus(Duration::from_millis(10));
        let sleeper = clock.clone();
        let task = tokio::spawn(async move {
            sleeper.sleep_until(deadline).await;
            sleeper.now()
        });
        driver.advance_to(Stamp::ZERO.plus(Duration::from_millis(9)));
        for _ in 0..10 {
            tokio::task::yield_now().await;
        }
        assert!(!task.is_finished());
        driver.advance_to(deadline);
        assert_eq!(task.await.unwrap(), deadline);
    }

    #[test]
    fn a_driven_clock_never_runs_back() {
        let (clock, driver) = Clock::driven();
        driver.advance_to(Stamp::from_nanos(500));
        driver.advance_to(Stamp::from_nanos(400));
        assert_eq!(clock.now(), Stamp::from_nanos(500));
    }

    #[tokio::test]
    async fn the_real_clock_sleeps_at_least_so_long() {
        let clock = Clock::real();
        let deadline = clock.now().plus(Duration::from_millis(3));
        clock.sleep_until(deadline).await;
        assert!(clock.now() >= deadline);
    }
}
