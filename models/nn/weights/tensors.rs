//! Tensors of a file.

use std::collections::BTreeMap;

use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::{CONFIG, WeightsError};

/// Beginning of a file that Git LFS has not fetched.
const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

/// Tensors of a safetensors file, by name. Values are copied only on access.
#[derive(Debug)]
pub struct Tensors<'a> {
    tensors: BTreeMap<String, TensorView<'a>>,
    metadata: BTreeMap<String, String>,
}

impl<'a> Tensors<'a> {
    /// Reads the tensors from the bytes of a whole file.
    ///
    /// # Errors
    /// [`WeightsError`] if they are cut short, of another format, or a pointer of Git LFS.
    pub fn read(bytes: &'a [u8]) -> Result<Self, WeightsError> {
        if bytes.starts_with(LFS_POINTER) {
            let text =
                "the file is a pointer of Git LFS and not the weights: run `git lfs pull` in its repository";
            return Err(WeightsError::Refused(text.to_owned()));
        }
        let (_, header) = SafeTensors::read_metadata(bytes)?;
        let metadata = header.metadata().clone().unwrap_or_default().into_iter().collect();
        let tensors = SafeTensors::deserialize(bytes)?.tensors().into_iter().collect();
        Ok(Self { tensors, metadata })
    }

    /// Returns the metadata of the file.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// Parses the configuration of the network from the metadata.
    ///
    /// # Errors
    /// [`WeightsError::Config`] if it is missing or does not fit the type.
    pub fn config<T: DeserializeOwned>(&self) -> Result<T, WeightsError> {
        let text = self.metadata.get(CONFIG).ok_or_else(|| WeightsError::Config("it is missing".into()))?;
        serde_json::from_str(text).map_err(|e| WeightsError::Config(e.to_string()))
    }

    /// Checks the kind of the network before its configuration is read, since those of other kinds differ.
    ///
    /// # Errors
    /// [`WeightsError`] if it is another one, or the configuration is missing or no object.
    pub fn expect_kind(&self, expected: &str) -> Result<(), WeightsError> {
        #[derive(Deserialize)]
        struct Kind {
            #[serde(default)]
            kind: String,
        }
        let Kind { kind: found } = self.config()?;
        if found == expected {
            return Ok(());
        }
        Err(WeightsError::Refused(format!(
            "the file holds a network of kind `{found}`, expected `{expected}`: \
             use it with the simulator that it was trained for"
        )))
    }

    /// Returns names and shapes, ordered by name.
    pub fn shapes(&self) -> impl Iterator<Item = (&str, &[usize])> {
        self.tensors.iter().map(|(name, view)| (name.as_str(), view.shape()))
    }

    /// Removes a prefix from the names if all of them have it, such as `encoder.` in the checkpoint
    /// of a larger model.
    #[must_use]
    pub fn without_prefix(mut self, prefix: &str) -> Self {
        if self.tensors.keys().all(|name| name.starts_with(prefix)) {
            let names = std::mem::take(&mut self.tensors).into_iter();
            self.tensors = names.map(|(name, view)| (name[prefix.len()..].to_owned(), view)).collect();
        }
        self
    }

    /// Removes and returns the tensors whose names begin with `prefix`.
    #[must_use]
    pub fn split_off(&mut self, prefix: &str) -> Self {
        let (own, rest) =
            std::mem::take(&mut self.tensors).into_iter().partition(|(name, _)| name.starts_with(prefix));
        self.tensors = rest;
        Self { tensors: own, metadata: self.metadata.clone() }
    }

    /// Removes the tensors whose names satisfy `unwanted`.
    #[must_use]
    pub fn without(mut self, unwanted: impl Fn(&str) -> bool) -> Self {
        self.tensors.retain(|name, _| !unwanted(name));
        self
    }

    /// Removes a tensor that duplicates another one under a second name, as PyTorch stores layers
    /// that are used twice. Does nothing if either is missing.
    ///
    /// # Errors
    /// [`WeightsError`] if the two differ.
    pub fn drop_twin(&mut self, name: &str, other: &str) -> Result<(), WeightsError> {
        let (Some(a), Some(b)) = (self.tensors.get(name), self.tensors.get(other)) else {
            return Ok(());
        };
        if (a.dtype(), a.shape(), a.data()) != (b.dtype(), b.shape(), b.data()) {
            return Err(WeightsError::Refused(format!(
                "tensors `{name}` and `{other}` should be identical but differ: the weights belong to \
                 another network"
            )));
        }
        self.tensors.remove(name);
        Ok(())
    }

    /// Returns the error about a tensor that is not in the file. Programs that wrap networks put a prefix
    /// before all names, such as `module.`.
    pub(super) fn missing(&self, name: &str, others: usize) -> WeightsError {
        let prefix =
            self.tensors.keys().find_map(|key| key.strip_suffix(name)).filter(|prefix| {
                prefix.ends_with('.') && self.tensors.keys().all(|key| key.starts_with(prefix))
            });
        let reason = match prefix {
            Some(prefix) => format!(
                "the names of all tensors begin with `{prefix}`: remove this prefix when exporting them"
            ),
            None => "the weights belong to another network or configuration".to_owned(),
        };
        WeightsError::Refused(format!("tensor `{name}` is missing{}: {reason}", more(others)))
    }

    /// Returns the shape and the values of a tensor of 32-bit floats, row by row.
    ///
    /// # Errors
    /// [`WeightsError`] if it is missing, of another type, or holds a value that is not finite.
    pub fn floats(&self, name: &str) -> Result<(&[usize], Vec<f32>), WeightsError> {
        let view = self.tensors.get(name).ok_or_else(|| self.missing(name, 0))?;
        if view.dtype() != Dtype::F32 {
            let found = view.dtype();
            return Err(WeightsError::Refused(format!(
                "tensor `{name}` holds {found:?}, expected F32: convert it when exporting"
            )));
        }
        let values: Vec<f32> =
            view.data().as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        if let Some(at) = values.iter().position(|v| !v.is_finite()) {
            let value = values[at];
            return Err(WeightsError::Refused(format!(
                "tensor `{name}` holds {value} at {at}: the weights are damaged, or training diverged"
            )));
        }
        Ok((view.shape(), values))
    }
}

/// Returns the text about other tensors with the same fault.
pub(super) fn more(others: usize) -> String {
    if others == 0 { String::new() } else { format!(", and {others} more") }
}
