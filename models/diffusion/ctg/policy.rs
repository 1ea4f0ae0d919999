//! A trained network with its sizes, in one file.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim_nn::{Initializer, Tensors, WeightsError, weights::save_with};
use serde::{Deserialize, Serialize};

use super::network::{Ctg, CtgConfig, Decoding};
use super::sight::Sight;

/// Kind of this network in the configuration of the file.
const KIND: &str = "ctg";

/// A network ready to plan.
#[derive(Clone, Debug)]
pub struct CtgPolicy {
    /// Sizes.
    pub config: CtgConfig,
    /// Limits of its input.
    pub sight: Sight,
    /// The network.
    pub network: Ctg,
}

/// Configuration in a file's metadata.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredConfig {
    kind: String,
    network: CtgConfig,
    sight: Sight,
}

impl CtgPolicy {
    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// [`WeightsError`], which names the tensor or the field.
    pub fn read(bytes: &[u8], device: &Device) -> Result<Self, WeightsError> {
        let tensors = Tensors::read(bytes)?;
        tensors.expect_kind(KIND)?;
        let StoredConfig { network: config, sight, .. } = tensors.config()?;
        config.check()?;
        sight.check()?;
        let network = tensors.load(Ctg::init(&config, &sight, &mut Initializer::blank(device)))?;
        Ok(Self { config, sight, network })
    }

    /// Checks how the network finds actions.
    ///
    /// # Errors
    /// [`WeightsError`] if in another way.
    pub fn expect(&self, decoding: Decoding) -> Result<(), WeightsError> {
        let name = |decoding| match decoding {
            Decoding::Cloning => ("cloning", "`ctg-cloning`"),
            Decoding::Diffusion => ("diffusion", "`ctg-diffusion` or `ctg-guided`"),
        };
        let ((found, simulator), (expected, _)) = (name(self.config.decoding), name(decoding));
        if found == expected {
            return Ok(());
        }
        Err(WeightsError::Refused(format!(
            "the network finds actions by {found}, expected {expected}: use it with the simulator {simulator}"
        )))
    }

    /// Returns the bytes of a file; `made` is further metadata.
    ///
    /// # Errors
    /// [`WeightsError`] if the configuration cannot be written as text.
    pub fn write(&self, made: &BTreeMap<String, String>) -> Result<Vec<u8>, WeightsError> {
        let stored = StoredConfig { kind: KIND.to_owned(), network: self.config, sight: self.sight };
        save_with(&self.network, &stored, [], made)
    }
}
