//! `reactsim train`: trains networks on scenarios, and builds vocabularies and intention points.

mod closed_loop;
mod data;
mod intentions;
mod ntp;
mod open_loop;
mod progress;
mod qp_regression;
mod reader;
mod recipe;
mod session;
mod tensor_file;
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
    /// Train the simulator `ntp-reactive` on scenarios of any format
    Ntp(ntp::NtpArgs),
    /// Train the simulator `regression` on scenarios of any format
    QpRegression(qp_regression::QpRegressionArgs),
    /// Measure the prediction errors of the network of `regression` on recorded scenarios
    OpenLoop(open_loop::OpenLoopArgs),
    /// Compute intention points for `train qp-regression` from scenarios
    Intentions(intentions::IntentionsArgs),
    /// Build a vocabulary of motion tokens from scenarios
    Vocabulary(vocabulary::VocabularyArgs),
}

pub(super) fn train(args: &TrainArgs) -> anyhow::Result<ExitStatus> {
    match &args.command {
        TrainCommand::Ntp(args) => ntp::ntp(args),
        TrainCommand::QpRegression(args) => qp_regression::qp_regression(args),
        TrainCommand::OpenLoop(args) => open_loop::open_loop(args),
        TrainCommand::Intentions(args) => intentions::intentions(args),
        TrainCommand::Vocabulary(args) => vocabulary::vocabulary(args),
    }
}
