//! `reactsim study guards`: ablation of the parts of simulators.

use clap::Args;

use super::{PlannedStudy, RolloutArgs, SharedArgs};
use crate::cli::subject::plan;
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

pub(super) fn study(args: &GuardsArgs, sources: Vec<Source>) -> anyhow::Result<PlannedStudy> {
    let spec = args.shared.spec(args.rolling.rollout());
    let (simulators, programs) = args.shared.simulators(&RunOutline::of(&spec.settings()))?;
    let plan = plan(&spec, sources, simulators, &programs, None)?;
    Ok((StudyPlan::guards(plan, &spec.subject.adjustments(None)?)?, programs))
}
