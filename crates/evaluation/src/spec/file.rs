//! Specifications in files.

use std::fs;
use std::path::{Path, PathBuf};

use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command, FromArgMatches};
use reactsim_files::as_url;

use super::{NuplanSpec, RunSpec, SubjectSpec};
use crate::av::AvChoice;
use crate::suggestion::most_similar;

/// Extension of files.
const EXTENSION: &str = "toml";

/// A specification from the command line: that of the file which is named instead of scenarios, or the default one,
/// changed by the options that are given.
#[derive(Clone, Debug)]
pub struct Specification {
    /// The specification.
    pub value: RunSpec,
    /// Ids of the options on the command line.
    pub given: Vec<String>,
}

impl Args for Specification {
    fn augment_args(command: Command) -> Command {
        // Nothing is required, because the defaults are those of the type.
        RunSpec::augment_args_for_update(command)
    }

    fn augment_args_for_update(command: Command) -> Command {
        RunSpec::augment_args_for_update(command)
    }
}

impl FromArgMatches for Specification {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut specification = Self { value: RunSpec::default(), given: Vec::new() };
        specification.update_from_arg_matches(matches)?;
        Ok(specification)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        let named: Vec<&PathBuf> = matches.get_many("scenarios").into_iter().flatten().collect();
        let file =
            named.into_iter().find(|path| path.extension().is_some_and(|found| found == EXTENSION)).cloned();
        let invalid = |error: String| clap::Error::raw(ErrorKind::InvalidValue, error + "\n");
        if let Some(file) = &file {
            self.value = read(file).map_err(invalid)?;
        }
        let from_file = std::mem::take(&mut self.value.subject.input.scenarios);
        self.value.update_from_arg_matches(matches)?;
        let is_given = |id: &&str| matches.value_source(id) == Some(ValueSource::CommandLine);
        self.given = matches.ids().map(clap::Id::as_str).filter(is_given).map(str::to_owned).collect();
        if file.is_some() {
            let paths = &mut self.value.subject.input.scenarios;
            paths.retain(|path| Some(path) != file.as_ref());
            if paths.is_empty() {
                *paths = from_file;
            }
        }
        self.value.check_values().map_err(|error| {
            let of_file = file.map_or_else(String::new, |file| format!("{}: ", file.display()));
            invalid(format!("{of_file}{error}"))
        })
    }
}

impl RunSpec {
    /// Changes the paths of all files; URLs remain.
    pub(crate) fn change_paths(&mut self, change: &dyn Fn(&Path) -> PathBuf) {
        let SubjectSpec { input, model_weights, av, .. } = &mut self.subject;
        let NuplanSpec { nuplan, filter, maps } = &mut input.reading.nuplan;
        let files = [&mut input.deviations, filter, maps];
        let all = input.scenarios.iter_mut().chain(nuplan).chain(files.into_iter().flatten());
        let of_av = av.iter_mut().filter_map(|av| match av {
            AvChoice::File(path) => Some(path),
            _ => None,
        });
        for path in all.chain(of_av).filter(|path| as_url(path).is_none()) {
            *path = change(path);
        }
        for text in model_weights {
            if let Some((id, file)) = text.split_once('=') {
                *text = format!("{id}={}", change(Path::new(file)).display());
            }
        }
    }
}

/// Reads a specification, whose paths are relative to the folder of the file.
///
/// # Errors
/// If the file cannot be read, is no TOML, has an unknown key, or a value that does not fit.
pub(crate) fn read(path: &Path) -> Result<RunSpec, String> {
    let invalid = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let text = fs::read_to_string(path).map_err(|error| invalid(&error))?;
    let table: toml::Table = toml::from_str(&text).map_err(|error| invalid(&error))?;
    let names = keys();
    if let Some(key) = table.keys().find(|key| !names.contains(key)) {
        let keys = "keys are the long names of the options that determine the results";
        return Err(invalid(&unknown_key(key, &names, keys)));
    }
    // Errors of flattened structs do not name the key, so every key is first read by itself.
    for (key, value) in &table {
        let alone = toml::Table::from_iter([(key.clone(), value.clone())]);
        alone.try_into::<RunSpec>().map_err(|error| invalid(&format!("{key}: {}", error.message())))?;
    }
    let mut specification: RunSpec = table.try_into().map_err(|error| invalid(&error))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    specification.change_paths(&|path| folder.join(path));
    Ok(specification)
}

/// Returns the keys of a specification.
pub(super) fn keys() -> Vec<String> {
    names(&RunSpec::augment_args_for_update(Command::new("specification")))
}

/// Returns the keys that the arguments of a command are.
pub(super) fn names(command: &Command) -> Vec<String> {
    let name = |argument: &clap::Arg| argument.get_long().unwrap_or(argument.get_id().as_str()).to_owned();
    command.get_arguments().map(name).collect()
}

/// Returns the refusal of a key that is not among these: the one that was meant, or what keys are.
pub(super) fn unknown_key(key: &str, names: &[String], keys: &str) -> String {
    let meant =
        most_similar(key, names).map_or_else(|| keys.to_owned(), |name| format!("did you mean `{name}`?"));
    format!("`{key}` is not a key; {meant}")
}
