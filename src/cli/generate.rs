//! `reactsim generate`: synthetic scenarios.

mod bench;
mod compare;
mod files;
mod make;
mod manifest;
mod scenario_file;
mod tried;
mod units;

use anyhow::bail;
use clap::{Args, Subcommand};

use super::ExitStatus;

const AFTER: &str = "\
The preset train writes scenarios as they are generated. The preset sensed makes traffic with the \
speeds of recordings, and adds the noise and the gaps of sensors. The preset bench curates \
scenarios and keeps those with a deviated AV until the quotas of all categories and map types are \
filled. It writes the candidates, as `curate` does, to a second file next to FILE.

Examples:
  reactsim generate --preset bench --count 150 --out bench.parquet
  reactsim run bench.parquet
  reactsim curate stats bench.deviations.parquet

The manifest entry of the files is printed to stdout (TOML): command, settings and digests.";

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
        (None, None) => bail!("give --preset, --count and --out to generate scenarios"),
    }
}
