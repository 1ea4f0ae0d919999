//! Provenance of what was computed from scenarios.

use serde::{Deserialize, Serialize};

/// Provenance of a vocabulary or of intention points.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Builder: `k-disks`, `trajtok`, `kinematic`, `k-means`, `fan`, or `foreign`.
    pub method: String,
    /// Settings of the builder.
    pub settings: serde_json::Value,
    /// Seed of its random choices.
    pub seed: u64,
    /// Number of scenarios from which they were computed.
    pub scenarios: u64,
    /// BLAKE3 digest of the digests of these scenarios in their order; empty if there are none.
    pub data: String,
}
