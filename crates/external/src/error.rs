//! Reasons why an external simulator or planner cannot be used.

/// Error in starting or using an external simulator or planner.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ExternalError {
    /// A setting is wrong.
    #[error("external program `{name}`: {reason}")]
    Setting {
        /// Name of the simulator or planner.
        name: String,
        /// The setting, and what it may be.
        reason: String,
    },
    /// Its process does not start or does not greet.
    #[error("external program `{name}` did not start: {reason}")]
    Start {
        /// Name of the simulator or planner.
        name: String,
        /// Reason, with the last lines of its standard error.
        reason: String,
    },
    /// It does not support the settings of the run.
    #[error(
        "external program `{name}` plans every {supported} steps, this run every {asked}: \
         give `replan` {hint}steps"
    )]
    Interval {
        /// Name of the simulator or planner.
        name: String,
        /// Supported intervals, steps.
        supported: String,
        /// Interval of the run, steps.
        asked: usize,
        /// A supported interval, steps.
        hint: usize,
    },
}
