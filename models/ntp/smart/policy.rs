//! The network with its vocabularies, in one file.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim_nn::perception::Class;
use reactsim_nn::{Tensors, WeightsError, weights::save_with};
use serde::{Deserialize, Serialize};

use super::super::tokens::file::PREFIX;
use super::super::tokens::map_vocabulary::MAP_PREFIX;
use super::super::tokens::{MapVocabulary, TOKEN_FRAMES, Vocabulary};
use super::{InputError, Smart, SmartConfig, TokenShapes, TokenTables};

/// Name of this kind of network in the configuration of a file.
const KIND: &str = "smart";

/// A trained network with its vocabularies of agent and map tokens.
#[derive(Clone, Debug)]
pub struct SmartPolicy {
    /// Vocabulary of agent tokens.
    pub vocabulary: Vocabulary,
    /// Vocabulary of map tokens.
    pub map_vocabulary: MapVocabulary,
    /// The network.
    pub network: Smart,
    /// Embedding vectors of all tokens.
    pub tables: TokenTables,
}

/// Configuration in a file's metadata.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredConfig {
    kind: String,
    network: serde_json::Value,
}

impl SmartPolicy {
    /// Combines a network with its vocabularies.
    ///
    /// # Errors
    /// [`WeightsError`] if they do not belong together.
    pub fn new(
        network: Smart,
        vocabulary: Vocabulary,
        map_vocabulary: MapVocabulary,
        device: &Device,
    ) -> Result<Self, WeightsError> {
        let frames = network.config().shift_frames;
        if frames != TOKEN_FRAMES {
            return Err(WeightsError::Refused(format!(
                "`shift_frames` of the network's configuration is {frames}, expected {TOKEN_FRAMES}: \
                 tokens of half a second at 10 Hz"
            )));
        }
        let tables = network.tables(&token_shapes(&vocabulary, &map_vocabulary), device).map_err(foreign)?;
        Ok(Self { vocabulary, map_vocabulary, network, tables })
    }

    /// Reads a policy from the bytes of a file written by [`Self::write`] or `models/ntp/export.py`.
    ///
    /// # Errors
    /// [`WeightsError`] naming the tensor, token or entry.
    pub fn read(bytes: &[u8], device: &Device) -> Result<Self, WeightsError> {
        let mut tensors = Tensors::read(bytes)?;
        tensors.expect_kind(KIND)?;
        let stored: StoredConfig = tensors.config()?;
        let config = SmartConfig::from_json(&stored.network.to_string())?;
        let vocabulary = Vocabulary::from_tables(&tensors.split_off(PREFIX))?;
        let map_vocabulary = MapVocabulary::from_tables(&tensors.split_off(MAP_PREFIX))?;
        // Check before loading the network: with a vocabulary of another size, the network would seem
        // wrong.
        token_shapes(&vocabulary, &map_vocabulary).check(&config).map_err(foreign)?;
        Self::new(Smart::of_tensors(&config, tensors, device)?, vocabulary, map_vocabulary, device)
    }

    /// Returns the bytes of a file; `made` is metadata describing how it was made.
    ///
    /// # Errors
    /// [`WeightsError`] if the provenance cannot be serialized.
    pub fn write(&self, made: &BTreeMap<String, String>) -> Result<Vec<u8>, WeightsError> {
        let network = serde_json::to_value(self.network.config());
        let network = network.map_err(|e| WeightsError::Config(e.to_string()))?;
        let stored = StoredConfig { kind: KIND.to_owned(), network };
        let vocabularies = [self.vocabulary.tables()?, self.map_vocabulary.tables()?];
        save_with(&self.network, &stored, vocabularies, made)
    }
}

/// Refuses vocabularies of another network.
fn foreign(error: InputError) -> WeightsError {
    WeightsError::Refused(error.to_string())
}

/// Converts the vocabularies to the token shapes that the network reads.
pub(super) fn token_shapes(vocabulary: &Vocabulary, map: &MapVocabulary) -> TokenShapes {
    let contours = |class| {
        let ends = (0..vocabulary.tokens(class)).map(|token| vocabulary.contour(class, token));
        ends.map(|c| std::array::from_fn(|i| c[i / 2][i % 2] as f32)).collect()
    };
    let curve = |token| {
        let points = map.curve(token);
        std::array::from_fn(|i| points[i / 2][i % 2] as f32)
    };
    TokenShapes { agents: Class::ALL.map(contours), map: (0..map.tokens()).map(curve).collect() }
}
