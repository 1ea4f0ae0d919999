//! What every way of building a vocabulary has in common.

use super::{Class, Kinematic, Provenance, Segments, TokenPoses, Vocabulary, VocabularyError};

/// A way of building vocabularies.
pub trait Tokenizer {
    /// Its name, as on the command line and in files.
    fn method(&self) -> &'static str;

    /// Its settings, as files keep them.
    ///
    /// # Errors
    /// What can not be written as JSON.
    fn settings(&self) -> Result<serde_json::Value, serde_json::Error>;

    /// The tokens of one class.
    ///
    /// # Errors
    /// [`BuildError`] where there are not enough motions, or a setting is out of range.
    fn tokens(&self, class: Class, segments: &Segments) -> Result<Vec<TokenPoses>, BuildError>;

    /// The vocabulary of all classes. With `fill`, classes without data get the tokens of the default [`Kinematic`] grid, which the
    /// provenance says.
    ///
    /// # Errors
    /// [`BuildError`] as of [`Self::tokens`], and where tokens are no vocabulary.
    fn build_from(&self, segments: &Segments, fill: bool) -> Result<Vocabulary, BuildError> {
        let mut filled = Vec::new();
        let mut tokens = [Vec::new(), Vec::new(), Vec::new()];
        for class in Class::ALL {
            tokens[class.index()] = match self.tokens(class, segments) {
                Err(BuildError::NoData { .. }) if fill => {
                    filled.push(class.name());
                    Kinematic::default().tokens(class, segments)?
                }
                tokens => tokens?,
            };
        }
        let mut settings = self.settings().map_err(VocabularyError::Provenance)?;
        if let (Some(settings), false) = (settings.as_object_mut(), filled.is_empty()) {
            settings.insert("kinematic_for".to_owned(), filled.into());
        }
        let provenance = Provenance {
            method: self.method().to_owned(),
            settings,
            seed: segments.seed(),
            scenarios: segments.scenarios(),
            data: segments.digest(),
        };
        Ok(Vocabulary::new(tokens, provenance)?)
    }
}

/// Why no vocabulary can be built.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// A class of which too little was recorded.
    #[error(
        "class `{class}`: {segments} different motions are too few for `{method}`, which needs {needed}; give more \
         scenarios, or take the kinematic tokens for it with --fill"
    )]
    NoData {
        /// The class.
        class: Class,
        /// Motions that there are.
        segments: usize,
        /// The builder.
        method: &'static str,
        /// What it needs.
        needed: String,
    },
    /// A setting out of range.
    #[error("setting `{name}` of `{method}` is {value}, expected {expected}")]
    Setting {
        /// The builder.
        method: &'static str,
        /// The setting.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// The tokens are no vocabulary.
    #[error(transparent)]
    Vocabulary(#[from] VocabularyError),
}
