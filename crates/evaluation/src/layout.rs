//! Names of the files in run folders, studies and references.

/// Name of the file with the provenance.
pub const PROVENANCE: &str = "provenance.json";
/// Name of the file with the specification.
pub const SPEC: &str = "spec.toml";
/// Name of the file with one row per scenario, simulator and rollout.
pub const ROWS: &str = "rows.jsonl";
/// Name of the file with the rows in a reference.
pub const ROWS_TABLE: &str = "rows.parquet";
/// Name of the file with the counted events.
pub const EVENTS: &str = "events.jsonl";
/// Name of the file with the failures.
pub const FAILURES: &str = "failures.jsonl";
/// Name of the file with the result.
pub const SUMMARY: &str = "summary.json";
/// Name of the file with the result as a table.
pub const TABLE: &str = "summary.md";
/// Name of the file with the rollouts.
pub const ROLLOUTS: &str = "rollouts.parquet";
/// Name of the table of values, in long form.
pub const VALUES_TABLE: &str = "values.parquet";
/// Name of the table of events.
pub const EVENTS_TABLE: &str = "events.parquet";
/// Name of the file with the scenarios that a partition of a run left out.
pub(crate) const LEFT_OUT: &str = "left_out.json";
/// Names of the files of a run folder.
pub const RUN_FILES: [&str; 12] = [
    PROVENANCE,
    SPEC,
    ROWS,
    ROWS_TABLE,
    VALUES_TABLE,
    EVENTS,
    EVENTS_TABLE,
    FAILURES,
    SUMMARY,
    TABLE,
    ROLLOUTS,
    LEFT_OUT,
];
/// Name of the file that lists the members of a study.
pub const STUDY: &str = "study.json";
/// Name of the file that makes a folder a reference.
pub(crate) const REFERENCE_RECORD: &str = "reference.toml";
/// Name of the file with the table of a study.
pub const STUDY_TABLE: &str = "study.md";
