//! Scenarios one after the other, for what is built of many.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::cli::progress::Progress;
use crate::curation::driver::CurationObserver;
use crate::formats::Input;
use crate::scene::Scenario;

/// Reads scenarios from the first on.
pub(super) struct Reader<'a> {
    inputs: &'a [Input],
    limit: Option<NonZeroUsize>,
    progress: &'a Progress,
    stop: &'a AtomicBool,
    /// Whether what can not be read is told: not where it was told before.
    pub(super) tells: bool,
    /// Scenarios and files that could not be read and were told.
    pub(super) failed: usize,
}

impl<'a> Reader<'a> {
    /// Reads the first `limit` records of every input.
    pub(super) fn new(
        inputs: &'a [Input],
        limit: Option<NonZeroUsize>,
        progress: &'a Progress,
        stop: &'a AtomicBool,
    ) -> Self {
        Self { inputs, limit, progress, stop, tells: true, failed: 0 }
    }

    /// Shows the first good scenarios, at most so many, and says how many there were.
    pub(super) fn each(&mut self, most: usize, mut show: impl FnMut(&Scenario)) -> usize {
        let (mut shown, limit) = (0, self.limit.map_or(usize::MAX, NonZeroUsize::get));
        for input in self.inputs {
            let scenarios = match input.open() {
                Ok(scenarios) => scenarios,
                Err(error) => {
                    self.fail(&error.to_string());
                    continue;
                }
            };
            for scenario in scenarios.take(limit) {
                if shown >= most || self.stop.load(Ordering::Relaxed) {
                    return shown;
                }
                match scenario {
                    Ok(scenario) => {
                        show(&scenario);
                        shown += 1;
                        self.progress.scenario_done(shown);
                    }
                    Err(error) => self.fail(&error.to_string()),
                }
            }
        }
        shown
    }

    fn fail(&mut self, error: &str) {
        if self.tells {
            self.progress.failed(error);
            self.failed += 1;
        }
    }
}
