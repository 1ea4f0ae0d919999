//! Vocabularies of all classes, from any method.

use reactsim_nn::learning::Provenance;
use reactsim_nn::perception::Class;

use super::file::damaged_provenance;
use super::token_set::corner_distance;
use super::{
    BuildError, Kinematic, ORIGIN, Segments, TOKEN_FRAMES, TOKEN_POSES, TokenPoses, Tokenizer, Vocabulary,
};

/// Mean corner distance in metres from the nearest token above which a kinematic token is added.
const FILL_DISTANCE: f64 = 0.1;

/// Building of whole vocabularies, for every [`Tokenizer`].
pub trait BuildVocabulary: Tokenizer {
    /// Builds the vocabulary of all classes. With `fill`, tokens of the default [`Kinematic`] grid are
    /// added where no other is near, which helps classes and maneuvers with little data; the settings in
    /// the provenance state their number.
    ///
    /// # Errors
    /// [`BuildError`] as for [`Tokenizer::tokens`] (except for missing data with `fill`), and if the tokens
    /// do not form a vocabulary.
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
        let mut settings = self.settings().map_err(damaged_provenance)?;
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

impl<T: Tokenizer + ?Sized> BuildVocabulary for T {}

/// Adds those of `more` that are far from all previous tokens.
fn add_far(class: Class, tokens: &mut Vec<TokenPoses>, more: &[TokenPoses]) {
    let contour = |t: &TokenPoses| class.contour(t[TOKEN_FRAMES]);
    let there: Vec<_> = tokens.iter().map(contour).collect();
    let far = |t: &&TokenPoses| there.iter().all(|c| corner_distance(c, &contour(t)) > 4.0 * FILL_DISTANCE);
    tokens.extend(more.iter().filter(far));
}
