//! Runs of many seeds on several cores, with results in the order of the seeds.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;

/// Calls `run` for every seed on up to `n_jobs` threads; `done` sees each result in the order of
/// the seeds, as soon as all before it are there.
///
/// Which threads ran what cannot be seen in the results if `run` depends on its seed alone.
///
/// # Errors
/// The error of the lowest seed that failed; no seed is begun after a failure.
pub fn run_in_order<T: Send, E: Send>(
    seeds: Range<u64>,
    n_jobs: NonZeroUsize,
    run: impl Fn(u64) -> Result<T, E> + Sync,
    mut done: impl FnMut(&T),
) -> Result<Vec<T>, E> {
    let next_seed = AtomicU64::new(seeds.start);
    let has_failed = AtomicBool::new(false);
    let work = |results: mpsc::Sender<(u64, Result<T, E>)>| {
        while !has_failed.load(Ordering::Relaxed) {
            let seed = next_seed.fetch_add(1, Ordering::Relaxed);
            if seed >= seeds.end {
                break;
            }
            let result = run(seed);
            has_failed.fetch_or(result.is_err(), Ordering::Relaxed);
            if results.send((seed, result)).is_err() {
                break;
            }
        }
    };
    std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::channel();
        for _ in 0..n_jobs.get() {
            let sender = sender.clone();
            scope.spawn(|| work(sender));
        }
        drop(sender);
        let mut early = BTreeMap::new();
        let mut finished = Vec::new();
        let mut due = seeds.start;
        for (seed, result) in receiver {
            early.insert(seed, result);
            while let Some(result) = early.remove(&due) {
                let value = result?;
                done(&value);
                finished.push(value);
                due += 1;
            }
        }
        Ok(finished)
    })
}

/// As many threads as this machine runs at once.
#[must_use]
pub fn n_cores() -> NonZeroUsize {
    std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn jobs(n: usize) -> NonZeroUsize {
        NonZeroUsize::new(n).unwrap()
    }

    #[test]
    fn results_come_in_the_order_of_the_seeds_whatever_finishes_first() {
        for n in [1, 2, 7] {
            let mut seen = Vec::new();
            let results = run_in_order(
                3..40,
                jobs(n),
                |seed| {
                    // The later the seed, the shorter the work.
                    let turns = 1000 * (40 - seed);
                    let sum = (0..turns).fold(seed, |sum, i| std::hint::black_box(sum ^ i ^ i));
                    Ok::<_, ()>(sum)
                },
                |value| seen.push(*value),
            );
            assert_eq!(results.unwrap(), (3..40).collect::<Vec<u64>>());
            assert_eq!(seen, (3..40).collect::<Vec<u64>>());
        }
    }

    #[test]
    fn the_lowest_failing_seed_is_reported_and_ends_the_work() {
        let n_begun = AtomicU64::new(0);
        let result = run_in_order(
            0..1_000_000,
            jobs(3),
            |seed| {
                n_begun.fetch_add(1, Ordering::Relaxed);
                if seed < 10 { Ok(seed) } else { Err(seed) }
            },
            |_| {},
        );
        assert_eq!(result, Err(10));
        assert!(n_begun.load(Ordering::Relaxed) < 1_000_000);
        assert_eq!(run_in_order(4..4, jobs(2), Ok::<u64, ()>, |_| {}), Ok(vec![]));
    }
}
