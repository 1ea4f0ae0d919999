//! The network with its vocabularies, in one file.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim::models::nn::weights::{CONFIG, save_with};
use reactsim::models::nn::{Tensors, WeightsError};
use serde::{Deserialize, Serialize};

use super::super::tokens::file::PREFIX;
use super::super::tokens::map_vocabulary::MAP_PREFIX;
use super::super::tokens::{Class, MapVocabulary, TOKEN_FRAMES, Vocabulary, VocabularyError};
use super::{InputError, LoadError, Smart, SmartConfig, TokenTables, Vocabulary as Shapes};

/// What the configuration in the file calls this kind of network.
const KIND: &str = "smart";

/// A network that is ready to drive, and the tokens that it knows agents and the map by.
#[derive(Clone, Debug)]
pub struct SmartPolicy {
    /// Tokens of agents.
    pub vocabulary: Vocabulary,
    /// Tokens of the map.
    pub map_vocabulary: MapVocabulary,
    /// The network.
    pub network: Smart,
    /// What the network makes of the tokens.
    pub tables: TokenTables,
}

/// The configuration in a file's metadata.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    kind: String,
    network: serde_json::Value,
}

/// Why a file holds no such policy.
#[derive(Debug, thiserror::Error)]
pub enum SmartPolicyError {
    /// Its network.
    #[error(transparent)]
    Network(#[from] LoadError),
    /// Its tokens.
    #[error(transparent)]
    Vocabulary(#[from] VocabularyError),
    /// Tokens of another network.
    #[error(transparent)]
    Tokens(#[from] InputError),
    /// A network of another kind.
    #[error(
        "the file holds a network of kind `{0}`, expected `{KIND}`: give it to the simulator that it was made for"
    )]
    Kind(String),
    /// Tokens of another duration.
    #[error(
        "`shift_frames` of the network's configuration is {0}, expected {TOKEN_FRAMES}: tokens of half a second at 10 Hz"
    )]
    Frames(usize),
}

impl From<WeightsError> for SmartPolicyError {
    fn from(error: WeightsError) -> Self {
        Self::Network(error.into())
    }
}

impl SmartPolicy {
    /// A network with its vocabularies.
    ///
    /// # Errors
    /// [`SmartPolicyError`] if they are not of one another.
    pub fn new(
        network: Smart,
        vocabulary: Vocabulary,
        map_vocabulary: MapVocabulary,
        device: &Device,
    ) -> Result<Self, SmartPolicyError> {
        let frames = network.config().shift_frames;
        if frames != TOKEN_FRAMES {
            return Err(SmartPolicyError::Frames(frames));
        }
        let tables = network.tables(&shapes(&vocabulary, &map_vocabulary), device)?;
        Ok(Self { vocabulary, map_vocabulary, network, tables })
    }

    /// Reads the bytes of a file: what [`Self::write`] or `models/ntp/export.py` wrote.
    ///
    /// # Errors
    /// [`SmartPolicyError`] that names the tensor, the token or the entry.
    pub fn read(bytes: &[u8], device: &Device) -> Result<Self, SmartPolicyError> {
        let mut tensors = Tensors::read(bytes)?;
        let stored: Stored = tensors.config()?;
        if stored.kind != KIND {
            return Err(SmartPolicyError::Kind(stored.kind));
        }
        let config = SmartConfig::from_json(&stored.network.to_string()).map_err(LoadError::from)?;
        let vocabulary = Vocabulary::from_tables(&tensors.split_off(PREFIX))?;
        let map_vocabulary = MapVocabulary::from_tables(&tensors.split_off(MAP_PREFIX))?;
        // Before the network, which a vocabulary of another count would make to look wrong.
        shapes(&vocabulary, &map_vocabulary).check(&config)?;
        Self::new(Smart::of_tensors(&config, tensors, device)?, vocabulary, map_vocabulary, device)
    }

    /// The bytes of a file; `made` tells how it was made.
    ///
    /// # Errors
    /// [`SmartPolicyError`] where what it was made of can not be written as text.
    pub fn write(&self, made: &BTreeMap<String, String>) -> Result<Vec<u8>, SmartPolicyError> {
        let text = |e: serde_json::Error| WeightsError::Config(e.to_string());
        let (mut tables, entry) = self.vocabulary.tables()?;
        let (map_tables, map_entry) = self.map_vocabulary.tables()?;
        tables.extend(map_tables);
        let network = serde_json::to_value(self.network.config()).map_err(text)?;
        let config = serde_json::to_string(&Stored { kind: KIND.to_owned(), network }).map_err(text)?;
        let mut metadata = made.clone();
        metadata.extend([entry, map_entry, (CONFIG.to_owned(), config)]);
        Ok(save_with(&self.network, tables, &metadata))
    }
}

/// The tokens as the network sees them.
fn shapes(vocabulary: &Vocabulary, map: &MapVocabulary) -> Shapes {
    let contours = |class| {
        let ends = (0..vocabulary.tokens(class)).map(|token| vocabulary.contour(class, token));
        ends.map(|c| std::array::from_fn(|i| c[i / 2][i % 2] as f32)).collect()
    };
    let curve = |token| {
        let points = map.curve(token);
        std::array::from_fn(|i| points[i / 2][i % 2] as f32)
    };
    Shapes { agents: Class::ALL.map(contours), map: (0..map.tokens()).map(curve).collect() }
}
