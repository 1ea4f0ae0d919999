//! Provenance of what was computed from scenarios.

use reactsim_scene::Scenario;
use serde::{Deserialize, Serialize};

use crate::{Tensors, WeightsError};

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

impl Provenance {
    /// Returns the provenance of what another program has made.
    pub fn foreign() -> Self {
        Self { method: "foreign".to_owned(), ..Self::default() }
    }

    /// Reads the provenance under this key of a file's metadata, `None` if there is none.
    ///
    /// # Errors
    /// [`WeightsError`] if it is damaged.
    pub fn of(file: &Tensors<'_>, key: &str) -> Result<Option<Self>, WeightsError> {
        let made = file.metadata().get(key).map(|made| serde_json::from_str(made)).transpose();
        made.map_err(|error| refused(key, &error))
    }

    /// Returns the metadata entry of a file, with this key.
    ///
    /// # Errors
    /// [`WeightsError`] if the settings cannot be written as text.
    pub fn entry(&self, key: &str) -> Result<(String, String), WeightsError> {
        let made = serde_json::to_string(self).map_err(|error| refused(key, &error))?;
        Ok((key.to_owned(), made))
    }
}

fn refused(key: &str, error: &serde_json::Error) -> WeightsError {
    WeightsError::Refused(format!("the provenance `{key}` cannot be read or written: {error}"))
}

/// The scenarios from which something is computed.
#[derive(Debug, Default)]
pub struct ScenarioDigest {
    scenarios: u64,
    digest: blake3::Hasher,
}

impl ScenarioDigest {
    /// Adds a scenario.
    pub fn add(&mut self, scenario: &Scenario) {
        self.scenarios += 1;
        self.digest.update(scenario.digest().as_bytes());
    }

    /// Returns the provenance of what a method with these settings and this seed makes of them.
    pub fn provenance(&self, method: &str, settings: serde_json::Value, seed: u64) -> Provenance {
        let data = match self.scenarios {
            0 => String::new(),
            _ => self.digest.finalize().to_hex().to_string(),
        };
        Provenance { method: method.to_owned(), settings, seed, scenarios: self.scenarios, data }
    }
}
