//! `reactsim study guards`: ablation of the parts of simulators.

use clap::Args;

use super::{PlannedStudy, SharedArgs};
use crate::evaluation::{Source, StudyPlan};
use crate::external::RunOutline;
use crate::rollout::{Replan, Settings};

const AFTER: &str = "\
The parameters projection and keep_clear of a simulator's card are inverted, one at a time. The
stage `qp` is added to simulators that accept it; `qp-regression` includes it and becomes
`regression` without it. Every variant runs with AV look-ahead 1 and 0.";

/// Arguments of `study guards`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct GuardsArgs {
    /// Replan rate or interval, such as 2hz or 5steps
    #[arg(long, default_value = "2hz", value_name = "RATE")]
    replan: Replan,
    /// Rollouts per scenario and simulator
    #[arg(long, default_value_t = 1, value_name = "R",
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rollouts: u32,
    #[command(flatten)]
    pub shared: SharedArgs,
}

pub(super) fn plan(args: &GuardsArgs, sources: Vec<Source>) -> anyhow::Result<PlannedStudy> {
    let subject = &args.shared.subject;
    let adjustments = subject.adjustments(None)?;
    let settings = Settings { replan: args.replan, seed: subject.seed, ..Settings::default() };
    let (simulators, outside) = subject.simulators(None, &RunOutline::of(&settings))?;
    let plan =
        subject.plan(sources, simulators, &outside, settings, args.rollouts, args.shared.keep_rollouts)?;
    Ok((StudyPlan::guards(plan, &adjustments)?, outside))
}
