//! Records of simulators in the provenance.

use std::collections::BTreeMap;

use reactsim_baseline::WeightsFile;
use reactsim_external::{self as external, Processes};
use serde::{Deserialize, Serialize};

use crate::simulators::access::Access;

/// A simulator of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatorRecord {
    /// Id.
    pub id: String,
    /// Name in tables.
    pub title: String,
    /// Whether the simulator gets the log's future.
    pub oracle: bool,
    /// BLAKE3 digest of its card, which contains its parameters.
    pub card: String,
    /// Parameters that differ from the card, by dotted path, in TOML notation.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, String>,
    /// Weights, if the simulator has any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<WeightsRecord>,
    /// Simulators of a mix, each with its parameters and weights; otherwise empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub members: Vec<SimulatorRecord>,
    /// The external program that is the simulator, if it is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub external: Option<ExternalRecord>,
}

impl SimulatorRecord {
    /// Creates the record of a driver of the AV without a card.
    pub(crate) fn named(id: &str, title: &str) -> Self {
        Self { id: id.to_owned(), title: title.to_owned(), ..Self::default() }
    }

    /// Returns what the simulator can know beyond its observations.
    pub fn access(&self) -> Access {
        match &self.external {
            _ if self.oracle => Access::Oracle,
            None => Access::Blind,
            Some(external) if external.reveals_ids => Access::Ids,
            Some(_) => Access::BlindByMessage,
        }
    }

    /// Returns whether the simulator runs a network.
    pub fn is_network(&self) -> bool {
        self.parts().iter().any(|part| part.weights.is_some())
    }

    /// Returns the simulators of a mix, or the simulator itself: parameters and weights are theirs.
    pub fn parts(&self) -> &[Self] {
        if self.members.is_empty() { std::slice::from_ref(self) } else { &self.members }
    }
}

/// An external simulator, as it states itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExternalRecord {
    /// Command line, or `@stdio`.
    pub command: String,
    /// Version of the protocol.
    pub protocol: String,
    /// Stated name.
    pub name: String,
    /// Stated version; may be empty.
    pub version: String,
    /// Stated SHA-256 digest of its weights, if it has any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights_sha256: Option<String>,
    /// Number of episodes per batch, which can change the last bits of a network.
    pub batch: usize,
    /// Whether it receives ids and world coordinates.
    pub reveals_ids: bool,
}

impl ExternalRecord {
    /// Creates the record of a simulator or planner.
    pub(crate) fn of(processes: &Processes, batch: usize) -> Self {
        let stated = processes.description();
        Self {
            command: processes.command().text().to_owned(),
            protocol: external::PROTOCOL.to_owned(),
            name: stated.name.clone(),
            version: stated.version.clone(),
            weights_sha256: stated.weights_sha256.clone(),
            batch,
            reveals_ids: processes.reveals_ids(),
        }
    }
}

/// The weights of a simulator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WeightsRecord {
    /// Name of the file, without its folder.
    pub name: String,
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256 digest of the content.
    pub sha256: String,
}

impl WeightsRecord {
    /// Creates the record of a file.
    pub fn of(file: &WeightsFile) -> Self {
        Self { name: file.name.clone(), bytes: file.bytes.len() as u64, sha256: file.digest.clone() }
    }
}
