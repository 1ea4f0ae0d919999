//! Common interface of the vocabulary builders.

use reactsim_nn::perception::Class;

use super::{BuildError, Segments, TokenPoses};

/// A method of building vocabularies.
pub trait Tokenizer {
    /// Returns its name, as on the command line and in files.
    fn method(&self) -> &'static str;

    /// Returns its settings, as stored in files.
    ///
    /// # Errors
    /// Errors of serialization to JSON.
    fn settings(&self) -> Result<serde_json::Value, serde_json::Error>;

    /// Builds the tokens of one class.
    ///
    /// # Errors
    /// [`BuildError`] if there are not enough motions, or a setting is out of range.
    fn tokens(&self, class: Class, segments: &Segments) -> Result<Vec<TokenPoses>, BuildError>;
}
