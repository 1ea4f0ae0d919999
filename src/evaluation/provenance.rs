//! Where numbers come from: program, settings, inputs, models.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::benchmarks::BenchmarkRecord;
use super::file_record::FileRecord;
use crate::models::WeightsFile;
use crate::models::nn::{backend, cpu_class};

/// Everything that decides the numbers of a run: program, settings, inputs, simulators with their parameters and weights, and
/// for networks the backend and the class of the processor.
///
/// Two runs with equal provenance have equal results if their commit is known and has no `+`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Version of the program.
    pub version: String,
    /// Commit that the program was built from, `unknown` outside a checkout; `+` where files were changed after it.
    pub commit: String,
    /// What the run was asked to do.
    pub settings: SettingsRecord,
    /// Variants of the metrics.
    pub metric_options: BTreeMap<String, String>,
    /// Simulators in the order of the tables.
    pub simulators: Vec<SimulatorRecord>,
    /// Scenario files in the order of reading.
    pub inputs: Vec<FileRecord>,
    /// The file of deviated AVs, where one was given.
    pub deviations: Option<FileRecord>,
    /// The known benchmark that the inputs are; `None` for other inputs, for a part of a benchmark (`--limit`), and with a file of
    /// deviations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub benchmark: Option<BenchmarkRecord>,
    /// Name of the tensor backend, such as `flex`; `None` where no simulator has a network.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub backend: Option<String>,
    /// Class of the processor, such as `x86_64-v3` ([`cpu_class`]); `None` where no simulator has a network.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu: Option<String>,
    /// Whether rollouts are kept; left out of the result, which does not depend on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub keep_rollouts: Option<bool>,
}

/// The settings of a run, as files hold them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SettingsRecord {
    /// `reactive` or `realism`.
    pub protocol: String,
    /// AV policy; `simulator` in the realism protocol.
    pub av: String,
    /// Steps between two plans.
    pub replan_steps: usize,
    /// Whether agents at t+1 see the AV at t+1.
    pub av_lookahead: bool,
    /// Seed of all random streams.
    pub seed: u64,
    /// Rollouts per scenario and simulator.
    pub rollouts: u32,
    /// How many scenarios of every file were asked for; left out where all were.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<usize>,
}

/// A simulator of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatorRecord {
    /// Id.
    pub id: String,
    /// Name in tables.
    pub title: String,
    /// Whether it is shown the log's future.
    pub oracle: bool,
    /// BLAKE3 digest of its card, which holds its parameters.
    pub card: String,
    /// Parameters that are not as in the card, by dotted path, as TOML writes them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, String>,
    /// Its weights, where it has some.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<WeightsRecord>,
}

impl SimulatorRecord {
    /// Whether the simulator runs a network.
    pub fn is_network(&self) -> bool {
        self.weights.is_some()
    }
}

/// The weights of a simulator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WeightsRecord {
    /// Name of the file, without its folder.
    pub name: String,
    /// Size.
    pub bytes: u64,
    /// SHA-256 digest of the content.
    pub sha256: String,
}

impl WeightsRecord {
    /// The record of a file.
    pub fn of(file: &WeightsFile) -> Self {
        Self { name: file.name.clone(), bytes: file.bytes.len() as u64, sha256: file.digest.clone() }
    }
}

/// The version of this program.
pub fn program_version() -> &'static str {
    env!("CARGO_PKG_VERSION")
}

/// The commit that this program was built from.
pub fn program_commit() -> &'static str {
    option_env!("REACTSIM_COMMIT").unwrap_or("unknown")
}

impl Provenance {
    /// Notes backend and class of the processor if a simulator has a network.
    pub(super) fn with_machine(mut self) -> Self {
        let networks = self.simulators.iter().any(SimulatorRecord::is_network);
        self.backend = networks.then(|| backend().to_owned());
        self.cpu = networks.then(|| cpu_class().to_owned());
        self
    }

    /// The first setting in which two runs differ, with its value in each.
    pub fn difference(&self, other: &Self) -> Option<(String, String, String)> {
        let (name, mine, theirs) = differences(self, other).into_iter().next()?;
        Some((name.trim_start_matches("settings.").to_owned(), mine, theirs))
    }

    /// Whether the program was built from a known commit without changes.
    pub fn is_clean(&self) -> bool {
        self.commit != "unknown" && !self.commit.ends_with('+')
    }
}

/// The leaves in which two values differ as JSON: path, and text in each.
pub(super) fn differences<T: Serialize>(a: &T, b: &T) -> Vec<(String, String, String)> {
    let (mine, theirs) = (leaves(a), leaves(b));
    let absent = || "absent".to_owned();
    let value = |of: &BTreeMap<String, String>, key: &str| of.get(key).cloned().unwrap_or_else(absent);
    let only_theirs = theirs.keys().filter(|k| !mine.contains_key(*k));
    let differing = mine.keys().chain(only_theirs).filter(|k| mine.get(*k) != theirs.get(*k));
    differing.map(|k| (k.clone(), value(&mine, k), value(&theirs, k))).collect()
}

/// Every leaf of a value as JSON, by its path.
pub(super) fn leaves<T: Serialize>(value: &T) -> BTreeMap<String, String> {
    let mut out = BTreeMap::new();
    if let Ok(value) = serde_json::to_value(value) {
        flatten("", &value, &mut out);
    }
    out
}

/// Every leaf of a JSON value by its path.
fn flatten(path: &str, value: &serde_json::Value, out: &mut BTreeMap<String, String>) {
    let join = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match value {
        serde_json::Value::Object(map) => map.iter().for_each(|(k, v)| flatten(&join(k), v, out)),
        serde_json::Value::Array(list) => {
            list.iter().enumerate().for_each(|(i, v)| flatten(&format!("{path}[{i}]"), v, out));
        }
        leaf => {
            out.insert(path.to_owned(), leaf.to_string());
        }
    }
}
