//! `reactsim study guards`: ablation of the parts of simulators.

use clap::Args;

use super::{PlannedStudy, RolloutArgs, SharedArgs};
use crate::evaluation::{Source, StudyPlan};
use crate::external::RunOutline;

const AFTER: &str = "\
The parameters projection and keep_clear of a simulator's card are inverted, one at a time. The \
stage `qp` is added to simulators that accept it; `qp-regression` includes it and becomes \
`regression` without it. Every variant runs with AV look-ahead 1 and 0.";

/// Arguments of `study guards`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct GuardsArgs {
    #[command(flatten)]
    rolling: RolloutArgs,
    #[command(flatten)]
    pub shared: SharedArgs,
}

pub(super) fn plan(args: &GuardsArgs, sources: Vec<Source>) -> anyhow::Result<PlannedStudy> {
    let subject = &args.shared.subject;
    let adjustments = subject.adjustments(None)?;
    let settings = args.rolling.settings(subject.seed);
    let (simulators, outside) = subject.simulators(None, &RunOutline::of(&settings))?;
    let plan = subject.plan(
        sources,
        simulators,
        &outside,
        settings,
        args.rolling.rollouts,
        args.shared.keep_rollouts,
    )?;
    Ok((StudyPlan::guards(plan, &adjustments)?, outside))
}
