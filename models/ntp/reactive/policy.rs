//! A trained reactive network with its vocabulary, in one file.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim_nn::perception::Class;
use reactsim_nn::{Initializer, Tensors, WeightsError, weights::save_with};
use serde::{Deserialize, Serialize};

use super::super::tokens::Vocabulary;
use super::super::tokens::file::PREFIX;
use super::{Config, Network};

/// Name of this kind of network in the configuration of a file.
const KIND: &str = "reactive";

/// A trained network and the tokens that it chooses from.
#[derive(Clone, Debug)]
pub struct Policy {
    /// Sizes of the network.
    pub config: Config,
    /// Vocabulary of tokens.
    pub vocabulary: Vocabulary,
    /// The network.
    pub network: Network,
}

/// Configuration in a file's metadata.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredConfig {
    kind: String,
    network: Config,
}

impl Policy {
    /// Reads a policy from the bytes of a file.
    ///
    /// # Errors
    /// [`WeightsError`] naming the tensor, token or field.
    pub fn read(bytes: &[u8], device: &Device) -> Result<Self, WeightsError> {
        let mut tensors = Tensors::read(bytes)?;
        tensors.expect_kind(KIND)?;
        let stored: StoredConfig = tensors.config()?;
        let config = stored.network;
        config.check()?;
        let vocabulary = Vocabulary::from_tables(&tensors.split_off(PREFIX))?;
        let tokens = Class::ALL.map(|c| vocabulary.tokens(c));
        let empty = Network::init(&config, tokens, &mut Initializer::blank(device));
        let network = tensors.load(empty)?;
        Ok(Self { config, vocabulary, network })
    }

    /// Returns the bytes of a file; `made` is metadata describing how it was made.
    ///
    /// # Errors
    /// [`WeightsError`] if the provenance cannot be serialized.
    pub fn write(&self, made: &BTreeMap<String, String>) -> Result<Vec<u8>, WeightsError> {
        let stored = StoredConfig { kind: KIND.to_owned(), network: self.config };
        save_with(&self.network, &stored, [self.vocabulary.tables()?], made)
    }
}
