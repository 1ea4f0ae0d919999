//! Evaluation: what to run, the runner, run folders and statistics.
//!
//! Knows simulators, metrics and files of scenarios; never how results are shown. The only room beside `formats` and `cli`
//! that opens files: a run folder is part of what a run is.
//!
//! A run folder holds
//!
//! | file | what |
//! |---|---|
//! | `provenance.json` | program, settings, inputs with their digests, simulators: what a resumed run must agree with |
//! | `rows.jsonl` | one row per scenario, simulator and rollout: metrics with what they are made of, outcomes, digest; after the rollouts of a pair one row without a rollout, for the metrics over all of them |
//! | `events.jsonl` | every counted event: scenario, simulator, rollout, agents, steps, values |
//! | `failures.jsonl` | scenarios and files without a result, and why |
//! | `summary.json`, `summary.md` | the result, written last |
//! | `rollouts.parquet` | the rollouts, where they were asked for; `parts/` while the run lasts |
//!
//! A study is several run folders below one that holds `study.json` ([`Study`]).
//!
//! Rows and events are appended as they come, events first; a pair whose rows are not whole is dropped and run again when a
//! run is resumed. At the end both files are put into the order of inputs, simulators and rollouts, so that no byte depends
//! on threads, batches or interruptions.

mod archive;
mod av;
mod benchmarks;
mod case_study;
mod comparison;
pub mod document;
mod error;
mod file_record;
mod folder;
mod judge;
mod plan;
mod provenance;
mod recorded;
pub mod reference;
mod rollouts;
mod row;
mod runner;
mod shelf;
mod shipped;
mod simulators;
mod source;
mod statistics;
mod study;
mod summary;
mod tally;

pub use archive::Archive;
pub use av::{AV_CHOICES, AvChoice, ParseAvError};
pub use benchmarks::{BenchmarkRecord, KnownBenchmark, known_benchmarks, shipped_benchmark};
pub use case_study::{CASE_STUDIES, CaseStudy};
pub use comparison::{Comparison, Paired};
pub use error::EvaluationError;
pub use file_record::{CompanionRecord, FileRecord, Registrar};
pub use folder::{
    EVENTS, FAILURES, PROVENANCE, ROLLOUTS, ROWS, ROWS_TABLE, RunFolder, SUMMARY, TABLE, read_provenance,
    read_rows, read_summary, read_tally,
};
pub use plan::{Deviations, KnownDeviation, NoAv, Plan, RunSettings};
pub use provenance::{
    Provenance, SettingsRecord, SimulatorRecord, WeightsRecord, program_commit, program_version,
};
pub use recorded::Recorded;
pub use rollouts::{ForeignRollout, recorded_tracks};
pub use row::{EventLine, EventRecord, Failure, Place, Row, Value};
pub use runner::{Execution, Outcome, RunObserver, run};
pub use shelf::Shelf;
pub use simulators::{Adjustments, PlannedSimulator};
pub use source::{Opener, Source};
pub use statistics::Estimate;
pub use study::{
    Difference, Member, STUDY, STUDY_TABLE, Study, StudyFolder, StudyKind, StudyPlan, StudyResults, is_study,
    read_study,
};
pub use summary::{CategorySummary, Pressure, REFERENCE, SimulatorSummary, Summary, SummaryProvenance};
pub use tally::{Cell, Entry, Tally};
