//! Weights: files that ship with the program, the manifest of known files, and the file a baseline
//! is given.

use std::borrow::Cow;

use reactsim_weights::MANIFEST;
use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::ModelError;

/// Id of the planner that samples candidates for deviated AVs. It is no baseline, but has weights and a task.
pub const PLANNER: &str = "diffusion-planner";

/// A file of weights.
#[derive(Clone, Debug)]
pub struct WeightsFile {
    /// File name, without the folder.
    pub name: String,
    /// Content of the file.
    pub bytes: Cow<'static, [u8]>,
    /// SHA-256 of the content, 64 hexadecimal digits.
    pub digest: String,
}

impl WeightsFile {
    /// Builds a file and computes its digest.
    pub fn new(name: impl Into<String>, bytes: impl Into<Cow<'static, [u8]>>) -> Self {
        let bytes = bytes.into();
        let digest = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        Self { name: name.into(), bytes, digest }
    }

    /// Compares the digest with that in the manifest if the manifest lists the file; other files
    /// are not checked.
    ///
    /// # Errors
    /// [`ModelError`] naming both digests.
    pub fn check(&self, id: &str) -> Result<(), ModelError> {
        let Some(row) = rows_for(id)?.find(|row| row.file == self.name) else {
            return Ok(());
        };
        if row.sha256 == self.digest {
            return Ok(());
        }
        Err(ModelError::Refused(format!(
            "the weights {} of `{id}` have the SHA-256 {}, but the manifest lists {}: \
             the file is damaged or of another version; get the listed file, or rename yours",
            self.name, self.digest, row.sha256
        )))
    }

    /// Returns whether the manifest lists a file of this content, under any name, for the baseline.
    ///
    /// # Errors
    /// [`ModelError`] if the manifest cannot be read; a test rules it out.
    pub fn is_listed(&self, id: &str) -> Result<bool, ModelError> {
        Ok(rows_for(id)?.any(|row| row.sha256 == self.digest))
    }
}

/// Row of the manifest that describes one file of weights.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WeightsRow {
    /// Id of the baseline that reads it, or [`PLANNER`].
    pub id: String,
    /// Ids of other baselines that also read it.
    #[serde(default)]
    pub also: Vec<String>,
    /// File name.
    pub file: String,
    /// Description.
    pub title: String,
    /// Size in bytes.
    pub bytes: u64,
    /// SHA-256 of the content.
    pub sha256: String,
    /// Licence for its use.
    pub licence: String,
    /// Origin, if it was made elsewhere.
    pub source: Option<String>,
    /// Training provenance, if it was made by this program.
    pub made: Option<TrainingProvenance>,
    /// Whether it is part of the program.
    pub shipped: bool,
}

impl WeightsRow {
    /// Returns whether the baseline with this id reads the file.
    pub fn is_for(&self, id: &str) -> bool {
        self.id == id || self.also.iter().any(|other| other == id)
    }
}

/// Provenance of weights that this program trained.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingProvenance {
    /// Training command.
    pub command: String,
    /// Version of the program.
    pub version: String,
    /// Commit of the program, if known.
    pub commit: Option<String>,
    /// Settings that the command does not show.
    pub settings: toml::Table,
    /// Digest of the training data.
    pub data: String,
    /// Random seed.
    pub seed: u64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    #[serde(default)]
    weights: Vec<WeightsRow>,
}

/// Returns all rows of the manifest, in file order.
///
/// # Errors
/// [`ModelError`] if the manifest cannot be read; a test rules it out.
pub fn manifest() -> Result<Vec<WeightsRow>, ModelError> {
    let unreadable = |error| ModelError::Refused(format!("the manifest of weights cannot be read: {error}"));
    toml::from_str::<Manifest>(MANIFEST).map(|m| m.weights).map_err(unreadable)
}

/// Returns the rows of the manifest for a baseline.
fn rows_for(id: &str) -> Result<impl Iterator<Item = WeightsRow>, ModelError> {
    Ok(manifest()?.into_iter().filter(move |row| row.is_for(id)))
}

/// Returns the weights that are part of the program, by file name; none without the feature `weights`.
pub fn embedded() -> impl Iterator<Item = &'static (&'static str, &'static [u8])> {
    let crates = [
        reactsim_weights::SHIPPED,
        #[cfg(feature = "weights")]
        reactsim_weights_smart::SHIPPED,
        #[cfg(feature = "weights")]
        reactsim_weights_catk::SHIPPED,
        #[cfg(feature = "weights")]
        reactsim_weights_diffusion::SHIPPED,
        #[cfg(feature = "weights")]
        reactsim_weights_guarded::SHIPPED,
    ];
    crates.into_iter().flatten()
}

/// Returns the weights that ship for a baseline; `None` without the feature `weights`.
///
/// # Errors
/// [`ModelError`] if manifest and files do not agree; a test rules it out.
pub fn shipped(id: &'static str) -> Result<Option<WeightsFile>, ModelError> {
    if !cfg!(feature = "weights") {
        return Ok(None);
    }
    let Some(row) = rows_for(id)?.find(|row| row.shipped) else { return Ok(None) };
    let Some((_, bytes)) = embedded().find(|(name, _)| *name == row.file) else {
        return Err(ModelError::Refused(format!(
            "the manifest lists the weights {} of `{id}` as shipped, but they are not part of the program",
            row.file
        )));
    };
    let file = WeightsFile::new(row.file, *bytes);
    file.check(id)?;
    Ok(Some(file))
}

/// Returns the weights with this digest if they ship, whichever baseline they are for.
///
/// # Errors
/// [`ModelError`] if the manifest cannot be read; a test rules it out.
pub fn shipped_with_digest(sha256: &str) -> Result<Option<WeightsFile>, ModelError> {
    let row = manifest()?.into_iter().find(|row| row.shipped && row.sha256 == sha256);
    Ok(row.and_then(|row| {
        let (_, bytes) = embedded().find(|(name, _)| *name == row.file)?;
        Some(WeightsFile::new(row.file, *bytes))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digests_are_sha_256() {
        // FIPS 180-2, appendix B.1.
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(WeightsFile::new("abc", b"abc".to_vec()).digest, expected);
    }

    #[test]
    fn a_listed_file_must_have_the_listed_digest() {
        let error = WeightsFile::new("pufferdrive_v2.safetensors", b"abc".to_vec()).check("pufferdrive");
        let text = error.unwrap_err().to_string();
        assert!(text.contains("ba7816bf") && text.contains("d3b1b5ec"), "{text}");
        WeightsFile::new("mine.safetensors", b"abc".to_vec()).check("pufferdrive").unwrap();
    }
}
