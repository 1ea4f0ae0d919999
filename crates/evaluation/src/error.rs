//! Errors that prevent or abort a run.

use std::io;
use std::path::{Path, PathBuf};

use reactsim_baseline::{BackendError, ModelError};
use reactsim_external::ExternalError;
use reactsim_formats::FormatError;
use reactsim_metrics::OptionError;
use reactsim_models::diffusion_planner::PlannerPolicyError;

use crate::layout::{PROVENANCE, STUDY, SUMMARY};
use crate::row::RowLength;

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

/// The reason why a run cannot start or finish. A problem with one scenario is a [`crate::row::Failure`] instead.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// The backend of a network does not work on this machine.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// A text of a specification has another form than its key needs.
    #[error("{key} `{text}`: write {expected}")]
    Spec {
        /// The key.
        key: &'static str,
        /// The text.
        text: String,
        /// What is expected.
        expected: String,
    },
    /// The specification in a run folder cannot be read, or not be written.
    #[error("{reason}")]
    DamagedSpec {
        /// The file or path, and what is wrong with it.
        reason: String,
    },
    /// A key of a specification has no effect without another one.
    #[error("{key} has no effect without {other}: give both, or leave {key} out")]
    Needs {
        /// The key.
        key: &'static str,
        /// The other key.
        other: &'static str,
    },
    /// Two keys of a specification state the same.
    #[error("{key} and {other} exclude each other: leave one of them out")]
    Exclude {
        /// A key.
        key: &'static str,
        /// The other key.
        other: &'static str,
    },
    /// An axis of a study is unknown, or one of its values is invalid or repeated.
    #[error("axis {axis}: {reason}")]
    Axis {
        /// The key, or the key and the value.
        axis: String,
        /// The reason.
        reason: String,
    },
    /// A key of a specification has no effect on the shipped scenarios.
    #[error("the shipped scenarios are read as they are: leave {key} out")]
    ShippedAsIs {
        /// The key.
        key: &'static str,
    },
    /// A variant of the metrics is unknown.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// An external simulator or planner cannot be started.
    #[error(transparent)]
    External(#[from] ExternalError),
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
    /// Rows of a finished partition are missing.
    #[error("{}: rows.jsonl has fewer scenarios than {SUMMARY}; run the partition again", path.display())]
    LostRows {
        /// The run folder.
        path: PathBuf,
    },
    /// Rollouts in memory do not match their scenario.
    #[error("scenario `{scenario}`: {error}")]
    UnfitRollouts {
        /// Id of the scenario.
        scenario: String,
        /// The reason.
        error: String,
    },
    /// Recorded rollouts fail checks.
    #[error("the rollouts do not show what the scenarios ask for:{findings}")]
    RolloutsRefused {
        /// One line per check.
        findings: String,
    },
    /// The motion of an external simulator or of a file of deviations fails a check.
    #[error(
        "stopped: the motion of {subject} cannot be judged as it is. Scenario `{scenario}`: {findings}. \
         Finished rows are kept: mend it and run again in a new folder, or continue with `allow` {allow}, \
         which marks its rows in every table"
    )]
    Motion {
        /// The simulator, or the file of deviations.
        subject: String,
        /// Id of the first scenario.
        scenario: String,
        /// Likely mistake, and its mend.
        findings: String,
        /// Names of what would allow it, separated by commas.
        allow: String,
    },
    /// An external simulator failed too often in a row.
    #[error(
        "stopped: `{simulator}` was given up: {reason}\nfinished rows are kept: mend it, and continue \
         the run"
    )]
    GivenUp {
        /// Id of the simulator.
        simulator: String,
        /// The reason.
        reason: String,
    },
    /// A pose is chosen, but no trajectories are given.
    #[error("`pose` is the point of the AV whose poses a file of deviations has: give `deviations`")]
    PoseUnused,
    /// The batches of external simulators have no common size.
    #[error(
        "external simulators with batches of {batches:?} episodes: their least common multiple exceeds \
         {most}; give `external-batch`"
    )]
    UnevenBatches {
        /// Sizes of the batches.
        batches: Vec<usize>,
        /// Largest possible common multiple.
        most: usize,
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
    /// A run folder is not finished.
    #[error("{path} holds no finished run")]
    Unfinished {
        /// The folder.
        path: PathBuf,
    },
    /// A folder is not a run folder.
    #[error("{path} is not a run folder: it has no provenance.json")]
    NoRun {
        /// The folder.
        path: PathBuf,
    },
    /// A folder is not the folder of a study.
    #[error("{path} is not a study: it has no study.json")]
    NoStudy {
        /// The folder.
        path: PathBuf,
    },
    /// Members of a study are not finished.
    #[error("the study in {path} is not finished ({members})")]
    UnfinishedStudy {
        /// The folder.
        path: PathBuf,
        /// Names of the members.
        members: String,
    },
    /// The run folder exists and is not empty.
    #[error("{path} exists and is not empty: continue the run in it, or choose another folder")]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// The run folder holds a run with other settings.
    #[error(
        "cannot resume {path}: `{setting}` is {old} there and {new} now; \
         give the same settings or another folder"
    )]
    OtherSettings {
        /// The folder.
        path: PathBuf,
        /// Name of the setting.
        setting: String,
        /// Its value in the folder.
        old: String,
        /// Its value now.
        new: String,
    },
    /// A folder has a partition of another run than the folder that it is to be joined with.
    #[error(
        "{path} cannot be merged with {first}: `{setting}` is {new} in the former and {old} in the latter; run \
         all partitions with the same program, settings and files, on the same kind of processor"
    )]
    OtherPartition {
        /// The folder.
        path: PathBuf,
        /// The first of the folders.
        first: PathBuf,
        /// Name of the setting.
        setting: String,
        /// Its value in the first folder.
        old: String,
        /// Its value in this folder.
        new: String,
    },
    /// A reference has no rows.
    #[error("{path} holds aggregates only: rows of its scenarios are not published")]
    AggregatesOnly {
        /// The folder.
        path: PathBuf,
    },
    /// A reference has no events and no rollouts.
    #[error("{path} is a reference, which has no events: use the folder of its run for pages")]
    NoEvents {
        /// The folder.
        path: PathBuf,
    },
    /// A run kept no rollouts.
    #[error("{path} has no rollouts: run again with `keep-rollouts`")]
    NoRollouts {
        /// The folder.
        path: PathBuf,
    },
    /// One simulator of a run is needed.
    #[error(
        "{path} has the simulators {}{}: choose one",
        .ids.join(", "),
        .asked.as_ref().map_or_else(String::new, |id| format!(", not `{id}`"))
    )]
    WhichSimulator {
        /// The folder.
        path: PathBuf,
        /// The simulator that was asked for.
        asked: Option<String>,
        /// Those of the run.
        ids: Vec<String>,
    },
    /// A run with other current frames is compared with recordings.
    #[error(
        "{path} was run with `current-frame`, `window-step`, `history` or `future`, and recordings are \
         scored at the current frame that they state, with 80 steps: run without these keys"
    )]
    OtherCurrentFrames {
        /// The folder.
        path: PathBuf,
    },
    /// Another run is writing to the folder.
    #[error("another run is writing to {path}")]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// There is no such simulator.
    #[error("there is no simulator `{id}`; there are: {known}")]
    UnknownSimulator {
        /// The id.
        id: String,
        /// Ids of all simulators.
        known: String,
    },
    /// The label of a variant is not a name.
    #[error("`{id}`: the label after `@` has letters, digits, `-` and `_`, as in ntp-reactive@mine")]
    WrongLabel {
        /// The id.
        id: String,
    },
    /// The id of a mix is invalid.
    #[error("`{id}`: {reason}")]
    Mix {
        /// The id.
        id: String,
        /// Reason, with the part.
        reason: String,
    },
    /// There is no baseline of the name of a member of a mix.
    #[error("`{mix}`: there is no baseline `{id}`, and members of a mix are baselines; there are: {known}")]
    UnknownMember {
        /// Id of the mix.
        mix: String,
        /// Id of the member.
        id: String,
        /// Ids of all baselines.
        known: String,
    },
    /// There is nothing to roll out.
    #[error("0 rollouts: at least 1 is needed")]
    ZeroRollouts,
    /// An AV policy was chosen in the realism protocol.
    #[error("the simulator moves the AV in the realism protocol: leave `av` out")]
    AvInRealism,
    /// Two files of deviations were given.
    #[error("give either `deviations` or `av` file:<path>")]
    DeviationsTwice,
    /// A file of deviations was given, and an AV policy that does not use it.
    #[error("`deviations` goes with `av` deviated or deviated-or-log only")]
    DeviationsUnused,
    /// No AV policy was chosen, and the scenarios have no deviated AV.
    #[error(
        "the scenarios have no deviated AV: give `deviations`, or choose a driver with `av`: {AV_CHOICES}"
    )]
    NoDeviatedAv,
    /// A simulator is named twice.
    #[error("the simulator `{id}` is named twice")]
    RepeatedSimulator {
        /// The id.
        id: String,
    },
    /// The AV policy names a planner that is not given.
    #[error(
        "the AV policy names the planner `{name}`, which is not given: define it with `planner` NAME=COMMAND"
    )]
    NoDriver {
        /// Its name in the AV policy.
        name: String,
    },
    /// The program has no weights of the diffusion planner.
    #[error("no weights of `diffusion-planner` ship with this program: build it with the feature `weights`")]
    NoDriverWeights,
    /// The weights of the diffusion planner cannot be used.
    #[error(transparent)]
    DriverWeights(#[from] PlannerPolicyError),
    /// Several simulators cannot drive one AV.
    #[error("`{id}` names several simulators, and one drives the AV: choose one")]
    SeveralDrivers {
        /// The name.
        id: String,
    },
    /// A simulator that observes the logged future cannot drive the AV.
    #[error(
        "`{id}` observes the logged future and cannot drive the AV: choose another simulator, or planner:log"
    )]
    OracleDriver {
        /// Id of the simulator.
        id: String,
    },
    /// Weights or a parameter are for a simulator that does not run.
    #[error(
        "weights or parameters are given for the simulator `{id}`, which does not run: \
         name it in `models` too"
    )]
    NotRun {
        /// The id.
        id: String,
    },
    /// There are two weights files for one simulator.
    #[error("the simulator `{id}` is given weights twice")]
    WeightsTwice {
        /// The id.
        id: String,
    },
    /// There are two values for one parameter.
    #[error("the parameter `{key}` of `{id}` is set twice")]
    ParameterTwice {
        /// The id.
        id: String,
        /// Dotted path of the parameter.
        key: String,
    },
    /// A run has no such simulator.
    #[error("the run has no simulator `{id}`; it has: {known}")]
    NotInRun {
        /// The id.
        id: String,
        /// Ids of its simulators.
        known: String,
    },
    /// One id names different scenarios in two runs.
    #[error(
        "the scenario `{id}` is not the same in both runs: only runs on the same scenarios can be compared"
    )]
    OtherScenario {
        /// The id.
        id: String,
    },
    /// An id names scenarios of different length in the two runs.
    #[error(
        "the scenario `{id}` has {} frames of history and {} steps in the first run, and {} and {} in the \
         second: only runs on scenarios of the same length can be compared",
        first.history, first.steps, second.history, second.steps
    )]
    OtherLength {
        /// The id.
        id: String,
        /// Its length in the first run.
        first: RowLength,
        /// Its length in the second run.
        second: RowLength,
    },
    /// Two runs have no scenario in common.
    #[error("the runs have no scenario in common for which both have a result")]
    NothingInCommon,
    /// A kept rollout does not match its scenario.
    #[error("{path}: the rollout of scenario `{scenario}` does not match it: {source}; make the run again")]
    ForeignRollout {
        /// The file.
        path: PathBuf,
        /// Id of the scenario.
        scenario: String,
        /// Underlying error.
        source: Box<ForeignRollout>,
    },
    /// A record of a scenario file is not the scenario that a run read there.
    #[error(
        "{file}: record {record} is not the scenario with the digest {digest} that the run found there; \
         was it read by another version of the program?"
    )]
    NotThatScenario {
        /// Name of the file.
        file: String,
        /// Index of the record.
        record: usize,
        /// Digest of the scenario that was expected.
        digest: String,
    },
    /// Metrics cannot be added to a run.
    #[error("{}: {reason}", path.display())]
    AddedMetrics {
        /// The file of the metrics.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// A simulator cannot be created.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A file of scenarios, deviations or rollouts cannot be used.
    #[error("{0}")]
    Format(#[from] FormatError),
    /// Rollouts that are not yet joined were changed after they were written.
    #[error("{error}; delete the file, and continue the run")]
    DamagedPart {
        /// The damage.
        error: FormatError,
    },
}

impl EvaluationError {
    /// Refuses a text of a specification.
    pub(crate) fn spec(key: &'static str, text: &str, expected: impl Into<String>) -> Self {
        Self::Spec { key, text: text.to_owned(), expected: expected.into() }
    }
}

/// The reason why a recorded rollout does not match a scenario.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ForeignRollout {
    /// An agent is not in the scenario.
    #[error("agent `{0}` is not in the scenario")]
    Unknown(String),
    /// An agent occurs twice.
    #[error("agent `{0}` occurs twice")]
    Twice(String),
    /// A state is beyond the limits of scenarios.
    #[error("agent `{agent}`: `{name}` at step {step} is {value}, expected {expected}")]
    Beyond {
        /// Id of the agent.
        agent: String,
        /// Name of the value.
        name: &'static str,
        /// Step, from 1.
        step: usize,
        /// The value, in the frame of the scenario.
        value: String,
        /// The expected value.
        expected: &'static str,
    },
    /// An agent has another number of steps than the scenario.
    #[error("agent `{agent}` has {found} steps, expected the {expected} of the scenario")]
    Steps {
        /// Id of the agent.
        agent: String,
        /// Steps found.
        found: usize,
        /// Steps of the scenario.
        expected: usize,
    },
    /// The AV is missing.
    #[error("the AV `{0}` is missing")]
    NoAv(String),
}
