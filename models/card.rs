//! Model cards.

use serde::Deserialize;

/// What a baseline says of itself.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Card {
    /// Name in tables.
    pub title: String,
    /// One sentence.
    pub summary: String,
    /// What it moves, per class.
    pub controls: String,
    /// Where method and parameters come from.
    pub sources: Vec<String>,
    /// Its parameters, where it has some.
    #[serde(default)]
    pub parameters: toml::Table,
}

/// Why a card can not be read.
#[derive(Debug, thiserror::Error)]
#[error("the card of `{id}` can not be read: {source}")]
pub struct CardError {
    /// Id of the baseline.
    pub id: &'static str,
    /// Why.
    pub source: toml::de::Error,
}

impl Card {
    /// Reads the text of a card.
    ///
    /// # Errors
    /// [`CardError`] with line and column.
    pub fn read(id: &'static str, text: &str) -> Result<Self, CardError> {
        toml::from_str(text).map_err(|source| CardError { id, source })
    }
}
