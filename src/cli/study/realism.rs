//! `reactsim study realism`: whether simulators that resemble the log also react to the AV.

use clap::Args;

use super::{PlannedStudy, SharedArgs};
use crate::evaluation::StudyPlan;
use crate::external::RunOutline;
use crate::rollout::{Replan, Settings};

/// Arguments of `study realism`.
#[derive(Debug, Args)]
pub(super) struct RealismArgs {
    /// Replan rate or interval, such as 2hz or 5steps
    #[arg(long, default_value = "2hz", value_name = "RATE")]
    replan: Replan,
    /// Rollouts per scenario and simulator in the realism protocol
    #[arg(long, default_value_t = 32, value_name = "R",
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rollouts: u32,
    /// Rollouts per scenario and simulator in the reactive protocol
    #[arg(long, default_value_t = 1, value_name = "R",
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    reactive_rollouts: u32,
    #[command(flatten)]
    pub shared: SharedArgs,
}

pub(super) fn plan(args: &RealismArgs) -> anyhow::Result<PlannedStudy> {
    let subject = &args.shared.subject;
    let protocols = vec!["reactive", "realism"];
    let outline = RunOutline { intervals: vec![args.replan.steps()], protocols };
    let (simulators, external) = subject.simulators(None, &outline)?;
    let settings = Settings { replan: args.replan, seed: subject.seed, ..Settings::default() };
    let plan = subject.plan(simulators, settings, args.reactive_rollouts, args.shared.keep_rollouts)?;
    Ok((StudyPlan::realism(plan, args.rollouts), external))
}
