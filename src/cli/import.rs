//! `reactsim import`: deviated AVs of other data sets.

mod reactsim_bench;

use clap::{Args, Subcommand};

use super::output::ExitStatus;

/// Arguments of `import`.
#[derive(Debug, Args)]
pub(super) struct ImportArgs {
    #[command(subcommand)]
    what: Import,
}

#[derive(Debug, Subcommand)]
enum Import {
    /// Read the deviated AVs of ReactSim-Bench, and find their scenarios in the logs of nuPlan
    ReactsimBench(reactsim_bench::ImportBenchArgs),
}

pub(super) fn import(args: &ImportArgs) -> anyhow::Result<ExitStatus> {
    match &args.what {
        Import::ReactsimBench(args) => reactsim_bench::import(args),
    }
}
