//! Model cards.

use serde::Deserialize;

use super::ModelError;

/// Description of a baseline.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Card {
    /// Name shown in tables.
    pub title: String,
    /// One-sentence summary.
    pub summary: String,
    /// Agents it moves, per class.
    pub controls: String,
    /// Sources of the method and its parameters.
    pub sources: Vec<String>,
    /// Parameters; empty if there are none.
    #[serde(default)]
    pub parameters: toml::Table,
}

impl Card {
    /// Parses the text of a card.
    ///
    /// # Errors
    /// [`ModelError`] with line and column.
    pub fn read(id: &str, text: &str) -> Result<Self, ModelError> {
        toml::from_str(text).map_err(|error| unreadable(id, &error))
    }
}

/// Refuses a card, or parameters that do not have the form that its baseline needs.
pub(super) fn unreadable(id: &str, error: &toml::de::Error) -> ModelError {
    ModelError::Refused(format!("the card of `{id}` cannot be read: {error}"))
}
