//! `reference.toml`: the identity of a reference, its origin, and the files in its folder.

use std::collections::BTreeMap;

use reactsim_files::work::available_threads;
use reactsim_nn::cpu_class;
use serde::{Deserialize, Serialize};

use super::SimulatorClass;
use crate::source::benchmarks::BenchmarkRecord;

/// Format id of `reference.toml`.
pub(super) const FORMAT: &str = "reactsim-reference-v1";

/// The content of `reference.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceRecord {
    /// `reactsim-reference-v1`.
    pub format: String,
    /// Name of the reference and its folder.
    pub name: String,
    /// Title in tables.
    pub title: String,
    /// The commands that produced the run, in order.
    pub commands: Vec<String>,
    /// Known benchmark; `None` for other sets of scenarios, whose digests are in the provenance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub benchmark: Option<BenchmarkRecord>,
    /// The machine of the run.
    pub machine: MachineRecord,
    /// BLAKE3 digests of the other files of the folder, by name.
    pub files: BTreeMap<String, String>,
    /// Required agreement of each simulator, by id.
    pub simulators: BTreeMap<String, SimulatorClass>,
}

/// A machine.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MachineRecord {
    /// Operating system.
    pub os: String,
    /// Architecture.
    pub arch: String,
    /// Class of the processor.
    pub cpu: String,
    /// Number of cores.
    pub cores: usize,
}

impl MachineRecord {
    /// Returns the record of this machine.
    pub fn here() -> Self {
        Self {
            os: std::env::consts::OS.to_owned(),
            arch: std::env::consts::ARCH.to_owned(),
            cpu: cpu_class().to_owned(),
            cores: available_threads(),
        }
    }
}
