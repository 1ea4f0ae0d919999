//! Why a reference cannot be made, read or used.

use std::path::PathBuf;

use crate::evaluation::EvaluationError;
use crate::formats::FormatError;

/// Why a reference cannot be made, read or used. A run that disagrees with a reference is no error but a
/// [`super::Verification`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReferenceError {
    /// A folder is no reference.
    #[error("{place} is no reference: it has no reference.toml")]
    NoReference {
        /// The folder.
        place: String,
    },
    /// `reference.toml` cannot be read.
    #[error("{place}/reference.toml can not be read: {source}")]
    Damaged {
        /// The folder.
        place: String,
        /// Why.
        source: toml::de::Error,
    },
    /// A JSON file cannot be read.
    #[error("{place}/{file} can not be read: {source}")]
    DamagedJson {
        /// The folder.
        place: String,
        /// The file.
        file: String,
        /// Why.
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
    /// A file is in the folder that does not belong to the reference.
    #[error("{place}: the file {file} does not belong to the reference: reference.toml does not list it")]
    ExtraFile {
        /// The folder.
        place: String,
        /// The file.
        file: String,
    },
    /// A file was changed.
    #[error("{place}: {file} was changed: its digest is {found}, reference.toml states {stated}")]
    OtherDigest {
        /// The folder.
        place: String,
        /// The file.
        file: String,
        /// Digest that the reference states.
        stated: String,
        /// Digest of the file.
        found: String,
    },
    /// Two files of a folder do not agree.
    #[error("{files} do not agree: `{field}` is {stated} and {found}")]
    Disagree {
        /// The folder and both files.
        files: String,
        /// What differs.
        field: String,
        /// Value in the first file.
        stated: String,
        /// Value in the second file.
        found: String,
    },
    /// A reference, or a run that should become one, is not what a reference must be.
    #[error("{place}: {reason}")]
    Unfit {
        /// The folder.
        place: String,
        /// Why, and what to do.
        reason: String,
    },
    /// A reference was made by another program or from other inputs than those at hand.
    #[error("{place}: `{field}` is {stated} in the reference and {found} here{mend}")]
    OtherRun {
        /// The folder.
        place: String,
        /// What differs.
        field: String,
        /// Value in the reference.
        stated: String,
        /// Value here.
        found: String,
        /// What to do; empty where that is plain.
        mend: &'static str,
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
