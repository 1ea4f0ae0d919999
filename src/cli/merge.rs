//! `reactsim merge`: joins the partitions of a command.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::{Args, FromArgMatches};

use super::partition::{Partitions, refuse_filled};
use super::{Cli, Command, ExitStatus, command_line, curate, generate, run, score, study};

const AFTER: &str = "\
Example:
  reactsim run LOGS --models idm --partition 1/2 --out part1
  reactsim run LOGS --models idm --partition 2/2 --out part2
  reactsim merge part1 part2 --out runs/idm

The output is byte-identical to that of the command without --partition.";

/// Arguments of `merge`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct MergeArgs {
    /// Folders of all partitions, in any order
    #[arg(required = true, value_name = "FOLDERS")]
    folders: Vec<PathBuf>,
    /// Folder or file to write, as --out of the whole command
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
}

pub(super) fn merge(args: MergeArgs) -> anyhow::Result<ExitStatus> {
    let (partitions, out) = (Partitions::read(&args.folders)?, args.out);
    refuse_filled(&out)?;
    let arguments = std::iter::once("reactsim").chain(partitions.arguments().iter().map(String::as_str));
    let parsed = command_line()
        .try_get_matches_from(arguments)
        .and_then(|matches| Cli::from_arg_matches(&matches))
        .context("the arguments in partition.json are not those of this program")?;
    match parsed.command {
        Some(Command::Run(args)) => run::merge(args, &partitions, out),
        Some(Command::Study(args)) => study::merge(&args, &partitions, &out),
        Some(Command::Curate(args)) => curate::merge(args, &partitions, out),
        Some(Command::Generate(args)) => generate::merge(args, &partitions, out),
        Some(Command::Score(args)) => score::merge(args, &partitions, out),
        _ => bail!("partition.json is damaged: it has another command"),
    }
}
