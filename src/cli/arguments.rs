//! Checks of arguments against each other, for all commands: outputs replace no input and no file of a run
//! folder, and no key has two values. Content that would replace content of another kind is refused where it
//! is written ([`crate::files::NewFile`]).

use std::any::TypeId;
use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::{Arg, ArgMatches};

use super::output::is_same;
use super::urls::{leaf, name_of};
use crate::evaluation::{PROVENANCE, RUN_FILES};
use crate::formats;

/// Ids of the arguments that name what a command writes.
const WRITTEN: &[&str] = &["out", "map_out", "svg", "gif", "html"];
/// Id of the scenarios of a training, which have numbers behind them.
const WEIGHTED: &str = "scenarios";
/// Value name of folders.
const FOLDER: &str = "FOLDER";

/// Refuses outputs that would replace an input, another output or a file of a run folder, and keys that are
/// given twice.
pub(super) fn check(all: &clap::Command, matches: &ArgMatches) -> anyhow::Result<()> {
    let (command, matches) = leaf(all, matches);
    let (mut outputs, mut inputs) = (Vec::<(String, &Path)>::new(), Vec::new());
    for argument in command.get_arguments() {
        let id = argument.get_id().as_str();
        let values: Vec<&OsStr> = matches.try_get_raw(id).ok().flatten().into_iter().flatten().collect();
        check_folders(argument, &values)?;
        check_keys(argument, &values)?;
        if is_written(argument) {
            outputs.extend(values.into_iter().map(|value| (name_of(argument), Path::new(value))));
        } else {
            inputs.extend(values.into_iter().flat_map(|value| read_paths(argument, value)));
        }
    }
    for (at, (name, output)) in outputs.iter().enumerate() {
        let shown = output.display();
        if is_run_file(output) {
            bail!("{name} {shown}: it is a file of a run folder; choose another name");
        }
        if let Some((other, _)) = outputs[..at].iter().find(|(_, earlier)| earlier == output) {
            bail!("{other} and {name} are both {shown}: choose two names");
        }
        if output.is_file() && inputs.iter().any(|input| is_read(input, output)) {
            bail!("{shown} is both input and output; choose another {name}");
        }
    }
    Ok(())
}

/// Refuses a key that has two values: `--set idm.a=1 --set idm.a=2`.
fn check_keys(argument: &Arg, values: &[&OsStr]) -> anyhow::Result<()> {
    let has_keys = argument.get_value_names().is_some_and(|names| names.iter().any(|name| has_key(name)));
    let mut seen = BTreeSet::new();
    for (key, _) in values.iter().filter(|_| has_keys).filter_map(|value| value.to_str()?.split_once('=')) {
        if !seen.insert(key.trim()) {
            bail!("{} has two values for `{}`: give one", name_of(argument), key.trim());
        }
    }
    Ok(())
}

/// Returns whether values of this name have a key: `ID=FILE`, but not `SCENARIOS[=TIMES]`.
fn has_key(name: &str) -> bool {
    name.contains('=') && !name.contains("[=")
}

/// Refuses a file where a folder is written.
fn check_folders(argument: &Arg, values: &[&OsStr]) -> anyhow::Result<()> {
    let is_folder = argument.get_value_names().is_some_and(|names| names.iter().any(|name| name == FOLDER));
    match values.iter().map(Path::new).find(|path| is_folder && path.exists() && !path.is_dir()) {
        Some(path) => bail!("{} {} is a file, expected a folder", name_of(argument), path.display()),
        None => Ok(()),
    }
}

/// Returns whether an argument names what a command writes.
fn is_written(argument: &Arg) -> bool {
    WRITTEN.contains(&argument.get_id().as_str())
}

/// Returns the paths that a value of an argument can mean: `ID=FILE`, `SCENARIOS=TIMES` and `file:PATH` have
/// some.
fn read_paths(argument: &Arg, value: &OsStr) -> Vec<PathBuf> {
    let is_path = argument.get_value_parser().type_id() == TypeId::of::<PathBuf>();
    let whole = (is_path || argument.get_id() == WEIGHTED).then(|| value.to_owned());
    let text = value.to_str().unwrap_or_default();
    let parts = [
        text.split_once('=').map(|(_, path)| path),
        text.rsplit_once('=').map(|(path, _)| path),
        text.split_once("file:").map(|(_, path)| path),
    ];
    whole.into_iter().chain(parts.into_iter().flatten().map(OsString::from)).map(PathBuf::from).collect()
}

/// Returns whether a file is an input, or one of the files of scenarios in a folder that is an input.
fn is_read(input: &Path, file: &Path) -> bool {
    let is_inside = || match (input.canonicalize(), file.canonicalize()) {
        (Ok(input), Ok(file)) => input.is_dir() && file.starts_with(input),
        _ => false,
    };
    let found = || formats::survey(input).map(|found| found.inputs).unwrap_or_default();
    is_same(input, file) || is_inside() && found().iter().any(|found| is_same(&found.path, file))
}

fn is_run_file(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let folder = path.parent().unwrap_or(Path::new(""));
    RUN_FILES.contains(&name.as_ref()) && folder.join(PROVENANCE).exists()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::cli::command_line::command_line;
    use crate::evaluation::Source;
    use crate::formats::native::Writer;

    /// Every writer: the line before its outputs, where `IN` is an input, and the options of the outputs.
    const WRITERS: &[(&str, &[&str])] = &[
        ("inspect IN", &["--svg", "--gif"]),
        ("inspect IN --rollout IN --simulator idm", &["--svg", "--gif"]),
        ("report IN", &["--out"]),
        ("report run --scenarios IN", &["--out"]),
        ("run IN", &["--out"]),
        ("run a --deviations IN", &["--out"]),
        ("run a --av file:IN", &["--out"]),
        ("run a --model-weights idm=IN", &["--out"]),
        ("study replan IN", &["--out"]),
        ("score IN", &["--out"]),
        ("curate IN", &["--out"]),
        ("curate apply IN a", &["--out"]),
        ("curate apply a IN", &["--out"]),
        ("curate review IN", &["--out"]),
        ("convert IN", &["--out"]),
        ("convert a --futures IN --model idm", &["--out"]),
        ("export av IN", &["--out"]),
        ("export reactsim-bench run --deviations IN", &["--out"]),
        ("import reactsim-bench IN --nuplan a", &["--out"]),
        ("export wosac run --scenarios IN --metadata m", &["--out"]),
        ("train regression IN=4", &["--out"]),
        ("train vocabulary IN --method k-disks", &["--out", "--map-out"]),
        ("train intentions IN", &["--out"]),
        ("leaderboard a --scenarios IN", &["--html"]),
        ("merge IN", &["--out"]),
    ];
    /// Writers without a file to read that an output can replace: their inputs are folders or none.
    const OTHERS: [&str; 11] = [
        "generate",
        "man",
        "reference make",
        "train adapt",
        "train quick",
        "train split",
        "study errors",
        "study guards",
        "study planners",
        "study realism",
        "study realism-reactivity",
    ];

    fn refused(line: &str) -> Option<String> {
        let line = format!("reactsim {line}");
        let matches = command_line().try_get_matches_from(line.split(' '));
        let matches = matches.unwrap_or_else(|error| panic!("{line}: {error}"));
        check(&command_line(), &matches).err().map(|error| error.to_string())
    }

    /// Adds the names of the commands that have an output.
    fn writers(command: &clap::Command, name: &str, found: &mut BTreeSet<String>) {
        if command.get_arguments().any(is_written) {
            found.insert(name.to_owned());
        }
        for inner in command.get_subcommands() {
            writers(inner, format!("{name} {}", inner.get_name()).trim(), found);
        }
    }

    #[test]
    fn no_writer_replaces_its_input() {
        let home = tempfile::tempdir().unwrap();
        let input = home.path().join("in.parquet");
        fs::write(&input, "PAR1").unwrap();
        let input = input.to_str().unwrap();
        let mut tested = BTreeSet::new();
        for &(line, options) in WRITERS {
            for option in options {
                let others = options.iter().filter(|other| *other != option && line.starts_with("train"));
                let others: String = others.map(|other| format!(" {other} o")).collect();
                let text = refused(&format!("{line} {option} IN{others}").replace("IN", input));
                let text = text.expect(line);
                let is_folder = text.ends_with("is a file, expected a folder");
                assert!(is_folder || text.ends_with(&format!("choose another {option}")), "{line}: {text}");
            }
            let words: Vec<&str> = line.split(' ').collect();
            tested.extend([words[0].to_owned(), words[..2].join(" ")]);
        }
        tested.extend(OTHERS.map(str::to_owned));
        let mut found = BTreeSet::new();
        writers(&command_line(), "", &mut found);
        let untested: Vec<&String> = found.difference(&tested).collect();
        assert!(untested.is_empty(), "add these writers to the test: {untested:?}");
    }

    #[test]
    fn keys_have_one_value() {
        for line in [
            "run --set idm.a=1 --set idm.a=2",
            "run --metric-option fault_order=nuplan --metric-option fault_order=waymax",
            "run --model-weights a=b --model-weights a=c",
            "compare a b --worse ade=1 --worse ade=2",
            "train regression a --set learning.epochs=1 --set learning.epochs=1",
        ] {
            assert!(refused(line).expect(line).contains("two values for `"), "{line}");
        }
        assert_eq!(refused("run --set idm.a=1 --set idm.b=1"), None);
        assert_eq!(refused("train regression a=1 a=2"), None);
    }

    #[test]
    fn outputs_among_the_files_of_a_folder_and_of_runs_are_refused() {
        let home = tempfile::tempdir().unwrap();
        let path = |name: &str| home.path().join(name).to_str().unwrap().to_owned();
        let mut writer = Writer::create(path("a.parquet")).unwrap();
        for scenario in Source::shipped(1).scenarios().unwrap().take(1) {
            writer.write(&scenario.unwrap()).unwrap();
        }
        writer.finish().unwrap();
        let folder = home.path().to_str().unwrap();
        let of_folder = refused(&format!("convert {folder} --out {}", path("a.parquet"))).unwrap();
        assert!(of_folder.ends_with("is both input and output; choose another --out"), "{of_folder}");
        fs::write(path("picture.svg"), "<svg></svg>").unwrap();
        assert_eq!(refused(&format!("inspect {folder} --svg {}", path("picture.svg"))), None);
        assert_eq!(
            refused("inspect a --svg x --gif x").as_deref(),
            Some("--svg and --gif are both x: choose two names")
        );
        fs::write(path("provenance.json"), "{}").unwrap();
        let of_run = refused(&format!("convert a --out {}", path("rollouts.parquet"))).unwrap();
        assert!(of_run.ends_with("it is a file of a run folder; choose another name"), "{of_run}");
    }
}
