//! Recipes (TOML): all settings of a training other than the data and the learner's settings.

use std::fs;
use std::path::Path;

use anyhow::Context;
use serde::de::DeserializeOwned;

/// Reads the recipe in a file, or returns the default one.
pub(super) fn read<R: DeserializeOwned + Default>(path: Option<&Path>) -> anyhow::Result<R> {
    let Some(path) = path else { return Ok(R::default()) };
    let text = fs::read_to_string(path).with_context(|| format!("could not read {}", path.display()))?;
    toml::from_str(&text).with_context(|| format!("{} is not a recipe", path.display()))
}
