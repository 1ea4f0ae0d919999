//! `reactsim train`: what networks need and are.

mod new_file;
mod vocabulary;
mod vocabulary_manifest;

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
    /// Build a vocabulary of motion tokens from scenarios
    Vocabulary(vocabulary::VocabularyArgs),
}

pub(super) fn train(args: &TrainArgs) -> anyhow::Result<ExitStatus> {
    match &args.command {
        TrainCommand::Vocabulary(args) => vocabulary::vocabulary(args),
    }
}
