//! Recipes (TOML): all settings of a training other than the data and the learner's settings.

use std::path::Path;

use anyhow::Context;
use serde::de::DeserializeOwned;

use crate::files::read_regular;

/// Reads the recipe in a file, or returns the default one.
pub(super) fn read<R: DeserializeOwned + Default>(path: Option<&Path>) -> anyhow::Result<R> {
    let Some(path) = path else { return Ok(R::default()) };
    let read = || format!("could not read {}", path.display());
    let text = String::from_utf8(read_regular(path).with_context(read)?).with_context(read)?;
    toml::from_str(&text).with_context(|| format!("{} is not a recipe", path.display()))
}
