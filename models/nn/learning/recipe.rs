//! Recipes: everything that determines the result of a training, other than the data and the seed.

use std::fmt::Write;

use reactsim_baseline::{Allowed, ModelError, ParameterRange, Parameters, Ranges};
use serde::Serialize;
use toml::{Table, Value};

use crate::training::Settings;

/// Units and ranges of the learner's settings, which are part of every recipe (TOML).
pub const LEARNING_RANGES: &str = include_str!("ranges.toml");
/// Table of a recipe with the learner's settings.
pub(crate) const LEARNING: &str = "learning";

/// Returns the values of a recipe: those of the task, and the learner's settings other than the seed.
pub fn recipe_values(recipe: &impl Serialize, learning: &Settings) -> Table {
    let table = |value: Result<Table, toml::ser::Error>| value.expect("recipes are numbers, flags and texts");
    let mut values = table(Table::try_from(recipe));
    let mut learning = table(Table::try_from(learning));
    learning.remove("seed");
    values.insert(LEARNING.to_owned(), Value::Table(learning));
    values
}

/// Combines the values of a recipe with their ranges.
pub(super) fn recipe_parameters(
    id: &'static str,
    values: Table,
    ranges: &str,
) -> Result<Parameters, ModelError> {
    let mut all = Ranges::read(id, ranges)?;
    all.extend_below(LEARNING, Ranges::read(id, LEARNING_RANGES)?);
    let recipe = Parameters::new(id, values, all);
    recipe.check()?;
    Ok(recipe)
}

/// Returns a recipe as a document (TOML) that states every value, with unit, range and meaning.
///
/// # Errors
/// [`ModelError`] for a value without a range.
pub fn recipe_document(recipe: &Parameters) -> Result<String, ModelError> {
    let mut rows = recipe.ranges()?;
    // Values without a table come first, since a heading holds until the next one.
    rows.sort_by(|(a, ..), (b, ..)| (table_of(a), a).cmp(&(table_of(b), b)));
    let (mut text, mut heading) = (String::new(), "");
    for (key, value, range) in &rows {
        let table = table_of(key);
        if table != heading {
            write!(text, "\n[{table}]\n").ok();
            heading = table;
        }
        let name = &key[table.len()..].trim_start_matches('.');
        writeln!(text, "# {} {}\n{name} = {value}", range.about, describe(range)).ok();
    }
    Ok(text.trim_start().to_owned())
}

/// Returns the dotted path of the table that a value is in; empty at the top.
fn table_of(key: &str) -> &str {
    key.rsplit_once('.').map_or("", |(table, _)| table)
}

/// Returns the range as a sentence.
fn describe(range: &ParameterRange) -> String {
    if let Allowed::Texts(texts) = &range.allowed {
        return format!("One of {}.", texts.join(", "));
    }
    let text = range.to_string();
    let mut letters = text.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}.", letters.as_str())
}
