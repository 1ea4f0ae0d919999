//! `reactsim study errors`: where simulated agents leave the log, by what agents do in it.

use anyhow::bail;
use clap::Args;

use super::{PlannedStudy, RolloutArgs, SharedArgs};
use crate::evaluation::{AvChoice, PlanRequest, Source, StudyPlan};
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

pub(super) fn plan(args: &ErrorsArgs, sources: Vec<Source>) -> anyhow::Result<PlannedStudy> {
    let subject = &args.shared.subject;
    if subject.av.is_some() {
        bail!("--av: the AV of this study follows the log: leave out --av");
    }
    let settings = args.rolling.settings(subject.seed);
    let (simulators, outside) = subject.simulators(None, &RunOutline::of(&settings))?;
    let request = PlanRequest {
        av: Some(AvChoice::Log),
        rollouts: args.rolling.rollouts,
        ..subject.request(sources, simulators, settings, true)?
    };
    Ok((StudyPlan::errors(request.plan()?), outside))
}
