//! A trained network with its anchors, in one file.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim_nn::learning::{INTENTIONS_PREFIX, Intentions};
use reactsim_nn::{Initializer, Tensors, WeightsError, weights::save_with};
use serde::{Deserialize, Serialize};

use super::inputs::Sight;
use super::network::{Vbd, VbdConfig};

/// Kind of this network in the configuration of the file.
const KIND: &str = "vbd";

/// A network ready to plan.
#[derive(Clone, Debug)]
pub struct VbdPolicy {
    /// Sizes.
    pub config: VbdConfig,
    /// Limits of its input.
    pub sight: Sight,
    /// Anchors: points that agents may head for.
    pub anchors: Intentions,
    /// The network.
    pub network: Vbd,
}

/// Configuration in a file's metadata.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredConfig {
    kind: String,
    network: VbdConfig,
    sight: Sight,
}

impl VbdPolicy {
    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// [`WeightsError`], which names the tensor or the field.
    pub fn read(bytes: &[u8], device: &Device) -> Result<Self, WeightsError> {
        let mut tensors = Tensors::read(bytes)?;
        tensors.expect_kind(KIND)?;
        let StoredConfig { network: config, sight, .. } = tensors.config()?;
        config.check()?;
        sight.check()?;
        let anchors = Intentions::from_tables(&tensors.split_off(INTENTIONS_PREFIX))?;
        let network = tensors.load(Vbd::init(&config, &mut Initializer::blank(device)))?;
        Ok(Self { config, sight, anchors, network })
    }

    /// Returns the bytes of a file; `made` is further metadata.
    ///
    /// # Errors
    /// [`WeightsError`] if the provenance or the configuration cannot be written as text.
    pub fn write(&self, made: &BTreeMap<String, String>) -> Result<Vec<u8>, WeightsError> {
        let stored = StoredConfig { kind: KIND.to_owned(), network: self.config, sight: self.sight };
        save_with(&self.network, &stored, [self.anchors.tables()?], made)
    }
}
