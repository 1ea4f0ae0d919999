//! Errors that prevent or abort a run.

use std::fmt::Display;
use std::io;
use std::path::{Path, PathBuf};

use reactsim_baseline::{BackendError, ModelError};
use reactsim_external::ExternalError;
use reactsim_formats::FormatError;
use reactsim_metrics::OptionError;
use reactsim_nn::WeightsError;

use crate::layout::{PROVENANCE, STUDY, SUMMARY};

/// The choices, for help and error texts.
pub const AV_CHOICES: &str = "deviated, log, deviated-or-log, constant-velocity, brake:<m/s²>, \
                              retime:<factor>, shift:<m>, file:<path> or planner:<id>";

/// Returns what to do about a damaged file of a run folder or a study.
fn mend(path: &Path) -> &'static str {
    match path.file_name().and_then(|name| name.to_str()) {
        Some(PROVENANCE | STUDY) => "; delete the folder, and run the command again",
        Some(SUMMARY) => "; continuing the run writes it again",
        _ => "",
    }
}

/// The reason why a run cannot start or finish, or its results cannot be used. A problem with one scenario is
/// a [`crate::row::Failure`] instead. Reasons that no program has to tell apart are texts, which name the
/// place, what was found and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// Any other reason.
    #[error("{0}")]
    Refused(String),
    /// The run or study stopped, or is in the folder already, and can be continued.
    #[error("{0}")]
    Resumable(String),
    /// One simulator of a run is needed.
    #[error("{0}")]
    WhichSimulator(String),
    /// There is no such simulator.
    #[error("{text}")]
    UnknownSimulator {
        /// The id.
        id: String,
        /// The reason, with the ids of all simulators.
        text: String,
    },
    /// A folder is not a run folder.
    #[error("{path} is not a run folder: it has no provenance.json")]
    NoRun {
        /// The folder.
        path: PathBuf,
    },
    /// A file cannot be read.
    #[error("could not read {path}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Underlying error.
        source: io::Error,
    },
    /// A file cannot be written.
    #[error("could not write {path}")]
    Write {
        /// The file.
        path: PathBuf,
        /// Underlying error.
        source: io::Error,
    },
    /// A file of a run folder is damaged.
    #[error("{path} cannot be read: {source}{}", mend(path))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Underlying error.
        source: serde_json::Error,
    },
    /// A line of a file is damaged.
    #[error("{} is damaged in line {line}: {source}; repeat the run, or restore the file", path.display())]
    DamagedLine {
        /// The file.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// The parser error.
        source: serde_json::Error,
    },
    /// Rows of a finished run are missing.
    #[error(
        "{}: the rows of scenario `{scenario}` with `{simulator}` are incomplete; repeat the run, or restore \
         the file of rows",
        path.display()
    )]
    IncompleteRows {
        /// The run folder.
        path: PathBuf,
        /// Id of the scenario.
        scenario: String,
        /// Id of the simulator.
        simulator: String,
    },
    /// Two runs have no scenario in common.
    #[error("the runs have no scenario in common for which both have a result{lengths}")]
    NothingInCommon {
        /// The lengths of their scenarios, if they differ; else empty.
        lengths: String,
    },
    /// The backend of a network does not work on this machine.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// A variant of the metrics is unknown.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// An external simulator or planner cannot be started.
    #[error(transparent)]
    External(#[from] ExternalError),
    /// The weights of a planner cannot be used.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// A simulator cannot be created.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A file of scenarios, deviations or rollouts cannot be used.
    #[error("{0}")]
    Format(#[from] FormatError),
}

impl EvaluationError {
    /// Refuses a text of a specification, which has another form than its key needs.
    pub(crate) fn spec(key: &str, text: &str, expected: impl Display) -> Self {
        Self::Refused(format!("{key} `{text}`: write {expected}"))
    }

    /// Refuses a key of a specification that has no effect without another one.
    pub(crate) fn needs(key: &str, other: &str) -> Self {
        Self::Refused(format!("{key} has no effect without {other}: give both, or leave {key} out"))
    }

    /// Refuses weights or parameters for a simulator that does not run.
    pub fn not_run(id: &str) -> Self {
        Self::Refused(format!(
            "weights or parameters are given for the simulator `{id}`, which does not run: \
             name it in `models` too"
        ))
    }

    /// Refuses a simulator that is named twice.
    pub(crate) fn repeated(id: &str) -> Self {
        Self::Refused(format!("the simulator `{id}` is named twice"))
    }

    /// Refuses a folder in which there is no finished run.
    pub(crate) fn unfinished(path: &Path) -> Self {
        Self::Resumable(format!("{} holds no finished run", path.display()))
    }

    /// Refuses a folder to which another run is writing.
    pub fn busy(path: &Path) -> Self {
        Self::Refused(format!("another run is writing to {}", path.display()))
    }

    /// Refuses to continue a run or study with another value of a setting than the old one in its folder.
    pub(crate) fn other_settings(path: &Path, setting: &str, old: &str, new: &str) -> Self {
        Self::Refused(format!(
            "cannot resume {}: `{setting}` is {old} there and {new} now; \
             give the same settings or another folder",
            path.display()
        ))
    }

    /// Refuses a folder with a partition of another run than that in the folder `first`: a setting has
    /// another value there.
    pub fn other_partition(path: &Path, first: &Path, (setting, old, new): (String, String, String)) -> Self {
        Self::Refused(format!(
            "{} cannot be merged with {}: `{setting}` is {new} in the former and {old} in the latter; run \
             all partitions with the same program, settings and files, on the same kind of processor",
            path.display(),
            first.display()
        ))
    }
}
