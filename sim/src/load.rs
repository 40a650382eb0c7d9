//! What the service needs of the computer while it flies in the simulator's process.
//!
//! The simulator runs in one thread, the service in all others; so the service's processor time is
//! that of the process less that of the calling thread. Memory cannot be told apart: the peak counts
//! both, which is more than the service needs by itself.

use crate::report::ServiceLoad;
use rustix::time::{ClockId, Timespec, clock_gettime};
use std::time::Duration;

/// Meters one flight; to be started and read in the simulator's thread.
#[derive(Debug, Clone, Copy)]
pub struct LoadMeter {
    process_s: f64,
    own_thread_s: f64,
    resident_mib: f64,
}

impl LoadMeter {
    /// Begins to count, before the service starts.
    #[must_use]
    pub fn start() -> Self {
        Self {
            process_s: seconds(clock_gettime(ClockId::ProcessCPUTime)),
            own_thread_s: seconds(clock_gettime(ClockId::ThreadCPUTime)),
            resident_mib: memory_mib("VmRSS"),
        }
    }

    /// What was needed since the start, for a flight of this length.
    #[must_use]
    pub fn read(&self, flight_time: Duration) -> ServiceLoad {
        let process_s = seconds(clock_gettime(ClockId::ProcessCPUTime)) - self.process_s;
        let simulator_cpu_s = seconds(clock_gettime(ClockId::ThreadCPUTime)) - self.own_thread_s;
        let cpu_s = (process_s - simulator_cpu_s).max(0.0);
        ServiceLoad {
            cpu_s,
            core_share: cpu_s / flight_time.as_secs_f64(),
            simulator_cpu_s,
            resident_before_mib: self.resident_mib,
            resident_peak_mib: memory_mib("VmHWM"),
        }
    }
}

#[expect(clippy::cast_precision_loss, reason = "seconds stay far below 2^53")]
fn seconds(time: Timespec) -> f64 {
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// An entry of `/proc/self/status` that is given in kB, MiB; 0 where there is none.
fn memory_mib(entry: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(entry)?.strip_prefix(':'));
    let kib = line.and_then(|rest| rest.split_whitespace().next()?.parse::<f64>().ok());
    kib.unwrap_or(0.0) / 1024.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Works until this thread has spent so much processor time, s.
    fn spend_s(wanted_s: f64) {
        let began_s = seconds(clock_gettime(ClockId::ThreadCPUTime));
        let mut sum = 0_u64;
        while seconds(clock_gettime(ClockId::ThreadCPUTime)) - began_s < wanted_s {
            sum = std::hint::black_box(sum.wrapping_mul(31).wrapping_add(7));
        }
    }

    #[test]
    fn time_of_other_threads_is_the_services_and_own_time_is_not() {
        let meter = LoadMeter::start();
        std::thread::scope(|scope| {
            scope.spawn(|| spend_s(0.15));
        });
        spend_s(0.05);
        let load = meter.read(Duration::from_secs(1));
        // Other tests in this process count as other threads, so there is no upper bound.
        assert!(load.cpu_s >= 0.149, "{load:?}");
        assert!((0.049..0.149).contains(&load.simulator_cpu_s), "{load:?}");
        assert!((load.core_share - load.cpu_s).abs() < 1e-12);
    }

    #[test]
    fn memory_of_a_process_is_at_least_what_it_has_written_to() {
        let before = LoadMeter::start().resident_mib;
        let block = vec![1_u8; 64 << 20];
        let load = LoadMeter::start().read(Duration::from_secs(1));
        assert!(std::hint::black_box(&block).iter().all(|byte| *byte == 1));
        assert!(before > 1.0 && load.resident_peak_mib > 64.0, "{load:?}");
        assert!(load.resident_peak_mib >= load.resident_before_mib);
    }
}
