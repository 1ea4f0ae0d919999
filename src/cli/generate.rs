//! `reactsim generate`: scenarios that the program makes itself.

mod compare;
mod make;

use anyhow::bail;
use clap::{Args, Subcommand};

use super::ExitStatus;

const AFTER: &str = "\
`--preset train` writes the scenarios as they are generated. `--preset bench` curates them and keeps
those for which a deviated AV is found, with the categories in the paper's proportions and every map
type; what else was found out about the deviated AVs is written beside FILE, as `curate` does.

  reactsim generate --preset bench --count 150 --out bench.parquet
  reactsim run bench.parquet
  reactsim curate stats bench.deviations.parquet

On stdout stands what FILE was made from, with its digest (TOML).";

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
