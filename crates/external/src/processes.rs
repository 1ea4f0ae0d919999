//! The processes of an external simulator or planner, as its user sees them.

use std::io;
use std::sync::Arc;

use super::ExternalError;
use super::replies::{Description, Role};
use super::settings::{Command, ExternalSettings, RunOutline};
use super::stderr::StderrTarget;
use super::workers::Workers;

/// The processes of an external simulator or planner. Clones share them; they end when the last one is
/// dropped.
#[derive(Clone)]
pub struct Processes {
    pub(super) description: Description,
    pub(super) workers: Arc<Workers>,
}

impl Processes {
    /// Starts one process, which states what it is.
    pub(super) fn start(
        settings: ExternalSettings,
        outline: RunOutline,
        role: Role,
    ) -> Result<Self, ExternalError> {
        settings.check()?;
        let workers = Arc::new(Workers::new(settings, outline, role));
        let failed = |reason: String| ExternalError::no_start(&workers.settings.name, &reason);
        let worker = workers.take(true).map_err(failed)?;
        workers.put_back(Some(worker));
        let description = workers.description().ok_or_else(|| failed("it stated nothing".to_owned()))?;
        Ok(Self { description, workers })
    }

    /// Returns the name of the simulator or planner in tables.
    pub fn name(&self) -> &str {
        &self.workers.settings.name
    }

    /// Returns how it is reached.
    pub fn command(&self) -> &Command {
        &self.workers.settings.command
    }

    /// Returns what it states about itself.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Returns whether it receives the ids of scenarios and agents.
    pub fn reveals_ids(&self) -> bool {
        self.workers.settings.reveal_ids
    }

    /// Returns the number of requests that failed and were repeated or given up, and the reason of the first;
    /// `None` if none did.
    pub fn faults(&self) -> Option<(usize, String)> {
        self.workers.faults()
    }

    /// Returns the reason why no further process is started: starts or single episodes that failed in a row.
    pub fn given_up(&self) -> Option<String> {
        self.workers.given_up()
    }

    /// Sends the standard error of the processes to a target, also what they wrote before.
    ///
    /// # Errors
    /// If a file cannot be opened.
    pub fn set_stderr(&self, target: StderrTarget) -> io::Result<()> {
        self.workers.stderr.set_target(target)
    }
}
