//! Arguments that are URLs: scenarios and deviated AVs are read from URLs, everything else is a path.

use std::any::TypeId;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use clap::ArgMatches;
use clap::error::ErrorKind;

use crate::files::as_url;

/// Ids of the arguments that may be URLs: scenarios and deviated AVs.
const READ: &[&str] =
    &["scenarios", "scenario", "inputs", "deviations", "certificates", "generated", "reference"];

/// Returns the innermost subcommand that is given, with its arguments.
pub(super) fn leaf<'a>(
    mut command: &'a clap::Command,
    mut matches: &'a ArgMatches,
) -> (&'a clap::Command, &'a ArgMatches) {
    while let Some((name, inner)) = matches.subcommand() {
        let Some(found) = command.find_subcommand(name) else { break };
        (command, matches) = (found, inner);
    }
    (command, matches)
}

/// Refuses URLs where a path of a file system is needed. There they would be
/// relative paths with a folder `s3:`.
pub(super) fn check(all: &clap::Command, matches: &ArgMatches) -> Result<(), clap::Error> {
    let (command, matches) = leaf(all, matches);
    for argument in command.get_arguments() {
        let id = argument.get_id().as_str();
        let values: Vec<_> = matches.try_get_raw(id).ok().flatten().into_iter().flatten().collect();
        // Other texts may have a prefix, such as `file:/path`.
        let is_path = argument.get_value_parser().type_id() == TypeId::of::<PathBuf>();
        let lost = values.iter().find_map(|value| with_lost_slash(value)).filter(|_| is_path);
        if let Some((scheme, rest)) = lost {
            let text = format!("`{scheme}:/{rest}` is no URL: write `{scheme}://{rest}`\n");
            return Err(all.clone().error(ErrorKind::ValueValidation, text));
        }
        let Some(url) = values.into_iter().filter_map(|value| as_url(Path::new(value))).next() else {
            continue;
        };
        if !READ.contains(&id) {
            return Err(refuse(all, argument, url));
        }
    }
    Ok(())
}

/// Returns scheme and rest of a URL that was treated as a path, which loses one of two slashes; Python's
/// `Path` does this. `None` for other texts, and if there is such a folder.
fn with_lost_slash(value: &OsStr) -> Option<(&str, &str)> {
    let (scheme, rest) = value.to_str()?.split_once(":/")?;
    let is_url = as_url(Path::new(&format!("{scheme}://{rest}"))).is_some();
    let is_lost = is_url && !rest.starts_with('/') && !Path::new(&format!("{scheme}:")).exists();
    is_lost.then_some((scheme, rest))
}

/// Returns the name of an argument as the user writes it.
pub(super) fn name_of(argument: &clap::Arg) -> String {
    match (argument.get_long(), argument.get_value_names()) {
        (Some(long), _) => format!("--{long}"),
        (None, Some([name, ..])) => name.to_string(),
        (None, _) => argument.get_id().to_string(),
    }
}

fn refuse(all: &clap::Command, argument: &clap::Arg, url: &str) -> clap::Error {
    let text = format!(
        "{} is the URL `{url}`, where a path is needed; only scenarios, deviated AVs and weights are \
         read from URLs. Write results to a file system, and copy them\n",
        name_of(argument)
    );
    all.clone().error(ErrorKind::ValueValidation, text)
}

#[cfg(test)]
mod tests {
    use crate::cli::command_line::command_line;

    fn refused(line: &str) -> Option<String> {
        let matches = command_line().try_get_matches_from(line.split(' ')).unwrap();
        super::check(&command_line(), &matches).err().map(|error| error.to_string())
    }

    #[test]
    fn urls_are_refused_where_paths_are_needed() {
        for (line, name) in [
            ("reactsim run a --out s3://b/c", "--out"),
            ("reactsim run gs://a --out=s3://b/c", "--out"),
            ("reactsim convert gs://a --out gs://b/c.parquet", "--out"),
            ("reactsim report s3://b/run", "RUN"),
            ("reactsim merge s3://b/part --out c", "FOLDERS"),
            ("reactsim inspect a --svg memory://x.svg", "--svg"),
            ("reactsim score s3://b/rollouts.parquet --scenarios s3://a", "ROLLOUTS"),
            ("reactsim curate review s3://b/candidates.parquet", "FILE"),
        ] {
            let text = refused(line).expect(line);
            assert!(text.contains(&format!("{name} is the URL `")), "{line}: {text}");
        }
        let text = refused("reactsim run s3:/a/b --out c").unwrap();
        assert!(text.contains("write `s3://a/b`"), "{text}");
    }

    #[test]
    fn scenarios_and_deviations_are_read_from_urls() {
        for line in [
            "reactsim run s3://a gs://b --deviations https://c/d --out e",
            "reactsim convert s3://a --out b --certificates s3://c",
            "reactsim curate s3://a --out b",
            "reactsim inspect s3://a",
            "reactsim export scenes s3://a",
            "reactsim score rollouts.parquet --scenarios s3://a",
            "reactsim verify folder --scenarios s3://a",
            "reactsim train split s3://a --part train=0.9 --out b",
            "reactsim run a --av file:/b/c.parquet",
        ] {
            assert_eq!(refused(line), None, "{line}");
        }
    }
}
