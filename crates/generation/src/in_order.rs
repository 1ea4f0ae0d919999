//! Parallel work on numbers whose results are delivered in the order of the numbers.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;
use reactsim_files::work::{MAX_THREADS, Pool};

/// Results per thread that are in memory at a time: enough that threads seldom wait for the slowest.
pub(super) const CHUNK_PER_JOB: usize = 8;

/// Outcome of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// All numbers were processed, or the consumer asked to stop early.
    Done,
    /// Stopped from outside. Everything before the first unfinished number was handed over.
    Stopped,
}

/// Computes a result for every number from 0 to below `end` on `jobs` threads, and passes the results to
/// `take` in the order of the numbers on the calling thread.
///
/// `make` sees the state as it was some numbers earlier; how many depends on the threads. It may use the
/// state to save work, but the outcome must not depend on it. If `stop` is set meanwhile, numbers that were
/// not begun are skipped.
///
/// # Errors
/// The first error of `take`, which ends the work.
pub fn in_order<S: Sync, T: Send, E>(
    end: u64,
    jobs: usize,
    stop: &AtomicBool,
    state: &mut S,
    make: impl Fn(&S, u64) -> T + Sync,
    mut take: impl FnMut(&mut S, u64, T) -> Result<ControlFlow<()>, E>,
) -> Result<Ending, E> {
    let jobs = jobs.clamp(1, MAX_THREADS);
    let pool = Pool::new(jobs);
    let mut next = 0;
    while next < end {
        let chunk = next..end.min(next + (jobs * CHUNK_PER_JOB) as u64);
        next = chunk.end;
        let one = |n| (!stop.load(Ordering::Relaxed)).then(|| make(state, n));
        let all = || chunk.clone().into_par_iter().map(one).collect::<Vec<_>>();
        for (number, result) in chunk.clone().zip(pool.install(all)) {
            let Some(result) = result else { return Ok(Ending::Stopped) };
            if take(state, number, result)?.is_break() {
                return Ok(Ending::Done);
            }
        }
    }
    Ok(Ending::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_in_order_whatever_the_threads() {
        for jobs in [1, 3, 16] {
            let mut seen = Vec::new();
            let take = |seen: &mut Vec<u64>, n, square| {
                assert_eq!(n * n, square);
                seen.push(n);
                Ok::<_, ()>(ControlFlow::Continue(()))
            };
            let ended = in_order(100, jobs, &AtomicBool::new(false), &mut seen, |_, n| n * n, take);
            assert_eq!(ended, Ok(Ending::Done));
            assert_eq!(seen, (0..100).collect::<Vec<_>>());
        }
    }

    #[test]
    fn it_ends_when_asked_and_when_stopped() {
        let stop = AtomicBool::new(false);
        let mut seen = 0;
        let until_30 = |seen: &mut u64, n, _| {
            *seen += 1;
            Ok::<_, ()>(if n == 30 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        };
        assert_eq!(in_order(u64::MAX, 4, &stop, &mut seen, |_, n| n, until_30), Ok(Ending::Done));
        assert_eq!(seen, 31);
        let stop_at_20 = |_: &u64, n| {
            if n == 20 {
                stop.store(true, Ordering::Relaxed);
            }
        };
        let count = |seen: &mut u64, _, ()| {
            *seen += 1;
            Ok::<_, ()>(ControlFlow::Continue(()))
        };
        seen = 0;
        assert_eq!(in_order(1000, 1, &stop, &mut seen, stop_at_20, count), Ok(Ending::Stopped));
        assert_eq!(seen, 21);
        let refuse = |_: &mut u64, n, ()| if n == 2 { Err(n) } else { Ok(ControlFlow::Continue(())) };
        stop.store(false, Ordering::Relaxed);
        assert_eq!(in_order(1000, 2, &stop, &mut seen, |_, _| (), refuse), Err(2));
    }
}
