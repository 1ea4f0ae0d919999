//! `reactsim export`: runs in the formats of others.

mod wosac;

use clap::{Args, Subcommand};

use super::ExitStatus;

/// Arguments of `export`.
#[derive(Debug, Args)]
pub(super) struct ExportArgs {
    #[command(subcommand)]
    what: Export,
}

#[derive(Debug, Subcommand)]
enum Export {
    /// Write a run in the realism protocol as a submission to the Waymo Open Sim Agents Challenge
    Wosac(wosac::ExportWosacArgs),
}

pub(super) fn export(args: &ExportArgs) -> anyhow::Result<ExitStatus> {
    match &args.what {
        Export::Wosac(args) => wosac::export(args),
    }
}
