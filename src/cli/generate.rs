//! `reactsim generate`: scenarios that the program makes itself.

mod bench;
mod compare;
mod make;
mod manifest;

use anyhow::bail;
use clap::{Args, Subcommand};

use super::ExitStatus;

const AFTER: &str = "\
The preset train writes scenarios as they are generated. The preset bench curates them and keeps
those with a deviated AV, until all categories and map types are there; what was found out about
the deviated AVs is written beside FILE, as `curate` does.

  reactsim generate --preset bench --count 150 --out bench.parquet
  reactsim run bench.parquet
  reactsim curate stats bench.deviations.parquet

The result on stdout says what was made, and how to make it again (TOML).";

/// Arguments of `generate`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true, after_help = AFTER)]
pub(super) struct GenerateArgs {
    #[command(subcommand)]
    command: Option<GenerateCommand>,
    #[command(flatten)]
    make: Option<make::MakeArgs>,
}

#[derive(Debug, Subcommand)]
enum GenerateCommand {
    /// Compare generated logs with recorded ones
    Compare(compare::CompareArgs),
}

pub(super) fn generate(args: &GenerateArgs) -> anyhow::Result<ExitStatus> {
    match (&args.command, &args.make) {
        (Some(GenerateCommand::Compare(args)), _) => compare::compare(args),
        (None, Some(args)) => make::make(args),
        (None, None) => bail!("say what to generate with --preset, --count and --out"),
    }
}
