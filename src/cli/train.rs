//! `reactsim train`: trains networks on scenarios, and prepares what trainings need.

mod adapt;
mod closed_loop;
mod data;
mod deviated;
mod exclusion;
mod intentions;
mod open_loop;
mod progress;
mod quick;
mod reader;
mod recipe;
mod session;
mod split;
mod task;
mod tensor_file;
mod vocabulary;
mod vocabulary_manifest;

use clap::{Args, Subcommand};

use super::output::ExitStatus;

const AFTER: &str = "\
`reactsim list tasks` names tasks, their recipes and the files that they can be given. A recipe is a \
TOML file that states what differs from the defaults; --print-recipe prints all values with units and \
ranges.

Scenarios of known benchmarks are refused.

Examples:
  reactsim generate --preset train --count 2000 --out logs.parquet
  reactsim train ntp-reactive logs.parquet --recipe quick --out training
  reactsim run --models idm,ntp-reactive --model-weights ntp-reactive=training/weights.safetensors
  reactsim train ntp-reactive --print-recipe";

/// Arguments of `train`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true, after_help = AFTER)]
pub(super) struct TrainArgs {
    #[command(subcommand)]
    command: Option<TrainCommand>,
    #[command(flatten)]
    task: task::TaskArgs,
}

#[derive(Debug, Subcommand)]
enum TrainCommand {
    /// Make data, train a small network and show it in the table, in a few minutes
    Quick(quick::QuickArgs),
    /// Adapt a shipped network to logs and show what it gains, in a few minutes
    Adapt(adapt::AdaptArgs),
    /// Divide scenarios into parts, such as training and validation
    Split(split::SplitArgs),
    /// Measure the prediction errors of the network of `regression` on recorded scenarios
    OpenLoop(open_loop::OpenLoopArgs),
    /// Compute intention points for the task `qp-regression` from scenarios
    Intentions(intentions::IntentionsArgs),
    /// Build a vocabulary of motion tokens from scenarios
    Vocabulary(vocabulary::VocabularyArgs),
}

pub(super) fn train(args: &TrainArgs) -> anyhow::Result<ExitStatus> {
    match &args.command {
        Some(TrainCommand::Quick(args)) => quick::quick(args),
        Some(TrainCommand::Adapt(args)) => adapt::adapt(args),
        Some(TrainCommand::Split(args)) => split::split(args),
        Some(TrainCommand::OpenLoop(args)) => open_loop::open_loop(args),
        Some(TrainCommand::Intentions(args)) => intentions::intentions(args),
        Some(TrainCommand::Vocabulary(args)) => vocabulary::vocabulary(args),
        None => task::task(&args.task),
    }
}
