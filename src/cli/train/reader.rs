//! Sequential reading of scenarios from many files.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::cli::output::{ExitStatus, count, say};
use crate::cli::progress::Progress;
use crate::curation::driver::CurationObserver;
use crate::formats::Input;
use crate::scene::Scenario;

/// Reads scenarios in the order of the files.
pub(super) struct Reader<'a> {
    inputs: &'a [Input],
    limit: Option<NonZeroUsize>,
    progress: &'a Progress,
    stop: &'a AtomicBool,
    /// Whether to report and count unreadable scenarios; off when reading them a second time.
    pub(super) reports_failures: bool,
    /// Number of reported scenarios and files that could not be read.
    pub(super) failed: usize,
}

impl<'a> Reader<'a> {
    /// Creates a reader of the first `limit` records.
    pub(super) fn new(
        inputs: &'a [Input],
        limit: Option<NonZeroUsize>,
        progress: &'a Progress,
        stop: &'a AtomicBool,
    ) -> Self {
        Self { inputs, limit, progress, stop, reports_failures: true, failed: 0 }
    }

    /// Calls `visit` on the first readable scenarios, at most `most`, and returns their number.
    pub(super) fn each(&mut self, most: usize, mut visit: impl FnMut(&Scenario)) -> usize {
        let most = most.min(self.limit.map_or(usize::MAX, NonZeroUsize::get));
        let mut visited = 0;
        for input in self.inputs {
            let scenarios = match input.open() {
                Ok(scenarios) => scenarios,
                Err(error) => {
                    self.fail(&error.to_string());
                    continue;
                }
            };
            for scenario in scenarios {
                if visited >= most || self.stop.load(Ordering::Relaxed) {
                    return visited;
                }
                match scenario {
                    Ok(scenario) => {
                        visit(&scenario);
                        visited += 1;
                        self.progress.scenario_done(visited);
                    }
                    Err(error) => self.fail(&error.to_string()),
                }
            }
        }
        visited
    }

    /// Warns of what could not be read, and says that the `others` were used; returns the status of the
    /// command.
    pub(super) fn status(&self, others: &str) -> ExitStatus {
        if self.failed == 0 {
            return ExitStatus::Done;
        }
        say(format_args!("warning: {} failed; {others}", count(self.failed, "scenario")));
        ExitStatus::SomeFailed
    }

    fn fail(&mut self, error: &str) {
        if self.reports_failures {
            self.progress.failed(error);
            self.failed += 1;
        }
    }
}
