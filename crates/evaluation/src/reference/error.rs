//! Errors of making, reading and using references.

use std::path::PathBuf;

use reactsim_formats::FormatError;

use crate::error::EvaluationError;

/// The reason why a reference cannot be made, read or used. A run that disagrees with a reference is not an
/// error but the result of a [`super::Verification`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReferenceError {
    /// A folder is not a reference.
    #[error("{place} is not a reference: it has no reference.toml")]
    NoReference {
        /// The folder.
        place: String,
    },
    /// `reference.toml` cannot be read.
    #[error("{place}/reference.toml cannot be read: {source}")]
    Damaged {
        /// The folder.
        place: String,
        /// Underlying error.
        source: toml::de::Error,
    },
    /// A JSON file cannot be read.
    #[error("{place}/{file} cannot be read: {source}")]
    DamagedJson {
        /// The folder.
        place: String,
        /// The file.
        file: String,
        /// Underlying error.
        source: serde_json::Error,
    },
    /// A file of the folder is missing.
    #[error("{place}: the file {file} is missing")]
    MissingFile {
        /// The folder.
        place: String,
        /// The file.
        file: String,
    },
    /// The folder contains a file that does not belong to the reference.
    #[error("{place}: the file {file} does not belong to the reference: reference.toml does not list it")]
    ExtraFile {
        /// The folder.
        place: String,
        /// The file.
        file: String,
    },
    /// A file was changed.
    #[error("{place}: {file} was changed: its digest is {found}, in reference.toml it is {stated}")]
    OtherDigest {
        /// The folder.
        place: String,
        /// The file.
        file: String,
        /// Digest in `reference.toml`.
        stated: String,
        /// Digest of the file.
        found: String,
    },
    /// Two files of a folder do not agree.
    #[error("{files} do not agree: `{field}` is {stated} and {found}")]
    Disagree {
        /// The folder and both files.
        files: String,
        /// Name of the field that differs.
        field: String,
        /// Value in the first file.
        stated: String,
        /// Value in the second file.
        found: String,
    },
    /// A reference, or a run that should become one, does not meet a requirement.
    #[error("{place}: {reason}")]
    Unfit {
        /// The folder.
        place: String,
        /// Reason, and what to do.
        reason: String,
    },
    /// A reference was made by another program or from other inputs than those given.
    #[error("{place}: `{field}` is {stated} in the reference and {found} here{hint}")]
    OtherRun {
        /// The folder.
        place: String,
        /// Name of the field that differs.
        field: String,
        /// Value in the reference.
        stated: String,
        /// Value here.
        found: String,
        /// Suggested remedy; may be empty.
        hint: &'static str,
    },
    /// The folder of a new reference exists and is not empty.
    #[error("{path} exists and is not empty; choose another folder")]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// Files cannot be read or written, or a run is unusable.
    #[error(transparent)]
    Evaluation(#[from] EvaluationError),
}

impl From<FormatError> for ReferenceError {
    fn from(error: FormatError) -> Self {
        Self::Evaluation(error.into())
    }
}
