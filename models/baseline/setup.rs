//! Setup of a baseline: the parameters of its card, possibly changed, and its weights.

use std::error::Error;

use serde::de::DeserializeOwned;

use super::{Backend, Card, ModelError, Parameters, Ranges, WeightsFile};

/// Parameters and weights from which a baseline is built.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Id of the baseline.
    pub id: &'static str,
    /// Parameters of its card, with changes applied.
    pub parameters: Parameters,
    /// Weights: always present for a baseline that needs them, never for one that does not.
    pub weights: Option<WeightsFile>,
    /// Backend of its network, if it has one.
    pub backend: Backend,
}

impl Setup {
    /// Builds a setup from the texts of a card and of the ranges of its parameters, and optional
    /// weights, on the default backend.
    ///
    /// # Errors
    /// [`ModelError`] if the card or the ranges cannot be read.
    pub fn new(
        id: &'static str,
        card: &str,
        ranges: &str,
        weights: Option<WeightsFile>,
    ) -> Result<Self, ModelError> {
        let parameters = Parameters::new(id, Card::read(id, card)?.parameters, Ranges::read(id, ranges)?);
        Ok(Self { id, parameters, weights, backend: Backend::default() })
    }

    /// Deserializes the parameters into the type that the baseline needs, after a check that all are
    /// within their ranges.
    ///
    /// # Errors
    /// [`ModelError`] naming the missing, unknown or invalid parameter.
    pub fn parameters<T: DeserializeOwned>(&self) -> Result<T, ModelError> {
        self.parameters.get()
    }

    /// Returns the weights.
    ///
    /// # Errors
    /// [`ModelError`] if there are none.
    pub fn weights(&self) -> Result<&WeightsFile, ModelError> {
        let id = self.id;
        self.weights.as_ref().ok_or_else(|| {
            ModelError::Refused(format!(
                "the simulator `{id}` needs weights, which do not ship with the program: \
                 give `model-weights` {id}=FILE"
            ))
        })
    }

    /// Reads the network from the bytes of the weights.
    ///
    /// # Errors
    /// [`ModelError`] if there are no weights, or they cannot be used, with the cause.
    pub fn read_weights<T, E>(&self, read: impl FnOnce(&[u8]) -> Result<T, E>) -> Result<T, ModelError>
    where
        E: Into<Box<dyn Error + Send + Sync>>,
    {
        let weights = self.weights()?;
        let refuse = |error: E| {
            let (id, file) = (self.id, weights.name.clone());
            ModelError::Weights { id, file, source: error.into() }
        };
        read(&weights.bytes).map_err(refuse)
    }
}
