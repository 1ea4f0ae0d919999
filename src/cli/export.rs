//! `reactsim export`: deviated AVs, scenarios and runs for other programs.

mod av;
mod reactsim_bench;
mod scenes;
mod wosac;

use clap::{Args, Subcommand};

use super::output::ExitStatus;

/// Arguments of `export`.
#[derive(Debug, Args)]
pub(super) struct ExportArgs {
    #[command(subcommand)]
    what: Export,
}

#[derive(Debug, Subcommand)]
enum Export {
    /// Write the trajectories of deviated AVs, without anything of the recorded future
    Av(av::ExportAvArgs),
    /// Write the rollouts of a run as files that are named like those of ReactSim-Bench
    ReactsimBench(reactsim_bench::ExportBenchArgs),
    /// Write scenarios as frames that the Python package reads
    Scenes(scenes::ExportScenesArgs),
    /// Write a run in the realism protocol as a submission to the Waymo Open Sim Agents Challenge
    Wosac(wosac::ExportWosacArgs),
}

pub(super) fn export(args: &ExportArgs) -> anyhow::Result<ExitStatus> {
    match &args.what {
        Export::Av(args) => av::export(args),
        Export::ReactsimBench(args) => reactsim_bench::export(args),
        Export::Scenes(args) => scenes::export(args),
        Export::Wosac(args) => wosac::export(args),
    }
}
