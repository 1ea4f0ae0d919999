//! `reactsim study`: several runs on the same scenarios, side by side.

mod carry_out;
mod named;
mod realism;

use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail};
use clap::{Args, Command, Subcommand};

use super::inputs::sources;
use super::output::ExitStatus;
use super::partition::{PartitionArg, Partitions};
use super::subject::{ExecutionArgs, drivers};
use super::table_output::ColumnArgs;
use crate::evaluation::suggestion::most_similar;
use crate::evaluation::{
    Axis, ExternalPrograms, Opening, RunParts, RunSpec, Source, Specification, StudyKind, StudyPlan,
};

const AFTER: &str = "\
Examples:
  reactsim study --axis replan=1hz,2hz --axis models=idm,ntp-guarded --out studies/rates
  reactsim study spec.toml --axis av=planner:idm,planner:pdm-closed --out studies/avs
  reactsim study --models ntp-guarded --axis ntp-guarded.haste.weight=0,2,4 --out studies/haste
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
#[command(after_help = AFTER, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(super) struct StudyArgs {
    #[command(subcommand)]
    named: Option<named::NamedStudy>,
    /// `None` for a named study, which has no axis.
    #[command(flatten)]
    of_axes: Option<AxesArgs>,
}

/// Arguments of studies of any keys.
// clap leaves the group of arguments with flattened ones empty, and would never find it.
#[derive(Debug, Args)]
#[group(args = ["axis", "out"])]
struct AxesArgs {
    /// Key of a specification, or parameter of a simulator, with several values, such as replan=1hz,2hz or
    /// idm.vehicle.headway=1,1.5; members of the study are all combinations of the axes; may be repeated
    #[arg(long, value_name = "KEY=VALUES")]
    axis: Vec<Axis>,
    #[command(flatten)]
    shared: SharedArgs,
}

impl AxesArgs {
    /// Returns the refusal of arguments without an axis. The first one may be meant as the name of a study.
    fn nothing_varied(&self) -> anyhow::Error {
        let first = self.shared.spec.value.subject.input.scenarios.first();
        let Some(name) = first.filter(|path| !path.exists()).and_then(|path| path.to_str()) else {
            return anyhow!("nothing is varied: give --axis KEY=VALUES, or name a study first");
        };
        let named = named::NamedStudy::augment_subcommands(Command::new("study"));
        let studies: Vec<&str> = named.get_subcommands().map(Command::get_name).collect();
        match most_similar(name, &studies) {
            Some(meant) => anyhow!("there is no study `{name}`; did you mean `{meant}`?"),
            None => anyhow!("there is no study `{name}`: the studies are {}, and --axis", studies.join(", ")),
        }
    }
}

/// Arguments common to all studies.
#[derive(Debug, Args)]
struct SharedArgs {
    #[command(flatten)]
    spec: Specification,
    /// Folder of the study to write: its table, and a run folder per member
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Continue the interrupted study in --out
    #[arg(long)]
    resume: bool,
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

impl SharedArgs {
    /// Finds the files of scenarios.
    fn sources(&self, opening: Opening) -> anyhow::Result<Vec<Source>> {
        let subject = &self.spec.value.subject;
        sources(&subject.input, opening, subject.av.as_ref())
    }
}

/// A study with its external programs.
type PlannedStudy = (StudyPlan, ExternalPrograms);

/// What a study varies.
struct Design {
    kind: StudyKind,
    /// What all members have in common.
    spec: RunSpec,
    axes: Vec<Axis>,
    /// Rollouts in the realism protocol, if different.
    realism_rollouts: Option<u32>,
}

impl StudyArgs {
    /// Returns the arguments that all studies have.
    fn shared(&self) -> anyhow::Result<&SharedArgs> {
        match (&self.named, &self.of_axes) {
            (Some(named), _) => Ok(named.shared()),
            (None, Some(args)) if args.axis.is_empty() => Err(args.nothing_varied()),
            (None, Some(args)) => Ok(&args.shared),
            (None, None) => bail!("no study is named: give --axis KEY=VALUES and --out FOLDER"),
        }
    }

    /// Plans the study on these scenarios, and starts the external programs.
    fn plan(&self, sources: Vec<Source>) -> anyhow::Result<PlannedStudy> {
        let shared = self.shared()?;
        let design = match (&self.named, &self.of_axes) {
            (Some(named), _) => named.design(&sources)?,
            (None, args) => Design {
                kind: StudyKind::Axes,
                spec: shared.spec.value.clone(),
                axes: args.iter().flat_map(|args| args.axis.clone()).collect(),
                realism_rollouts: None,
            },
        };
        let mut points = design.spec.product(&design.axes)?;
        for (spec, _) in &mut points {
            let is_realism = spec.rollout.protocol == crate::rollout::Protocol::Realism;
            spec.rollout.rollouts =
                design.realism_rollouts.filter(|_| is_realism).unwrap_or(spec.rollout.rollouts);
        }
        let programs =
            design.spec.subject.external.start(&RunSpec::outline(points.iter().map(|(s, _)| s)))?;
        let avs = points.iter().map(|(spec, _)| spec.subject.av.as_ref());
        let parts = RunParts {
            sources,
            drivers: drivers(&programs, avs)?,
            partition: shared.partition.partition,
            ..RunParts::default()
        };
        Ok((StudyPlan::new(design.kind, points, parts, &programs)?, programs))
    }
}

pub(super) fn study(args: &StudyArgs) -> anyhow::Result<ExitStatus> {
    let shared = args.shared()?;
    let opening = shared.partition.partition.map_or(Opening::Whole, Opening::Partition);
    let planned = args.plan(shared.sources(opening)?)?;
    shared.table.check(&shared.format, &FORMATS)?;
    carry_out::carry_out(planned, shared)
}

/// Joins the partitions of a study and prints its table.
pub(super) fn merge(args: &StudyArgs, partitions: &Partitions, out: &Path) -> anyhow::Result<ExitStatus> {
    let shared = args.shared()?;
    let planned = args.plan(shared.sources(Opening::Unread)?)?;
    carry_out::merge(planned, shared, partitions, out)
}
