//! Instants on named clocks. Nothing here asks what time it is: the core is told.

use std::cmp::Ordering;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::marker::PhantomData;
use std::time::Duration;

/// The monotonic clock of this computer; every event in the brain carries it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mono;

/// Time since the autopilot's boot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Boot;

/// Civil time, for people and file names only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Utc;

/// An instant on the clock `C`, in nanoseconds since that clock's zero.
///
/// Stamps of different clocks do not mix:
///
/// ```
/// use stockpilot::time::{Mono, Stamp};
/// let a = Stamp::<Mono>::from_nanos(5);
/// let b = Stamp::<Mono>::from_nanos(3);
/// assert_eq!(a.nanos_since(b), 2);
/// ```
/// ```compile_fail
/// use stockpilot::time::{Boot, Mono, Stamp};
/// let a = Stamp::<Mono>::from_nanos(5);
/// let b = Stamp::<Boot>::from_nanos(3);
/// assert_eq!(a.nanos_since(b), 2);
/// ```
pub struct Stamp<C> {
    nanos: i64,
    clock: PhantomData<C>,
}

impl<C> Stamp<C> {
    /// The clock's zero.
    pub const ZERO: Self = Self::from_nanos(0);

    /// The instant `nanos` after the clock's zero.
    #[must_use]
    pub const fn from_nanos(nanos: i64) -> Self {
        Self { nanos, clock: PhantomData }
    }

    /// Nanoseconds since the clock's zero.
    #[must_use]
    pub const fn nanos(self) -> i64 {
        self.nanos
    }

    /// Seconds since the clock's zero, for display and plots.
    #[must_use]
    pub fn seconds(self) -> f64 {
        self.seconds_since(Self::ZERO)
    }

    /// Signed nanoseconds from `earlier` to this instant; saturates.
    #[must_use]
    pub const fn nanos_since(self, earlier: Self) -> i64 {
        self.nanos.saturating_sub(earlier.nanos)
    }

    /// Signed seconds from `earlier` to this instant.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "differences of instants stay below 2^53 ns")]
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.nanos_since(earlier) as f64 * 1e-9
    }

    /// The span from `earlier` to this instant; zero if `earlier` is later.
    #[must_use]
    #[expect(clippy::cast_sign_loss, reason = "negative spans are cut to zero first")]
    pub const fn since(self, earlier: Self) -> Duration {
        let nanos = self.nanos_since(earlier);
        Duration::from_nanos(if nanos < 0 { 0 } else { nanos as u64 })
    }

    /// This instant, `span` later; saturates.
    #[must_use]
    pub fn plus(self, span: Duration) -> Self {
        let nanos = i64::try_from(span.as_nanos()).unwrap_or(i64::MAX);
        Self::from_nanos(self.nanos.saturating_add(nanos))
    }

    /// This instant, `span` earlier; saturates.
    #[must_use]
    pub fn minus(self, span: Duration) -> Self {
        let nanos = i64::try_from(span.as_nanos()).unwrap_or(i64::MAX);
        Self::from_nanos(self.nanos.saturating_sub(nanos))
    }
}

// By hand: a derive would ask the clock's marker for traits it does not need.
impl<C> Clone for Stamp<C> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<C> Copy for Stamp<C> {}
impl<C> Default for Stamp<C> {
    fn default() -> Self {
        Self::ZERO
    }
}
impl<C> PartialEq for Stamp<C> {
    fn eq(&self, other: &Self) -> bool {
        self.nanos == other.nanos
    }
}
impl<C> Eq for Stamp<C> {}
impl<C> PartialOrd for Stamp<C> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl<C> Ord for Stamp<C> {
    fn cmp(&self, other: &Self) -> Ordering {
        self.nanos.cmp(&other.nanos)
    }
}
impl<C> Hash for Stamp<C> {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.nanos.hash(state);
    }
}
impl<C> fmt::Debug for Stamp<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.6} s", self.seconds())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_never_go_negative() {
        let early = Stamp::<Mono>::from_nanos(10);
        let late = early.plus(Duration::from_nanos(7));
        assert_eq!(late.since(early), Duration::from_nanos(7));
        assert_eq!(early.since(late), Duration::ZERO);
        assert_eq!(early.nanos_since(late), -7);
    }

    #[test]
    fn sums_saturate_instead_of_wrapping() {
        let last = Stamp::<Mono>::from_nanos(i64::MAX);
        assert_eq!(last.plus(Duration::from_secs(1)), last);
    }
}
