//! Embedding vectors of tokens.

use burn::tensor::{Device, Tensor, TensorData};
use reactsim_nn::indices;

/// Embedding vectors of all tokens. They depend only on weights and vocabulary, so they are computed
/// once.
#[derive(Clone, Debug)]
pub struct TokenTables {
    /// Vectors of agent tokens of the three classes, concatenated.
    pub(super) agents: Tensor<2>,
    pub(super) starts: [usize; 3],
    pub(super) map: Tensor<2>,
}

impl TokenTables {
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
    let mut rows = rows.peekable();
    if rows.peek().is_none() {
        return Tensor::zeros([0, table.dims()[1]], &table.device());
    }
    table.clone().select(0, indices(rows, &table.device()))
}

/// Converts rows of numbers to a tensor.
pub(super) fn rows<const W: usize>(rows: &[[f32; W]], device: &Device) -> Tensor<2> {
    Tensor::from_data(TensorData::new(rows.as_flattened().to_vec(), [rows.len(), W]), device)
}
