//! Named tensors in files that are whole or not there.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use safetensors::tensor::{Dtype, SafeTensors, View};
use serde_json::Value;

use super::TrainingError;

/// The key of what the file says of itself: one key, as the order of several would not be the same in every file.
const ABOUT: &str = "reactsim";
/// The field of it with the digest of the tensors.
const DIGEST: &str = "tensors";

/// Tensors by name, `f32`, with what the file says of itself: safetensors, <https://github.com/huggingface/safetensors>.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NamedTensors {
    /// What the file says of itself: a JSON object, which is kept under `reactsim` in the metadata.
    pub about: serde_json::Map<String, Value>,
    /// The tensors.
    pub tensors: BTreeMap<String, NamedTensor>,
}

/// A tensor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NamedTensor {
    /// Sizes of its dimensions.
    pub shape: Vec<usize>,
    /// Its numbers, row by row.
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
    /// Writes a file, with a digest of the tensors: under another name first, so that a file of this name is always whole.
    ///
    /// # Errors
    /// [`TrainingError::Write`]; what was there before is left as it was.
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
    /// [`TrainingError::Unreadable`]: it is cut short, damaged, or of another program.
    pub fn read(path: &Path) -> Result<Self, TrainingError> {
        let refuse = |why: String| TrainingError::Unreadable { path: path.to_owned(), why };
        let content = fs::read(path).map_err(|e| refuse(e.to_string()))?;
        let damaged = |e| refuse(format!("it is cut short, damaged or no safetensors file ({e})"));
        let (_, metadata) = SafeTensors::read_metadata(&content).map_err(damaged)?;
        let tensors = SafeTensors::deserialize(&content).map_err(damaged)?;
        let about = metadata.metadata().as_ref().and_then(|m| m.get(ABOUT));
        let about = about.and_then(|text| serde_json::from_str(text).ok());
        let Some(Value::Object(mut about)) = about else {
            return Err(refuse(format!("its metadata have no `{ABOUT}`: another program wrote it")));
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
                "it is damaged: the digest of its tensors is not the one that it states".to_owned(),
            ));
        }
        read.about = about;
        Ok(read)
    }

    /// BLAKE3 digest of names, shapes and numbers.
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

/// What the name of a file ends with while it is being written.
pub(super) const PARTIAL: &str = ".partial";

/// The name under which a file is written first.
fn partial(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(PARTIAL);
    path.with_file_name(name)
}

/// Gives a file this content: it has the old one or the new one, whatever happens meanwhile.
pub(super) fn replace(path: &Path, content: &[u8]) -> Result<(), TrainingError> {
    let partial = partial(path);
    let write = || -> io::Result<()> {
        let mut file = File::create(&partial)?;
        file.write_all(content)?;
        file.sync_all()?;
        fs::rename(&partial, path)?;
        // The name is on the disk when the folder is; where folders can not be synchronised there is nothing to be done about it.
        if let Some(folder) = path.parent().and_then(|folder| File::open(folder).ok()) {
            folder.sync_all().ok();
        }
        Ok(())
    };
    write().map_err(|source| {
        // What is left of it is of no use, and takes room.
        fs::remove_file(&partial).ok();
        TrainingError::Write { path: path.to_owned(), source }
    })
}
