//! Provenance of results: program, settings, inputs, models.

pub(crate) mod leaves;
pub(crate) mod conditions;

use std::collections::BTreeMap;
use std::sync::OnceLock;

use reactsim_formats::Partition;
use reactsim_metrics::{METRICS, Options};
use reactsim_rollout::Entering;
use serde::{Deserialize, Deserializer, Serialize};

use crate::av::PLANNER;
use crate::deviation::pose::Pose;
use crate::metric_record::{MetricRecord, checked};
use crate::provenance::leaves::differences;
use crate::simulators::record::SimulatorRecord;
use crate::source::benchmarks::BenchmarkRecord;
use crate::source::file_record::FileRecord;
use crate::source::selection::Selection;
use crate::statistics::tally::Tally;

/// Everything that determines the numbers of a run: program, settings, inputs, simulators with their
/// parameters and weights, and for networks the backend and the class of the processor.
///
/// Two runs with equal provenance have equal results if their commit is known and has no `+`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Version of the program.
    pub version: String,
    /// Commit from which the program was built, `unknown` outside a checkout; ends with `+` if files were
    /// changed since.
    pub commit: String,
    /// Settings of the run.
    pub settings: SettingsRecord,
    /// Variants of the metrics. Options that a file lacks are newer than the file; their defaults are the
    /// metrics before them. Options that only earlier versions have are left out at the value that the
    /// metrics now have.
    #[serde(deserialize_with = "present_options")]
    pub metric_options: BTreeMap<String, String>,
    /// Metrics that the benchmark does not have, of the program that made the run or added later.
    #[serde(default, skip_serializing_if = "Vec::is_empty", deserialize_with = "checked")]
    pub own_metrics: Vec<MetricRecord>,
    /// Simulators in the order of the tables.
    pub simulators: Vec<SimulatorRecord>,
    /// The driver of the AV, if it is a simulator, a network or an external program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driver: Option<SimulatorRecord>,
    /// Scenario files in the order of reading.
    pub inputs: Vec<FileRecord>,
    /// The file of deviated AVs, if given.
    pub deviations: Option<FileRecord>,
    /// The known benchmark of the inputs; `None` for other inputs, for a part of a benchmark (`--limit`,
    /// `--id`, `--category`), and with a file of deviations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub benchmark: Option<BenchmarkRecord>,
    /// Name of the tensor backend, such as `flex`; `None` if no simulator has a network.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub backend: Option<String>,
    /// Class of the processor, such as `x86_64-v3` ([`cpu_class`](reactsim_nn::cpu_class)); `None` if
    /// no simulator has a network.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu: Option<String>,
    /// Whether rollouts are kept; omitted from the summary, which does not depend on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub keep_rollouts: Option<bool>,
    /// The partition of the run, if it is not a whole one. Records of files that it does not read lack size
    /// and digest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub partition: Option<Partition>,
}

/// Beginning of the paths of the settings of a run.
const SETTINGS: &str = "settings.";
/// Protocol of scored rollouts of other programs.
const RECORDED: &str = "recorded";

/// The settings of a run, as stored in files.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SettingsRecord {
    /// `reactive` or `realism`; `recorded` for scored rollouts of other programs.
    pub protocol: String,
    /// AV policy; `simulator` in the realism protocol.
    pub av: String,
    /// Number of steps between two plans.
    pub replan_steps: usize,
    /// Whether agents at t+1 observe the AV at t+1.
    pub av_lookahead: bool,
    /// `log` if agents of the log that appear after the current frame enter; absent if none do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub entering: Option<String>,
    /// Seed of all random streams.
    pub seed: u64,
    /// Number of rollouts per scenario and simulator.
    pub rollouts: u32,
    /// Maximum number of scenarios, in earlier versions of every file; absent if unlimited.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<usize>,
    /// The point of vehicles whose poses were given, if not the box centre: `rear-axle`, with its distance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<String>,
    /// Scenarios that were selected; absent if all.
    #[serde(default, skip_serializing_if = "Selection::is_all")]
    pub selection: Selection,
}

impl SettingsRecord {
    /// Returns the settings of recorded rollouts, of which only their number is known.
    pub fn recorded(rollouts: u32) -> Self {
        Self { protocol: RECORDED.to_owned(), av: RECORDED.to_owned(), rollouts, ..Self::default() }
    }

    /// Returns the planner that drives the AV, with its settings, such as `idm,tracker=perfect`; it is judged
    /// by the metrics of the AV. `None` if no planner does.
    pub fn planner(&self) -> Option<&str> {
        self.av.strip_prefix(PLANNER)
    }

    /// Returns the record of agents that enter; `None` if none do.
    pub(super) fn entering(entering: Entering) -> Option<String> {
        (entering != Entering::Off).then(|| entering.to_string())
    }

    /// Returns the record of a pose; `None` for box centres.
    pub(super) fn pose(pose: Pose) -> Option<String> {
        (pose != Pose::Centre).then(|| pose.to_string())
    }
}

/// Returns the version of this program.
pub fn program_version() -> &'static str {
    env!("CARGO_PKG_VERSION")
}

/// The commit from which the program was built. The crate of the program sets it: only a change there
/// compiles anew after every edit.
static COMMIT: OnceLock<&'static str> = OnceLock::new();

/// Sets the commit from which this program was built; later calls change nothing.
pub fn set_program_commit(commit: &'static str) {
    COMMIT.get_or_init(|| commit);
}

/// Returns the commit from which this program was built, or `unknown`.
pub fn program_commit() -> &'static str {
    COMMIT.get().copied().unwrap_or("unknown")
}

impl Provenance {
    /// Returns an empty tally for the values of this run.
    pub fn tally(&self) -> Tally {
        let own = self.own_metrics.iter().map(MetricRecord::spec);
        Tally {
            metrics: METRICS.iter().map(|metric| metric.spec()).chain(own).collect(),
            simulators: self.simulators.iter().map(|s| s.id.clone()).collect(),
            rollouts: self.settings.rollouts,
            entries: BTreeMap::new(),
        }
    }

    /// Returns the first setting in which two runs differ, with its value in each. Settings of the command
    /// come before what follows from them: a limit leaves out inputs, for example.
    pub fn difference(&self, other: &Self) -> Option<(String, String, String)> {
        let mut all = differences(self, other);
        all.sort_by_key(|(name, ..)| !name.starts_with(SETTINGS));
        let (name, mine, theirs) = all.into_iter().next()?;
        Some((name.trim_start_matches(SETTINGS).to_owned(), mine, theirs))
    }

    /// Returns whether the rollouts are recordings of other programs, about whose settings little is known.
    pub fn is_recorded(&self) -> bool {
        self.settings.protocol == RECORDED
    }

    /// Returns whether the program was built from a known commit without changes.
    pub(crate) fn is_clean(&self) -> bool {
        self.commit != "unknown" && !self.commit.ends_with('+')
    }
}

/// Returns variants of the metrics by name, as [`Provenance::metric_options`].
pub(super) fn named_options(options: &Options) -> BTreeMap<String, String> {
    options.named().into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// Reads variants of the metrics, with the defaults of those that the file lacks, and without those of
/// earlier versions that change nothing.
fn present_options<'de, D: Deserializer<'de>>(file: D) -> Result<BTreeMap<String, String>, D::Error> {
    let mut options = named_options(&Options::default());
    options.extend(BTreeMap::<String, String>::deserialize(file)?);
    options.retain(|name, value| !Options::is_obsolete(name, value));
    Ok(options)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_that_are_newer_than_a_file_have_their_defaults() {
        let file = serde_json::json!({ "fault_order": "nuplan", "gone": "1", "av_navsim": "false" });
        let read = present_options(file).unwrap();
        assert_eq!((read["fault_order"].as_str(), read["gone"].as_str()), ("nuplan", "1"));
        assert!(!read.contains_key("av_navsim"));
        let changed = present_options(serde_json::json!({ "av_navsim": "true" })).unwrap();
        assert_eq!(changed["av_navsim"], "true");
        for (name, value) in Options::default().named().into_iter().filter(|(name, _)| *name != "fault_order")
        {
            assert_eq!(read[name], value, "{name}");
        }
    }
}
