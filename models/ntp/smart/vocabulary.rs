//! Shapes of tokens, and their embedding vectors.

use burn::tensor::{Device, Tensor, TensorData};

use super::{InputError, Smart, SmartConfig};

/// Shapes of all tokens.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Vocabulary {
    /// Agent tokens for vehicles, pedestrians and cyclists: the corners of the class's box after 0.5 s,
    /// x and y of left front, right front, right back, left back, in m, in the frame of the preceding
    /// pose (x forward, y left).
    pub agents: [Vec<[f32; 8]>; 3],
    /// Map tokens: 11 points, x and y, in m, starting at 0, 0 along x.
    pub map: Vec<[f32; 22]>,
}

/// Embedding vectors of all tokens. They depend only on weights and vocabulary, so they are computed
/// once.
#[derive(Clone, Debug)]
pub struct TokenTables {
    /// Vectors of agent tokens of the three classes, concatenated.
    agents: Tensor<2>,
    starts: [usize; 3],
    map: Tensor<2>,
}

impl Vocabulary {
    /// Checks the numbers of tokens against a network with this configuration.
    ///
    /// # Errors
    /// [`InputError::Vocabulary`].
    pub fn check(&self, config: &SmartConfig) -> Result<(), InputError> {
        let counts = config.n_token_agent.of_classes();
        let [vehicles, pedestrians, cyclists] = [0, 1, 2].map(|c| (self.agents[c].len(), counts[c]));
        for (of, (found, expected)) in [
            ("vehicles", vehicles),
            ("pedestrians", pedestrians),
            ("cyclists", cyclists),
            ("the map", (self.map.len(), config.n_token_map)),
        ] {
            if found != expected {
                return Err(InputError::Vocabulary { of, found, expected });
            }
        }
        Ok(())
    }
}

impl Smart {
    /// Computes the vectors of all tokens.
    ///
    /// # Errors
    /// [`InputError::Vocabulary`] if their number is not that of the network.
    pub fn tables(&self, vocabulary: &Vocabulary, device: &Device) -> Result<TokenTables, InputError> {
        vocabulary.check(self.config())?;
        let mut starts = [0; 3];
        let mut vectors = Vec::new();
        let mut count = 0;
        for (class, shapes) in vocabulary.agents.iter().enumerate() {
            starts[class] = count;
            count += shapes.len();
            vectors.push(self.agent_encoder.token_embedding(class).forward(rows(shapes, device)));
        }
        let map = self.map_encoder.token_embedding().forward(rows(&vocabulary.map, device));
        Ok(TokenTables { agents: Tensor::cat(vectors, 0), starts, map })
    }
}

impl TokenTables {
    /// Returns the device of the vectors.
    pub(super) fn device(&self) -> Device {
        self.map.device()
    }

    /// Returns the vectors of agent tokens, each given as (class, token).
    pub(super) fn agents(&self, tokens: impl Iterator<Item = (u8, u32)>) -> Tensor<2> {
        pick(&self.agents, tokens.map(|(class, token)| self.starts[usize::from(class)] + token as usize))
    }

    /// Returns the vectors of map tokens.
    pub(super) fn map(&self, tokens: &[u32]) -> Tensor<2> {
        pick(&self.map, tokens.iter().map(|t| *t as usize))
    }
}

/// Selects rows of a table.
pub(super) fn pick(table: &Tensor<2>, rows: impl Iterator<Item = usize>) -> Tensor<2> {
    let rows: Vec<i32> = rows.map(|r| r as i32).collect();
    let count = rows.len();
    if count == 0 {
        return Tensor::zeros([0, table.dims()[1]], &table.device());
    }
    table.clone().select(0, Tensor::from_data(TensorData::new(rows, [count]), &table.device()))
}

/// Converts rows of numbers to a tensor.
pub(super) fn rows<const W: usize>(rows: &[[f32; W]], device: &Device) -> Tensor<2> {
    Tensor::from_data(TensorData::new(rows.as_flattened().to_vec(), [rows.len(), W]), device)
}
