//! Specifications in files.

use std::fs;
use std::path::{Path, PathBuf};

use clap::error::ErrorKind;
use clap::{ArgMatches, Args, Command, FromArgMatches};
use serde::de::DeserializeOwned;

use crate::suggestion::most_similar;

/// Extension of files.
const EXTENSION: &str = "toml";

/// A specification from the command line: that of the file which is named instead of scenarios, or the default one,
/// changed by the options that are given.
#[derive(Clone, Debug)]
pub struct Specification<T>(pub T);

impl<T: Args + Default + DeserializeOwned + NamesScenarios> Args for Specification<T> {
    fn augment_args(command: Command) -> Command {
        // Nothing is required, because the defaults are those of the type.
        T::augment_args_for_update(command)
    }

    fn augment_args_for_update(command: Command) -> Command {
        T::augment_args_for_update(command)
    }
}

/// A type that names scenarios.
pub trait NamesScenarios {
    /// Returns their paths.
    fn paths(&mut self) -> &mut Vec<PathBuf>;
}

impl<T: Args + Default + DeserializeOwned + NamesScenarios> FromArgMatches for Specification<T> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut specification = Self(T::default());
        specification.update_from_arg_matches(matches)?;
        Ok(specification)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        let named: Vec<&PathBuf> = matches.get_many("scenarios").into_iter().flatten().collect();
        let file =
            named.into_iter().find(|path| path.extension().is_some_and(|found| found == EXTENSION)).cloned();
        if let Some(file) = &file {
            let invalid = |error: String| clap::Error::raw(ErrorKind::InvalidValue, error + "\n");
            self.0 = read(file).map_err(invalid)?;
        }
        let from_file = std::mem::take(self.0.paths());
        self.0.update_from_arg_matches(matches)?;
        if file.is_some() {
            let paths = self.0.paths();
            paths.retain(|path| Some(path) != file.as_ref());
            if paths.is_empty() {
                *paths = from_file;
            }
        }
        Ok(())
    }
}

/// Reads a specification.
///
/// # Errors
/// If the file cannot be read, is no TOML, has an unknown key, or a value that does not fit.
fn read<T: Args + DeserializeOwned>(path: &Path) -> Result<T, String> {
    let invalid = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let text = fs::read_to_string(path).map_err(|error| invalid(&error))?;
    let table: toml::Table = toml::from_str(&text).map_err(|error| invalid(&error))?;
    let command = T::augment_args_for_update(Command::new("specification"));
    let name = |argument: &clap::Arg| argument.get_long().unwrap_or(argument.get_id().as_str()).to_owned();
    let names: Vec<String> = command.get_arguments().map(name).collect();
    if let Some(key) = table.keys().find(|key| !names.contains(key)) {
        let meant = most_similar(key, &names).map_or_else(
            || "keys are the long names of the options that determine the results".to_owned(),
            |name| format!("did you mean `{name}`?"),
        );
        return Err(invalid(&format!("`{key}` is not a key; {meant}")));
    }
    table.try_into().map_err(|error| invalid(&error))
}
