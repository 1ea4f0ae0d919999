//! Model cards.

use serde::Deserialize;

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

/// Error from reading a card.
#[derive(Debug, thiserror::Error)]
#[error("the card of `{id}` cannot be read: {source}")]
pub struct CardError {
    /// Id of the baseline.
    pub id: &'static str,
    /// Cause.
    pub source: toml::de::Error,
}

impl Card {
    /// Parses the text of a card.
    ///
    /// # Errors
    /// [`CardError`] with line and column.
    pub fn read(id: &'static str, text: &str) -> Result<Self, CardError> {
        toml::from_str(text).map_err(|source| CardError { id, source })
    }
}
