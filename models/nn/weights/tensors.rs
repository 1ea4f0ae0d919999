//! The tensors of a file.

use std::collections::BTreeMap;

use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};
use serde::de::DeserializeOwned;

use super::{CONFIG, WeightsError};

/// The tensors of a safetensors file, by name. Nothing is copied until it is asked for.
#[derive(Debug)]
pub struct Tensors<'a> {
    tensors: BTreeMap<String, TensorView<'a>>,
    metadata: BTreeMap<String, String>,
}

impl<'a> Tensors<'a> {
    /// The tensors in the bytes of a whole file.
    ///
    /// # Errors
    /// [`WeightsError::Format`].
    pub fn read(bytes: &'a [u8]) -> Result<Self, WeightsError> {
        let (_, header) = SafeTensors::read_metadata(bytes)?;
        let metadata = header.metadata().clone().unwrap_or_default().into_iter().collect();
        let tensors = SafeTensors::deserialize(bytes)?.tensors().into_iter().collect();
        Ok(Self { tensors, metadata })
    }

    /// Texts that lie beside the tensors.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// The configuration of the network, from the metadata.
    ///
    /// # Errors
    /// [`WeightsError::Config`] if there is none, or it does not fit the type.
    pub fn config<T: DeserializeOwned>(&self) -> Result<T, WeightsError> {
        let text = self.metadata.get(CONFIG).ok_or_else(|| WeightsError::Config("it is not there".into()))?;
        serde_json::from_str(text).map_err(|e| WeightsError::Config(e.to_string()))
    }

    /// Names with shapes, in order.
    pub fn shapes(&self) -> impl Iterator<Item = (&str, &[usize])> {
        self.tensors.iter().map(|(name, view)| (name.as_str(), view.shape()))
    }

    /// Takes a prefix off the names, such as `encoder.` of the checkpoint of a larger model, if all of them have it.
    #[must_use]
    pub fn without_prefix(mut self, prefix: &str) -> Self {
        if self.tensors.keys().all(|name| name.starts_with(prefix)) {
            let names = std::mem::take(&mut self.tensors).into_iter();
            self.tensors = names.map(|(name, view)| (name[prefix.len()..].to_owned(), view)).collect();
        }
        self
    }

    /// Takes out the tensors whose names begin so.
    #[must_use]
    pub fn split_off(&mut self, prefix: &str) -> Self {
        let (own, rest) =
            std::mem::take(&mut self.tensors).into_iter().partition(|(name, _)| name.starts_with(prefix));
        self.tensors = rest;
        Self { tensors: own, metadata: self.metadata.clone() }
    }

    /// Leaves out what has such a name.
    #[must_use]
    pub fn without(mut self, unwanted: impl Fn(&str) -> bool) -> Self {
        self.tensors.retain(|name, _| !unwanted(name));
        self
    }

    /// Leaves a tensor out that is another one under a second name, as PyTorch stores layers that are used twice. If either is not there
    /// nothing happens.
    ///
    /// # Errors
    /// [`WeightsError::Twins`] if the two are not the same.
    pub fn drop_twin(&mut self, name: &str, other: &str) -> Result<(), WeightsError> {
        let (Some(a), Some(b)) = (self.tensors.get(name), self.tensors.get(other)) else {
            return Ok(());
        };
        if (a.dtype(), a.shape(), a.data()) != (b.dtype(), b.shape(), b.data()) {
            return Err(WeightsError::Twins { name: name.into(), other: other.into() });
        }
        self.tensors.remove(name);
        Ok(())
    }

    /// The shape and the values of a tensor of 32-bit floats, row by row.
    ///
    /// # Errors
    /// [`WeightsError`] if it is missing, of another type, or holds a value that is not finite.
    pub fn floats(&self, name: &str) -> Result<(&[usize], Vec<f32>), WeightsError> {
        let missing = || WeightsError::Missing { name: name.into(), expected: Vec::new(), others: 0 };
        let view = self.tensors.get(name).ok_or_else(missing)?;
        if view.dtype() != Dtype::F32 {
            return Err(WeightsError::Type { name: name.into(), found: format!("{:?}", view.dtype()) });
        }
        let values: Vec<f32> =
            view.data().as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        if let Some(at) = values.iter().position(|v| !v.is_finite()) {
            return Err(WeightsError::NotFinite { name: name.into(), at, value: values[at] });
        }
        Ok((view.shape(), values))
    }
}
