//! Files of named tensors, written completely or not at all.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::io;
use std::path::Path;

use reactsim_files as files;
use safetensors::tensor::{Dtype, SafeTensors, View};
use serde_json::Value;

use super::TrainingError;

/// Metadata key of the description. A single key, because the order of several keys varies between files.
const ABOUT: &str = "reactsim";
/// Field of the description with the digest of the tensors.
const DIGEST: &str = "tensors";

/// Tensors (`f32`) by name, with a description: safetensors, <https://github.com/huggingface/safetensors>.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NamedTensors {
    /// Description: a JSON object, stored under `reactsim` in the metadata.
    pub about: serde_json::Map<String, Value>,
    /// The tensors.
    pub tensors: BTreeMap<String, NamedTensor>,
}

/// A tensor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NamedTensor {
    /// Sizes of its dimensions.
    pub shape: Vec<usize>,
    /// Its numbers in row-major order.
    pub values: Vec<f32>,
}

impl View for &NamedTensor {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        self.values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>().into()
    }

    fn data_len(&self) -> usize {
        4 * self.values.len()
    }
}

impl NamedTensors {
    /// Writes a file with a digest of the tensors, under another name first, so that a file with this
    /// name is always complete.
    ///
    /// # Errors
    /// [`TrainingError::Write`]; an existing file is left unchanged.
    pub fn write(&self, path: &Path) -> Result<(), TrainingError> {
        let mut about = self.about.clone();
        about.insert(DIGEST.to_owned(), self.digest().into());
        let metadata = HashMap::from([(ABOUT.to_owned(), Value::Object(about).to_string())]);
        let content = safetensors::serialize(self.tensors.iter(), Some(metadata))
            .map_err(|e| TrainingError::Write { path: path.to_owned(), source: io::Error::other(e) })?;
        replace(path, &content)
    }

    /// Reads a file that this program wrote.
    ///
    /// # Errors
    /// [`TrainingError::Unreadable`] if it is truncated, damaged, or written by another program.
    pub fn read(path: &Path) -> Result<Self, TrainingError> {
        let refuse = |why: String| TrainingError::Unreadable { path: path.to_owned(), why };
        let content = fs::read(path).map_err(|e| refuse(e.to_string()))?;
        let damaged = |e| refuse(format!("it is truncated, damaged or not a safetensors file ({e})"));
        let (_, metadata) = SafeTensors::read_metadata(&content).map_err(damaged)?;
        let tensors = SafeTensors::deserialize(&content).map_err(damaged)?;
        let about = metadata.metadata().as_ref().and_then(|m| m.get(ABOUT));
        let about = about.and_then(|text| serde_json::from_str(text).ok());
        let Some(Value::Object(mut about)) = about else {
            return Err(refuse(format!("its metadata has no `{ABOUT}`: another program wrote it")));
        };
        let mut read = Self::default();
        for (name, tensor) in tensors.iter() {
            if tensor.dtype() != Dtype::F32 {
                return Err(refuse(format!("the tensor `{name}` is {:?}, expected F32", tensor.dtype())));
            }
            let (numbers, _) = tensor.data().as_chunks::<4>();
            let values = numbers.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
            let tensor = NamedTensor { shape: tensor.shape().to_vec(), values };
            read.tensors.insert(name.to_owned(), tensor);
        }
        let (found, stated) = (read.digest(), about.remove(DIGEST));
        if stated.as_ref().and_then(Value::as_str) != Some(&found) {
            return Err(refuse(
                "it is damaged: the digest of its tensors differs from the recorded one".to_owned(),
            ));
        }
        read.about = about;
        Ok(read)
    }

    /// Returns the BLAKE3 digest of names, shapes and numbers.
    fn digest(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        for (name, tensor) in &self.tensors {
            hasher.update(&(name.len() as u64).to_le_bytes());
            hasher.update(name.as_bytes());
            hasher.update(&(tensor.shape.len() as u64).to_le_bytes());
            tensor.shape.iter().for_each(|n| {
                hasher.update(&(*n as u64).to_le_bytes());
            });
            hasher.update(&tensor.data());
        }
        hasher.finalize().to_hex().to_string()
    }
}

/// Replaces the content of a file atomically.
pub(super) fn replace(path: &Path, content: &[u8]) -> Result<(), TrainingError> {
    let write = files::replace(path, |out| out.write_all(content));
    write.map_err(|source| TrainingError::Write { path: path.to_owned(), source })
}
