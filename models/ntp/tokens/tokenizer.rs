//! Common interface of the vocabulary builders.

use reactsim_nn::perception::Class;

use super::token_set::corner_distance;
use super::{BuildError, Kinematic, ORIGIN, Segments, TOKEN_FRAMES, TOKEN_POSES, TokenPoses, Vocabulary};

/// Mean corner distance in metres from the nearest token above which a kinematic token is added.
const FILL_DISTANCE: f64 = 0.1;

/// A method of building vocabularies.
pub trait Tokenizer {
    /// Returns its name, as on the command line and in files.
    fn method(&self) -> &'static str;

    /// Returns its settings, as stored in files.
    fn settings(&self) -> serde_json::Value;

    /// Builds the tokens of one class.
    ///
    /// # Errors
    /// [`BuildError`] if there are not enough motions, or a setting is out of range.
    fn tokens(&self, class: Class, segments: &Segments) -> Result<Vec<TokenPoses>, BuildError>;

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
        let mut settings = self.settings();
        if let (Some(settings), true) = (settings.as_object_mut(), fill) {
            settings.insert("filled_with_kinematic".to_owned(), filled.into());
        }
        let provenance = segments.scenarios.provenance(self.method(), settings, segments.seed());
        Ok(Vocabulary::new(tokens, provenance)?)
    }
}

/// Adds those of `more` that are far from all previous tokens.
fn add_far(class: Class, tokens: &mut Vec<TokenPoses>, more: &[TokenPoses]) {
    let contour = |t: &TokenPoses| class.contour(t[TOKEN_FRAMES]);
    let there: Vec<_> = tokens.iter().map(contour).collect();
    let far = |t: &&TokenPoses| there.iter().all(|c| corner_distance(c, &contour(t)) > 4.0 * FILL_DISTANCE);
    tokens.extend(more.iter().filter(far));
}
