//! `reactsim study`: several runs on the same scenarios, side by side.

mod carry_out;
mod guards;
mod realism;
mod replan;

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::ExitStatus;
use super::also::Also;
use super::subject::{Subject, Work};

const AFTER: &str = "\
  reactsim study replan --out studies/replan
  reactsim study realism logs/ --deviations d.parquet --out studies/realism
  reactsim study guards --models ntp-reactive,idm --out studies/guards

The folder holds study.json, the table (study.md) and a run folder per member, for `reactsim
report` and `reactsim compare`. An interrupted study goes on with the same command and --resume.";

/// Arguments of `study`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct StudyArgs {
    #[command(subcommand)]
    command: StudyCommand,
}

#[derive(Debug, Subcommand)]
enum StudyCommand {
    /// How often simulators plan anew: collisions with the AV and close calls by interval
    Replan(replan::ReplanArgs),
    /// The reactive protocol beside the realism protocol: reaction, displacement, likelihood of the log
    Realism(realism::RealismArgs),
    /// What each part of the simulators is worth: projection, keeping clear, QP, seeing the AV a step ahead
    Guards(guards::GuardsArgs),
}

/// What all studies are asked.
#[derive(Debug, Args)]
struct Shared {
    #[command(flatten)]
    subject: Subject,
    /// Folder of the study: its table, and a run folder per member
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Continue the study in --out where it was interrupted
    #[arg(long)]
    resume: bool,
    /// Keep the rollouts in the run folders
    #[arg(long)]
    keep_rollouts: bool,
    #[command(flatten)]
    work: Work,
    /// Form of the table on stdout
    #[arg(long, default_value = "markdown", value_parser = ["markdown", "json"])]
    format: String,
    #[command(flatten)]
    also: Also,
}

pub(super) fn study(args: &StudyArgs) -> anyhow::Result<ExitStatus> {
    let (plan, shared) = match &args.command {
        StudyCommand::Replan(args) => (replan::plan(args)?, &args.shared),
        StudyCommand::Realism(args) => (realism::plan(args)?, &args.shared),
        StudyCommand::Guards(args) => (guards::plan(args)?, &args.shared),
    };
    carry_out::carry_out(plan, shared)
}
