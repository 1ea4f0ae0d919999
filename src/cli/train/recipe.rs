//! Recipes: a shipped one or a file, and single changes.

use std::fmt::Display;
use std::path::Path;

use anyhow::{Context, anyhow, bail};
use clap::Args;
use toml::Table;

use crate::evaluation::suggestion::{did_you_mean, most_similar};
use crate::files::read_regular;
use crate::models::learning::TrainingTask;
use crate::models::{ModelError, Parameters};

/// Arguments that determine the recipe.
#[derive(Debug, Default, Args)]
pub(super) struct RecipeArgs {
    /// Recipe: the name of a shipped one, or a file (TOML) [default: the default values]
    #[arg(long, value_name = "NAME|FILE")]
    pub(super) recipe: Option<String>,
    /// Change a value of the recipe, such as learning.epochs=2; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,
}

impl RecipeArgs {
    /// Returns the arguments of a recipe without changes, by its name or file.
    pub(super) fn of(recipe: impl Display) -> Self {
        Self { recipe: Some(recipe.to_string()), set: Vec::new() }
    }

    /// Returns the values of the recipe.
    pub(super) fn read(&self, task: &TrainingTask) -> anyhow::Result<Parameters> {
        let mut recipe = task.recipe()?;
        if let Some(name) = &self.recipe {
            let merged = recipe.merge(&changes(name, task)?).map_err(|error| suggested(error, &recipe));
            merged.with_context(|| format!("the recipe {name}"))?;
        }
        for text in &self.set {
            let Some((key, value)) = text.split_once('=') else {
                bail!("--set `{text}`: write KEY=VALUE, such as learning.epochs=2");
            };
            recipe.set(key.trim(), value.trim()).map_err(|error| suggested(error, &recipe))?;
        }
        Ok(recipe)
    }
}

/// Returns the error with the most similar name in place of all names, if a name is unknown and one is
/// similar.
fn suggested(error: ModelError, recipe: &Parameters) -> anyhow::Error {
    let ModelError::UnknownParameter { id, key, .. } = &error else { return error.into() };
    let keys = recipe.ranges().unwrap_or_default().into_iter().map(|(key, ..)| key);
    match most_similar(key, keys) {
        Some(meant) => anyhow!("`{id}` has no parameter `{key}`; did you mean `{meant}`?"),
        None => error.into(),
    }
}

/// Returns what a recipe states.
fn changes(name: &str, task: &TrainingTask) -> anyhow::Result<Table> {
    let path = Path::new(name);
    let text = match task.recipes.iter().find(|recipe| recipe.name == name) {
        Some(shipped) => shipped.text.to_owned(),
        None if path.exists() || name.contains(['.', '/']) => {
            let read = || format!("could not read {name}");
            String::from_utf8(read_regular(path).with_context(read)?).with_context(read)?
        }
        None => {
            let known: Vec<&str> = task.recipes.iter().map(|recipe| recipe.name).collect();
            let meant = did_you_mean(name, known.iter().copied());
            let known =
                if known.is_empty() { "has none".to_owned() } else { format!("has {}", known.join(", ")) };
            bail!("there is no recipe `{name}` and no file of this name; `{}` {known}{meant}", task.id)
        }
    };
    toml::from_str(&text).with_context(|| format!("{name} is not a recipe"))
}
