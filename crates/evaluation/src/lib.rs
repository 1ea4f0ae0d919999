//! Evaluation: plans, the runner, run folders and statistics.
//!
//! This module knows simulators, metrics and scenario files, not how results are displayed. It opens files
//! because run folders are part of a run.
//!
//! A run folder contains
//!
//! - `provenance.json`: program, settings, inputs with their digests, simulators; equal for a resumed run
//! - `rows.jsonl`: one row per scenario, simulator and rollout (metrics with their components, outcomes,
//!   digest); after the rollouts of a pair one row without a rollout, for the metrics over all of them
//! - `events.jsonl`: every counted event with scenario, simulator, rollout, agents, steps and values
//! - `failures.jsonl`: scenarios and files without a result, with the error
//! - `summary.json`, `summary.md`: the result, written last
//! - `rollouts.parquet`: the rollouts, if requested; in `parts/` during the run
//!
//! A study consists of several run folders in a folder with a `study.json` ([`Study`]).
//!
//! Rows and events are appended as they are produced, events first. When a run is resumed, pairs of scenario
//! and simulator with incomplete rows are dropped and run again. At the end both files are sorted by inputs,
//! simulators and rollouts, so that no byte depends on threads, batches or interruptions.

mod finished_run;
mod access;
mod av;
mod av_scores;
mod benchmarks;
mod case_study;
mod comparison;
mod conditions;
pub mod document;
mod driver;
mod error;
mod file_record;
mod finish;
mod folder;
mod foreign_rollout;
mod in_memory;
mod judge;
mod known_deviation;
mod leaves;
mod left_out;
mod long_tables;
mod merge;
mod mix;
mod motion;
pub mod paper;
mod plan;
mod pose;
mod provenance;
pub mod realism;
mod recorded;
pub mod reference;
mod rollouts;
mod row;
mod runner;
mod rollout_checks;
mod samples;
mod scoring;
mod selection;
mod scenario_files;
mod shipped;
mod simulator_id;
mod simulators;
mod source;
mod spec;
mod statistics;
mod study;
mod summary;
mod summary_builder;
mod tally;

pub use access::{Access, Mark, Standing};
pub use av::{AV_CHOICES, AvChoice, AvDriver, ParseAvError, PlannedAv};
pub use av_scores::ROUTE_ENDS;
pub use benchmarks::{BenchmarkRecord, KnownBenchmark, known_benchmarks, shipped_benchmark};
pub use case_study::{CASE_STUDIES, CaseStudy};
pub use comparison::{Comparison, PairedDifference};
pub use conditions::{Condition, ConditionDifference, changed_options};
pub use driver::Driver;
pub use error::EvaluationError;
pub use file_record::{CompanionRecord, FileRecord, Registrar};
pub use finished_run::FinishedRun;
pub use folder::{
    EVENTS, EVENTS_TABLE, FAILURES, PROVENANCE, ROLLOUTS, ROWS, ROWS_TABLE, RUN_FILES, RunFolder, SUMMARY,
    TABLE, VALUES_TABLE, read_provenance, read_rows, read_summary, read_tally,
};
pub use foreign_rollout::ForeignRollout;
pub use in_memory::{judge_in_memory, score_in_memory};
pub use known_deviation::KnownDeviation;
pub use leaves::differences;
pub use merge::{merge, unite};
pub use plan::{Deviations, NoAv, Plan, RunSettings};
pub use pose::{AxleDistance, ParsePoseError, Pose};
pub use provenance::{
    ExternalRecord, Provenance, SettingsRecord, SimulatorRecord, WeightsRecord, program_commit,
    program_version, set_program_commit,
};
pub use rollout_checks::{Findings, RolloutCheck};
pub use rollouts::recorded_tracks;
pub use row::{EventLine, EventRecord, Failure, RecordPosition, Row, RowNote, Value};
pub use runner::{Execution, Outcome, RunObserver, run};
pub use scenario_files::ScenarioFiles;
pub use scoring::Scoring;
pub use selection::Selection;
pub use shipped::shipped_ids;
pub use simulators::{Adjustments, PlannedSimulator, weights_file};
pub use source::Source;
pub use spec::{
    ExternalPrograms, ExternalSpec, MotionSpec, NamesScenarios, NuplanSpec, Opening, ReadingSpec,
    RolloutSpec, RunParts, RunSpec, ScenarioSpec, SelectionSpec, Specification, Stage, SubjectSpec, Time,
    weights,
};
pub use statistics::Estimate;
pub use study::{
    Agreement, Difference, ErrorGroup, LOG_ERRORS, LogErrors, Member, OrderChange, PLANNER_RANKS,
    PlannerRanks, STUDY, STUDY_TABLE, SimulatorErrors, SimulatorRanks, Study, StudyFolder, StudyKind,
    StudyPlan, StudyResults, is_study, read_study,
};
pub use summary::{
    CategorySummary, NoteSummary, PAIRING_REFERENCE, Pressure, SimulatorSummary, Summary, SummaryProvenance,
};
pub use tally::{Cell, Entry, Tally};
