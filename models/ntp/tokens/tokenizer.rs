//! What every way of building a vocabulary has in common.

use super::token_set::corner_distance;
use super::{
    Class, Kinematic, ORIGIN, Provenance, Segments, TOKEN_FRAMES, TOKEN_POSES, TokenPoses, Vocabulary,
    VocabularyError,
};

/// Tokens are added where the nearest is farther than this, mean distance of the corners in metres.
const GAP: f64 = 0.1;

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

    /// The vocabulary of all classes. With `fill`, tokens of the default [`Kinematic`] grid are added where there is none near, which
    /// helps classes and manoeuvres of which little was recorded; the settings in the provenance say how many.
    ///
    /// # Errors
    /// [`BuildError`] as of [`Self::tokens`] (but for missing data with `fill`), and where tokens are no vocabulary.
    fn build_from(&self, segments: &Segments, fill: bool) -> Result<Vocabulary, BuildError> {
        let mut filled = serde_json::Map::new();
        let mut tokens = [Vec::new(), Vec::new(), Vec::new()];
        for class in Class::ALL {
            let tokens = &mut tokens[class.index()];
            *tokens = match self.tokens(class, segments) {
                Err(BuildError::NoData { .. }) if fill => vec![[ORIGIN; TOKEN_POSES]],
                tokens => tokens?,
            };
            if fill {
                let drawn = tokens.len();
                add_far(class, tokens, &Kinematic::default().tokens(class, segments)?);
                filled.insert(class.name().to_owned(), (tokens.len() - drawn).into());
            }
        }
        let mut settings = self.settings().map_err(VocabularyError::Provenance)?;
        if let (Some(settings), true) = (settings.as_object_mut(), fill) {
            settings.insert("filled_with_kinematic".to_owned(), filled.into());
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

/// Adds tokens that are far from all that there were.
fn add_far(class: Class, tokens: &mut Vec<TokenPoses>, more: &[TokenPoses]) {
    let contour = |t: &TokenPoses| class.contour(t[TOKEN_FRAMES]);
    let there: Vec<_> = tokens.iter().map(contour).collect();
    let far = |t: &&TokenPoses| there.iter().all(|c| corner_distance(c, &contour(t)) > 4.0 * GAP);
    tokens.extend(more.iter().filter(far));
}

/// Why no vocabulary can be built.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// A class of which too little was recorded.
    #[error(
        "class `{class}`: {segments} different motions are too few for `{method}`, which needs {needed}; give more \
         scenarios, or take kinematic tokens for it with --fill"
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
