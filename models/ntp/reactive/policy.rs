//! A trained reactive network with its vocabulary, in one file.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim::models::nn::weights::{CONFIG, save_with};
use reactsim::models::nn::{Initializer, Tensors, WeightsError};
use serde::{Deserialize, Serialize};

use super::super::tokens::file::PREFIX;
use super::super::tokens::{Class, Vocabulary, VocabularyError};
use super::{Config, Network};

/// What the configuration in the file calls this kind of network.
const KIND: &str = "reactive";

/// A network that is ready to drive, and the tokens that it chooses from.
#[derive(Clone, Debug)]
pub struct Policy {
    /// Sizes.
    pub config: Config,
    /// Tokens.
    pub vocabulary: Vocabulary,
    /// The network.
    pub network: Network,
}

/// The configuration in a file's metadata.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    kind: String,
    network: Config,
}

/// Why a file holds no such policy.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// Its tensors or its configuration.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// Its tokens.
    #[error(transparent)]
    Vocabulary(#[from] VocabularyError),
    /// A network of another kind.
    #[error(
        "the file holds a network of kind `{0}`, expected `{KIND}`: give it to the simulator that it was made for"
    )]
    Kind(String),
    /// Sizes that can not be.
    #[error("the file's configuration has {field} = {value}, expected {expected}")]
    Size {
        /// Field.
        field: &'static str,
        /// Value.
        value: f64,
        /// What can be.
        expected: &'static str,
    },
}

impl Policy {
    /// Reads the bytes of a file.
    ///
    /// # Errors
    /// [`PolicyError`] that names the tensor, the token or the field.
    pub fn read(bytes: &[u8], device: &Device) -> Result<Self, PolicyError> {
        let mut tensors = Tensors::read(bytes)?;
        let stored: Stored = tensors.config()?;
        if stored.kind != KIND {
            return Err(PolicyError::Kind(stored.kind));
        }
        let config = stored.network;
        config.check()?;
        let vocabulary = Vocabulary::from_tables(&tensors.split_off(PREFIX))?;
        let tokens = Class::ALL.map(|c| vocabulary.tokens(c));
        let empty = Network::init(&config, tokens, &mut Initializer::new(0, device));
        let network = tensors.load(empty)?;
        Ok(Self { config, vocabulary, network })
    }

    /// The bytes of a file; `made` tells how it was made.
    ///
    /// # Errors
    /// [`PolicyError`] where what it was made of can not be written as text.
    pub fn write(&self, made: &BTreeMap<String, String>) -> Result<Vec<u8>, PolicyError> {
        let (tables, entry) = self.vocabulary.tables()?;
        let stored = Stored { kind: KIND.to_owned(), network: self.config };
        let config = serde_json::to_string(&stored).map_err(|e| WeightsError::Config(e.to_string()))?;
        let mut metadata = made.clone();
        metadata.extend([entry, (CONFIG.to_owned(), config)]);
        Ok(save_with(&self.network, tables, &metadata))
    }
}
