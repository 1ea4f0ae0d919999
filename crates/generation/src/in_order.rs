//! Parallel work whose results are delivered in order.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;
use reactsim_files::work::{MAX_THREADS, Pool};

/// Results per thread that are in memory at a time: enough that threads seldom wait for the slowest.
const CHUNK_PER_JOB: usize = 8;

/// Outcome of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// All items were processed, or the consumer asked to stop early.
    Done,
    /// Stopped from outside. Everything before the first unfinished item was handed over.
    Stopped,
}

/// Computes a result for every item on `jobs` threads, and passes the results to `take` in the order of the
/// items on the calling thread.
///
/// `make` sees the state as it was some items earlier; how many depends on the threads. It may use the state
/// to save work, but the outcome must not depend on it. If `stop` is set meanwhile, items that were not begun
/// are skipped.
///
/// # Errors
/// The first error of `take`, which ends the work.
pub fn in_order<S: Sync, I: Send, T: Send, E>(
    mut items: impl Iterator<Item = I>,
    jobs: usize,
    stop: &AtomicBool,
    state: &mut S,
    make: impl Fn(&S, I) -> T + Sync,
    mut take: impl FnMut(&mut S, T) -> Result<ControlFlow<()>, E>,
) -> Result<Ending, E> {
    let jobs = jobs.clamp(1, MAX_THREADS);
    let pool = Pool::new(jobs);
    loop {
        let chunk: Vec<I> = items.by_ref().take(jobs * CHUNK_PER_JOB).collect();
        if chunk.is_empty() {
            return Ok(Ending::Done);
        }
        let one = |item| (!stop.load(Ordering::Relaxed)).then(|| make(state, item));
        let results: Vec<Option<T>> = pool.install(|| chunk.into_par_iter().map(one).collect());
        for result in results {
            let Some(result) = result else { return Ok(Ending::Stopped) };
            if take(state, result)?.is_break() {
                return Ok(Ending::Done);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_in_order_whatever_the_threads() {
        for jobs in [1, 3, 16] {
            let mut seen = Vec::new();
            let take = |seen: &mut Vec<u64>, square| {
                seen.push(square);
                Ok::<_, ()>(ControlFlow::Continue(()))
            };
            let ended = in_order(0..100, jobs, &AtomicBool::new(false), &mut seen, |_, n| n * n, take);
            assert_eq!(ended, Ok(Ending::Done));
            assert_eq!(seen, (0..100).map(|n| n * n).collect::<Vec<_>>());
        }
    }

    #[test]
    fn it_ends_when_asked_and_when_stopped() {
        let stop = AtomicBool::new(false);
        let mut seen = 0;
        let until_30 = |seen: &mut u64, n| {
            *seen += 1;
            Ok::<_, ()>(if n == 30 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        };
        assert_eq!(in_order(0.., 4, &stop, &mut seen, |_, n| n, until_30), Ok(Ending::Done));
        assert_eq!(seen, 31);
        let stop_at_20 = |_: &u64, n| {
            if n == 20 {
                stop.store(true, Ordering::Relaxed);
            }
        };
        let count = |seen: &mut u64, ()| {
            *seen += 1;
            Ok::<_, ()>(ControlFlow::Continue(()))
        };
        seen = 0;
        assert_eq!(in_order(0..1000, 1, &stop, &mut seen, stop_at_20, count), Ok(Ending::Stopped));
        assert_eq!(seen, 21);
        let refuse = |_: &mut u64, n| if n == 2 { Err(n) } else { Ok(ControlFlow::Continue(())) };
        stop.store(false, Ordering::Relaxed);
        assert_eq!(in_order(0..1000, 2, &stop, &mut seen, |_, n| n, refuse), Err(2));
    }
}
