//! Settings of an external simulator.

use std::time::Duration;

use super::ExternalError;
use super::pipe::Parent;

/// Largest number of episodes per batch.
pub(super) const MOST_PER_BATCH: usize = 1024;

/// Number of episodes per batch if neither the settings nor the simulator choose one.
pub(super) const DEFAULT_BATCH: usize = 16;

/// Text that stands for the parent process, which is connected by our own standard input and output.
pub const STDIO: &str = "@stdio";

/// Connection to an external simulator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Command {
    /// A command line for `sh`, started once per worker.
    Shell(String),
    /// The parent process, which has the simulator.
    Parent(Parent),
}

impl Command {
    /// Returns the text used on the command line and in provenance.
    pub fn text(&self) -> &str {
        match self {
            Self::Shell(line) => line,
            Self::Parent(_) => STDIO,
        }
    }

    /// Returns whether the parent process has the simulator, so that it cannot be started again.
    pub const fn is_parent(&self) -> bool {
        matches!(self, Self::Parent(_))
    }
}

/// Limits of the time in which a simulator must answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeLimits {
    /// From the start of the process to `welcome`.
    pub start: Duration,
    /// Beginning and first plan of a process, which often load and compile.
    pub first: Duration,
    /// Every other answer.
    pub plan: Duration,
}

impl TimeLimits {
    /// Returns the limits of a connection unless others are stated. The parent process has none: it may be
    /// stopped in a debugger.
    pub fn of(command: &Command) -> Self {
        if command.is_parent() { Self::none() } else { Self::default() }
    }

    /// Returns limits so long that nothing exceeds them.
    pub const fn none() -> Self {
        let year = Duration::from_secs(365 * 24 * 3600);
        Self { start: year, first: year, plan: year }
    }
}

impl Default for TimeLimits {
    fn default() -> Self {
        let seconds = Duration::from_secs;
        Self { start: seconds(300), first: seconds(300), plan: seconds(60) }
    }
}

/// Settings of an external simulator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExternalSettings {
    /// Name in tables and files: letters, digits, `-`, `_`, `.` and `@`.
    pub name: String,
    /// Connection to the simulator.
    pub command: Command,
    /// Number of processes, or of batches that the parent process has open at the same time. Results do not
    /// depend on it.
    pub workers: usize,
    /// Number of episodes per batch; `None` for the number that the simulator asks for.
    pub batch: Option<usize>,
    /// Time limits.
    pub limits: TimeLimits,
    /// Whether it receives the ids of scenarios and agents and the world coordinates of the origin.
    pub reveal_ids: bool,
}

impl ExternalSettings {
    /// Creates settings with the defaults.
    pub fn new(name: impl Into<String>, command: Command) -> Self {
        Self {
            name: name.into(),
            command,
            workers: 1,
            batch: None,
            limits: TimeLimits::default(),
            reveal_ids: false,
        }
    }

    /// Checks name, number of workers and batch.
    pub(super) fn check(&self) -> Result<(), ExternalError> {
        let refuse =
            |reason: String| Err(ExternalError(format!("external program `{}`: {reason}", self.name)));
        let is_allowed = |c: char| c.is_ascii_alphanumeric() || "-_.@".contains(c);
        if self.name.is_empty() || self.name.len() > 64 || !self.name.chars().all(is_allowed) {
            return refuse("a name has 1 to 64 letters, digits, `-`, `_`, `.` or `@`".to_owned());
        }
        if matches!(&self.command, Command::Shell(line) if line.trim().is_empty()) {
            return refuse("the command is empty: write NAME='COMMAND'".to_owned());
        }
        if !self.command.is_parent() && !(1..=256).contains(&self.workers) {
            return refuse(format!("{} workers: 1 to 256 are possible", self.workers));
        }
        match self.batch {
            Some(batch) if !(1..=MOST_PER_BATCH).contains(&batch) => {
                refuse(format!("batches of {batch}: 1 to {MOST_PER_BATCH} episodes are possible"))
            }
            _ => Ok(()),
        }
    }
}

/// The settings of a run that a simulator is told at its start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunOutline {
    /// Replan intervals, steps.
    pub intervals: Vec<usize>,
    /// Names of the evaluation protocols: `reactive`, `realism`.
    pub protocols: Vec<&'static str>,
}
