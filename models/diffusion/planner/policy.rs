//! A trained network with its sizes, in one file.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim_baseline::weights::PLANNER;
use reactsim_nn::{Initializer, Tensors, WeightsError, weights::save_with};
use serde::{Deserialize, Serialize};

use super::inputs::PlannerSight;
use super::network::{DiffusionPlanner, PlannerConfig};

/// A network ready to plan.
#[derive(Clone, Debug)]
pub struct PlannerPolicy {
    /// Sizes.
    pub config: PlannerConfig,
    /// Limits of its input.
    pub sight: PlannerSight,
    /// The network.
    pub network: DiffusionPlanner,
}

/// Configuration in a file's metadata.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredConfig {
    kind: String,
    network: Sizes,
    #[serde(default)]
    sight: Option<PlannerSight>,
}

/// Sizes of the network, by name or one by one.
#[derive(Debug, Serialize, Deserialize)]
#[serde(untagged)]
enum Sizes {
    Preset(Preset),
    Explicit(PlannerConfig),
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Preset {
    Published,
}

impl PlannerPolicy {
    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// [`WeightsError`], which names the tensor or the field.
    pub fn read(bytes: &[u8], device: &Device) -> Result<Self, WeightsError> {
        let tensors = Tensors::read(bytes)?.without_prefix("module.");
        tensors.expect_kind(PLANNER)?;
        let StoredConfig { network, sight, .. } = tensors.config()?;
        let (config, seen) = match network {
            Sizes::Preset(Preset::Published) => (PlannerConfig::published(), PlannerSight::published()),
            Sizes::Explicit(config) => (config, PlannerSight::default()),
        };
        let sight = sight.unwrap_or(seen);
        config.check()?;
        sight.check()?;
        let empty = DiffusionPlanner::init(&config, &mut Initializer::blank(device));
        Ok(Self { config, sight, network: tensors.load(empty)? })
    }

    /// Returns the bytes of a file; `made` is further metadata.
    ///
    /// # Errors
    /// [`WeightsError`] if the configuration cannot be written as text.
    pub fn write(&self, made: &BTreeMap<String, String>) -> Result<Vec<u8>, WeightsError> {
        let network = Sizes::Explicit(self.config);
        let stored = StoredConfig { kind: PLANNER.to_owned(), network, sight: Some(self.sight) };
        save_with(&self.network, &stored, [], made)
    }
}
