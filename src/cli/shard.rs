//! `reactsim shard`: commands in units, for clusters.

mod estimate;
mod merge;
mod planned;
mod run;
mod status;

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::ExitStatus;

/// Arguments of `shard`.
#[derive(Debug, Args)]
pub(super) struct ShardArgs {
    #[command(subcommand)]
    command: ShardCommand,
}

#[derive(Debug, Subcommand)]
enum ShardCommand {
    /// Divide a command into units
    Plan(planned::PlanArgs),
    /// Run units; may be called by any number of processes on any machines that share the folder
    Run(run::UnitArgs),
    /// Show which units are finished
    Status(FolderArgs),
    /// Merge the results of all units into the output that one machine would have written
    Merge(FolderArgs),
}

/// The folder of units.
#[derive(Debug, Args)]
struct FolderArgs {
    /// Folder of the plan and the units
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
}

pub(super) fn shard(args: ShardArgs) -> anyhow::Result<ExitStatus> {
    match args.command {
        ShardCommand::Plan(args) => planned::plan(&args),
        ShardCommand::Run(args) => run::run(&args),
        ShardCommand::Status(args) => status::status(&args.folder),
        ShardCommand::Merge(args) => merge::merge(&args.folder),
    }
}
