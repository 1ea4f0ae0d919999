//! `reactsim study errors`: where simulated agents leave the log, by what agents do in it.

use anyhow::bail;
use clap::Args;

use super::{PlannedStudy, RolloutArgs, SharedArgs};
use crate::evaluation::{AvChoice, RunParts, Source, StudyPlan};
use crate::external::RunOutline;

const AFTER: &str = "\
The AV follows the log, so that agents have no reason to do anything else. The tables show the \
distance of agents from where the log has them, by class, by what they do in the log (stand, set \
off, turn, halt, follow, cross, drive freely), by speed, by distance from the AV and by time, and \
how far they are ahead of the log. A simulator whose agents are ahead where they turn takes its \
turns too fast.

Examples:
  reactsim study errors --models ntp-reactive,trajtok-small --out studies/errors
  reactsim study errors logs/ --models constant-velocity,ntp-guarded --out studies/mine";

/// Arguments of `study errors`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct ErrorsArgs {
    #[command(flatten)]
    rolling: RolloutArgs,
    #[command(flatten)]
    pub shared: SharedArgs,
}

pub(super) fn study(args: &ErrorsArgs, sources: Vec<Source>) -> anyhow::Result<PlannedStudy> {
    if args.shared.subject.0.av.is_some() {
        bail!("--av: the AV of this study follows the log: leave out --av");
    }
    let mut spec = args.shared.spec(args.rolling.rollout());
    (spec.subject.av, spec.keep_rollouts) = (Some(AvChoice::Log), Some(true));
    let (simulators, programs) = args.shared.simulators(&RunOutline::of(&spec.settings()))?;
    let plan = spec.plan(RunParts { sources, simulators, ..RunParts::default() })?;
    Ok((StudyPlan::errors(plan), programs))
}
