//! `reference.toml`: what a reference is of, how it was made, and what must be in its folder.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::thread;

use serde::{Deserialize, Serialize};

use super::SimulatorClass;
use crate::evaluation::BenchmarkRecord;
use crate::models::nn::cpu_class;

/// Form of `reference.toml`.
pub(super) const FORMAT: &str = "reactsim-reference-v1";

/// The content of `reference.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceRecord {
    /// `reactsim-reference-v1`.
    pub format: String,
    /// Name, that of its folder.
    pub name: String,
    /// One line for people.
    pub title: String,
    /// The commands that made it, in their order.
    pub commands: Vec<String>,
    /// The known benchmark that it is of; `None` for other sets of scenarios, whose digests are in the provenance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub benchmark: Option<BenchmarkRecord>,
    /// The machine that it was made on.
    pub machine: MachineRecord,
    /// BLAKE3 digests of the other files of the folder, by name.
    pub files: BTreeMap<String, String>,
    /// How closely each simulator must agree, by id.
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
    /// This machine.
    pub fn here() -> Self {
        Self {
            os: std::env::consts::OS.to_owned(),
            arch: std::env::consts::ARCH.to_owned(),
            cpu: cpu_class().to_owned(),
            cores: thread::available_parallelism().map_or(1, NonZeroUsize::get),
        }
    }
}
