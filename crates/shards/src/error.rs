//! Errors of work that is divided into units.

use std::error::Error;
use std::io;
use std::path::{Path, PathBuf};

/// The reason why units cannot be planned, carried out or merged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ShardError {
    /// The work itself is impossible.
    #[error(transparent)]
    Work(Box<dyn Error + Send + Sync>),
    /// A file cannot be read.
    #[error("could not read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: io::Error,
    },
    /// A file cannot be written.
    #[error("could not write {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: io::Error,
    },
    /// An input has fewer records than planned.
    #[error("its file gave {found} of {planned} records; it was changed or cannot be read to the end here")]
    FewRecords {
        /// Number of records.
        found: usize,
        /// Number of records in the plan.
        planned: usize,
    },
    /// There is no plan in a folder, or it cannot be read.
    #[error("{} cannot be read; `reactsim shard plan` writes it", path.display())]
    NoPlan {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: io::Error,
    },
    /// There is a plan in the folder already.
    #[error("{} exists; choose another folder, or remove the plan and its units", path.display())]
    Planned {
        /// The file.
        path: PathBuf,
    },
    /// A plan is damaged or of another version of the program.
    #[error("{} is not a plan of this program: {reason}", path.display())]
    BadPlan {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// The arguments of the plan lead to other work now.
    #[error(
        "it would not be of the planned work: `{setting}` is {planned} in the plan and {now} here; use the \
         same program, files and kind of processor, or plan again"
    )]
    OtherWork {
        /// The setting.
        setting: String,
        /// Its value in the plan.
        planned: String,
        /// Its value in this process.
        now: String,
    },
    /// The plan is of another command than its arguments.
    #[error("the plan is damaged: its subject is not that of its arguments; plan again")]
    OtherSubject {
        /// The reason.
        source: serde_json::Error,
    },
    /// There is no such unit.
    #[error("there is no unit {unit}: the plan has {count}, numbered from 0")]
    NoUnit {
        /// Number of the unit.
        unit: usize,
        /// Number of units.
        count: usize,
    },
    /// The results are merged already.
    #[error("{} has the results of this plan already", path.display())]
    Merged {
        /// The results.
        path: PathBuf,
    },
    /// Units of the plan are not finished.
    #[error(
        "{} of {count} units are not finished, among them {}; `reactsim shard run FOLDER --missing` carries \
         them out",
        missing.len(), first(missing)
    )]
    Missing {
        /// Numbers of the units.
        missing: Vec<usize>,
        /// Number of units of the plan.
        count: usize,
    },
    /// Results of a unit are damaged.
    #[error("{}: {reason}; remove the folder and carry out unit {unit} again", path.display())]
    Damaged {
        /// Folder of the unit.
        path: PathBuf,
        /// Number of the unit.
        unit: usize,
        /// The reason.
        reason: String,
    },
    /// A folder has results of another plan.
    #[error("{} has results of another plan; move it away", path.display())]
    Foreign {
        /// The folder.
        path: PathBuf,
    },
    /// A unit is there twice.
    #[error(
        "unit {unit} is there twice: {} and {}; move one of them away",
        first.display(), second.display()
    )]
    Twice {
        /// Number of the unit.
        unit: usize,
        /// One folder.
        first: PathBuf,
        /// The other folder.
        second: PathBuf,
    },
}

impl ShardError {
    /// Wraps an error of the work itself.
    pub fn work(error: impl Error + Send + Sync + 'static) -> Self {
        Self::Work(Box::new(error))
    }
}

/// Returns the error for a file that cannot be read.
pub(super) fn cannot_read(path: &Path) -> impl FnOnce(io::Error) -> ShardError + use<> {
    let path = path.to_owned();
    |source| ShardError::Read { path, source }
}

/// Returns the error for a file that cannot be written.
pub(super) fn cannot_write(path: &Path) -> impl FnOnce(io::Error) -> ShardError + use<> {
    let path = path.to_owned();
    |source| ShardError::Write { path, source }
}

/// Returns the first few numbers as text.
fn first(numbers: &[usize]) -> String {
    let shown: Vec<String> = numbers.iter().take(5).map(usize::to_string).collect();
    shown.join(", ")
}
