//! Progress of a run on stderr.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use super::say;
use crate::curation::driver::CurationObserver;
use crate::evaluation::{Failure, RunObserver};

/// Maximum number of failures printed as they happen; the run folder lists all.
const MAX_PRINTED_FAILURES: usize = 20;

/// Spinner with the number of scenarios, hidden if stderr is not a terminal. Failures are always
/// printed.
pub(super) struct Progress {
    bar: ProgressBar,
    failures: AtomicUsize,
}

impl Progress {
    pub(super) fn new() -> Self {
        let bar = ProgressBar::new_spinner();
        if let Ok(style) =
            ProgressStyle::with_template("{spinner} {pos} scenarios, {per_sec}, {elapsed}{msg}")
        {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(120));
        Self { bar, failures: AtomicUsize::new(0) }
    }

    fn failure(&self, text: std::fmt::Arguments<'_>) {
        let n = self.failures.fetch_add(1, Ordering::Relaxed) + 1;
        self.bar.set_message(format!(", {n} failed"));
        if n <= MAX_PRINTED_FAILURES {
            self.bar.suspend(|| say(format_args!("warning: failed{text}")));
        }
    }

    /// Removes the spinner and prints how many failures were not printed.
    pub(super) fn end(&self) {
        self.bar.finish_and_clear();
        let failures = self.failures.load(Ordering::Relaxed);
        if failures > MAX_PRINTED_FAILURES {
            let more = failures - MAX_PRINTED_FAILURES;
            say(format_args!("warning: {more} more failures were not printed"));
        }
    }
}

impl RunObserver for Progress {
    fn scenario_done(&self, done: usize) {
        self.bar.set_position(done as u64);
    }

    fn failed(&self, failure: &Failure) {
        let simulator = failure.simulator.as_deref().map(|s| format!(" ({s})")).unwrap_or_default();
        self.failure(format_args!("{simulator}: {}", failure.error));
    }
}

impl CurationObserver for Progress {
    fn scenario_done(&self, done: usize) {
        self.bar.set_position(done as u64);
    }

    fn failed(&self, error: &str) {
        self.failure(format_args!(": {error}"));
    }
}
