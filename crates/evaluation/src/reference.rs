//! References: results with which later runs must agree.
//!
//! A reference is a folder that `reactsim reference make` writes from a finished run.
//!
//! - `reference.toml`: name, benchmark, commands, machine, digests of the other files, class of each
//!   simulator ([`ReferenceRecord`])
//! - `provenance.json`, `summary.json`: those of the run
//! - `rows.parquet`: all rows of the run, without loss; absent for sets of real recordings, of which only
//!   aggregates may be published
//!
//! The reference of a study contains `study.json` and such a folder per member ([`StudyReference`]).
//!
//! [`Reference::open`] refuses a folder with inconsistent files. [`verify`] repeats the run of a reference
//! and compares.

mod classes;
mod entry;
mod error;
mod files;
mod make;
mod part;
mod plan;
mod reading;
mod record;
mod rescore;
mod study;
mod verify;

pub use classes::SimulatorClass;
pub use entry::{Entry, Status};
pub use error::ReferenceError;
pub use make::{MakeOptions, make};
pub use part::Part;
pub use plan::RerunInputs;
pub use reading::{Reference, check_values};
pub use record::{MachineRecord, ReferenceRecord};
pub use rescore::rescore;
pub use study::{StudyReference, make_study};
pub use verify::{Difference, LargestDifference, SimulatorCheck, Subject, Verification, verify};
