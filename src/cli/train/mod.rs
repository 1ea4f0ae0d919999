//! `reactsim train`: what is learned from scenarios.

mod data;
mod ntp;
mod progress;
mod session;

use clap::{Args, Subcommand};

use super::ExitStatus;

/// Arguments of `train`.
#[derive(Debug, Args)]
pub(super) struct TrainArgs {
    #[command(subcommand)]
    command: TrainCommand,
}

#[derive(Debug, Subcommand)]
enum TrainCommand {
    /// Train the simulator `ntp` on scenarios of any format
    Ntp(ntp::NtpArgs),
}

pub(super) fn train(args: &TrainArgs) -> anyhow::Result<ExitStatus> {
    match &args.command {
        TrainCommand::Ntp(args) => ntp::ntp(args),
    }
}
