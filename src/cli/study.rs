//! `reactsim study`: several runs on the same scenarios, side by side.

mod carry_out;
mod errors;
mod guards;
mod planners;
mod realism;
mod replan;

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::inputs::sources;
use super::output::ExitStatus;
use super::partition::{PartitionArg, Partitions};
use super::subject::{self, ExecutionArgs};
use super::table_output::ColumnArgs;
use crate::evaluation::{
    ExternalPrograms, Opening, PlannedSimulator, RolloutSpec, RunSpec, Source, Specification, StudyPlan,
    SubjectSpec,
};
use crate::external::RunOutline;
use crate::rollout::Replan;

const AFTER: &str = "\
Examples:
  reactsim study replan --out studies/replan
  reactsim study realism logs/ --deviations d.parquet --out studies/realism
  reactsim study guards --models ntp-reactive,idm --out studies/guards
  reactsim study planners --models log-replay,idm --out studies/planners
  reactsim study errors --models ntp-reactive,idm --out studies/errors

The folder holds study.json, the table (study.md) and a run folder per member, for `reactsim \
report` and `reactsim compare`. To continue an interrupted study, repeat the command with \
--resume.";

/// Formats of the tables of studies.
const FORMATS: [&str; 3] = ["markdown", "latex", "json"];

/// Arguments of `study`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct StudyArgs {
    #[command(subcommand)]
    command: StudyCommand,
}

#[derive(Debug, Subcommand)]
enum StudyCommand {
    /// Replan interval: collisions with the AV and close calls by interval
    Replan(replan::ReplanArgs),
    /// Reactive against realism protocol: reaction, displacement, likelihood of the log
    Realism(realism::RealismArgs),
    /// Ablation of the parts of simulators: projection, keeping clear, QP stage, AV look-ahead
    Guards(guards::GuardsArgs),
    /// Planners of the AV: score and rank under several simulators
    Planners(planners::PlannersArgs),
    /// Displacements from the log: by class, situation, speed, distance and time
    Errors(errors::ErrorsArgs),
}

/// A study, and the external simulators and planners in it.
type PlannedStudy = (StudyPlan, ExternalPrograms);

/// Arguments common to all studies.
#[derive(Debug, Args)]
struct SharedArgs {
    #[command(flatten)]
    subject: Specification<SubjectSpec>,
    /// Folder of the study to write: its table, and a run folder per member
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Continue the interrupted study in --out
    #[arg(long)]
    resume: bool,
    /// Keep the rollouts in the run folders; `study realism` then also computes the realism metrics of the
    /// Sim Agents challenge
    #[arg(long)]
    keep_rollouts: bool,
    #[command(flatten)]
    work: ExecutionArgs,
    #[command(flatten)]
    partition: PartitionArg,
    /// Format of the output
    #[arg(long, default_value = "markdown", value_parser = FORMATS)]
    format: String,
    #[command(flatten)]
    table: ColumnArgs,
}

/// Arguments of studies whose members all plan at the same interval.
#[derive(Debug, Args)]
struct RolloutArgs {
    /// Replan rate or interval, such as 2hz or 5steps
    #[arg(long, default_value = "2hz", value_name = "RATE")]
    replan: Replan,
    /// Rollouts per scenario and simulator
    #[arg(long, default_value_t = 1, value_name = "R",
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rollouts: u32,
}

impl RolloutArgs {
    fn rollout(&self) -> RolloutSpec {
        RolloutSpec { replan: self.replan, rollouts: self.rollouts, ..RolloutSpec::default() }
    }
}

impl SharedArgs {
    /// Returns the specification of a member.
    fn spec(&self, rollout: RolloutSpec) -> RunSpec {
        let subject = self.subject.0.clone();
        RunSpec { subject, rollout, keep_rollouts: Some(self.keep_rollouts) }
    }

    /// Creates the simulators, and starts the external programs.
    fn simulators(&self, outline: &RunOutline) -> anyhow::Result<(Vec<PlannedSimulator>, ExternalPrograms)> {
        subject::simulators(&self.subject.0, &[], None, outline)
    }
}

impl StudyArgs {
    fn shared(&self) -> &SharedArgs {
        match &self.command {
            StudyCommand::Replan(args) => &args.shared,
            StudyCommand::Realism(args) => &args.shared,
            StudyCommand::Guards(args) => &args.shared,
            StudyCommand::Planners(args) => &args.shared,
            StudyCommand::Errors(args) => &args.shared,
        }
    }

    /// Plans the study on these scenarios.
    fn plan(&self, sources: Vec<Source>) -> anyhow::Result<PlannedStudy> {
        match &self.command {
            StudyCommand::Replan(args) => replan::study(args, sources),
            StudyCommand::Realism(args) => realism::study(args, sources),
            StudyCommand::Guards(args) => guards::study(args, sources),
            StudyCommand::Planners(args) => planners::study(args, sources),
            StudyCommand::Errors(args) => errors::study(args, sources),
        }
    }
}

pub(super) fn study(args: &StudyArgs) -> anyhow::Result<ExitStatus> {
    let shared = args.shared();
    let opening = shared.partition.partition.map_or(Opening::Whole, Opening::Partition);
    let (mut plan, outside) = args.plan(sources(&shared.subject.0.input, opening)?)?;
    plan.set_partition(shared.partition.partition);
    shared.table.check(&shared.format, &FORMATS)?;
    carry_out::carry_out((plan, outside), shared)
}

/// Joins the partitions of a study and prints its table.
pub(super) fn merge(args: &StudyArgs, partitions: &Partitions, out: &Path) -> anyhow::Result<ExitStatus> {
    let shared = args.shared();
    let (plan, _outside) = args.plan(sources(&shared.subject.0.input, Opening::Unread)?)?;
    carry_out::merge(&plan, shared, partitions, out)
}
