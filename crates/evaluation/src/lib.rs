//! Evaluation: plans, the runner, run folders and statistics.
//!
//! This module knows simulators, metrics and scenario files, not how results are displayed. It opens files
//! because run folders are part of a run.
//!
//! A run folder contains
//!
//! - `provenance.json`: program, settings, inputs with their digests, simulators; equal for a resumed run
//! - `spec.toml`: the specification, with which the run can be repeated
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

mod av;
mod driver;
mod error;
mod folder;
mod deviation;
mod judge;
mod layout;
mod metric_record;
mod motion;
mod own_metrics;
pub mod paper;
mod plan;
mod provenance;
pub mod realism;
pub mod reference;
mod row;
mod runner;
mod scoring;
mod simulators;
mod source;
mod spec;
mod statistics;
mod study;
pub mod suggestion;
mod summary;

pub use av::{AvChoice, AvDriver, ParseAvError, PlannedAv};
pub use deviation::labels::DeviationLabels;
pub use deviation::pose::{AxleDistance, Pose};
pub use driver::Driver;
pub use error::{AV_CHOICES, EvaluationError};
pub use folder::finished_run::FinishedRun;
pub use folder::rollouts::{entered_in, recorded_tracks};
pub use folder::{RunFolder, read_provenance, read_rows, read_summary, read_tally};
pub use judge::av_scores::ROUTE_ENDS;
pub use layout::{
    EVENTS, EVENTS_TABLE, FAILURES, PROVENANCE, ROLLOUTS, ROWS, ROWS_TABLE, RUN_FILES, SPEC, STUDY,
    STUDY_TABLE, SUMMARY, TABLE, VALUES_TABLE,
};
pub use metric_record::MetricRecord;
pub use motion::kind::RolloutCheck;
pub use motion::rollout_checks::Findings;
pub use own_metrics::AddedMetrics;
pub use plan::of_spec::{RunParts, are_deviated};
pub use plan::{Deviations, NoAv, Plan};
pub use provenance::conditions::{Condition, ConditionDifference, changed_options};
pub use provenance::leaves::differences;
pub use provenance::{Provenance, SettingsRecord, program_commit, program_version, set_program_commit};
pub use row::{EventLine, EventRecord, Failure, RecordPosition, Row, RowLength, RowNote};
pub use runner::merge::{merge, unite};
pub use runner::{Execution, Outcome, RunObserver, run};
pub use scoring::Scoring;
pub use scoring::document;
pub use scoring::in_memory::{judge_in_memory, score_in_memory};
pub use simulators::access::{Access, Mark, TableMarks};
pub use simulators::record::{ExternalRecord, SimulatorRecord, WeightsRecord};
pub use simulators::{Adjustments, PlannedSimulator, weights_file};
pub use source::benchmarks::{BenchmarkRecord, KnownBenchmark, known_benchmarks, shipped_benchmark};
pub use source::case_study::{CASE_STUDIES, CaseStudy};
pub use source::file_record::{CompanionRecord, FileRecord, Registrar};
pub use source::scenario_files::ScenarioFiles;
pub use source::selection::Selection;
pub use source::shipped::shipped_ids;
pub use source::{Share, Source, limited, limited_shipped};
pub use spec::{
    Axis, AxisValue, ExternalPrograms, ExternalSpec, MotionSpec, NuplanSpec, Opening, ReadingSpec,
    RolloutSpec, RunSpec, ScenarioSpec, SelectionSpec, Specification, Stage, SubjectSpec, Time,
    metric_options, split_metric_option, weights,
};
pub use statistics::Estimate;
pub use statistics::comparison::{Comparison, PairedDifference, Verdict};
pub use statistics::tally::{Cell, Entry, Tally};
pub use study::{
    Agreement, AxisPoint, Dependence, Difference, ErrorGroup, LOG_ERRORS, LogErrors, Member, OrderChange,
    PLANNER_RANKS, PlannerPair, PlannerRanks, SimulatorErrors, SimulatorRanks, Study, StudyFolder, StudyKind,
    StudyPlan, StudyResults, is_study, read_study,
};
pub use summary::{
    CategorySummary, LengthSummary, NoteSummary, PAIRING_REFERENCE, Pressure, SimulatorSummary, Summary,
    SummaryProvenance,
};
