//! Errors of runs that are divided into units.

use std::io;
use std::path::PathBuf;

use crate::evaluation::EvaluationError;

/// The reason why units cannot be planned, carried out or merged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ShardError {
    /// A file of the run cannot be read or written.
    #[error(transparent)]
    Evaluation(#[from] EvaluationError),
    /// Batches of an external simulator would be divided.
    #[error(
        "units of {records} records divide the batches of `{simulator}`, which have {batch} episodes: give \
         --unit a multiple of {batch}"
    )]
    DividedBatch {
        /// Id of the simulator.
        simulator: String,
        /// Number of episodes per batch.
        batch: usize,
        /// Number of records per unit.
        records: usize,
    },
    /// A file has fewer records than planned.
    #[error("{name} gave {found} of {planned} records; it was changed or cannot be read to the end here")]
    FewRecords {
        /// Name of the file.
        name: String,
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
    /// The arguments of the plan lead to another run now.
    #[error(
        "it would not be of the planned run: `{setting}` is {planned} in the plan and {now} here; use the \
         same program, files and kind of processor, or plan again"
    )]
    OtherRun {
        /// The setting.
        setting: String,
        /// Its value in the plan.
        planned: String,
        /// Its value in this process.
        now: String,
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
        /// The run folder.
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

/// Returns the first few numbers as text.
fn first(numbers: &[usize]) -> String {
    let shown: Vec<String> = numbers.iter().take(5).map(usize::to_string).collect();
    shown.join(", ")
}
