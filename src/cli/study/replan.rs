//! `reactsim study replan`: results by replan interval.

use anyhow::bail;
use clap::Args;

use super::{PlannedStudy, SharedArgs};
use crate::cli::subject::plan;
use crate::evaluation::{RolloutSpec, Source, StudyPlan};
use crate::external::RunOutline;
use crate::rollout::{Protocol, Replan};

const AFTER: &str = "\
Without --models, oracles are left out: their motion does not depend on the replan interval.";

/// Arguments of `study replan`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct ReplanArgs {
    /// Steps between two plans (1 to 80, of 0.1 s each), separated by commas, or rates such as 2hz
    #[arg(long, value_name = "STEPS", value_delimiter = ',', default_value = "1,2,5,10,20,40")]
    intervals: Vec<Replan>,
    /// reactive: the AV is an external input (Algorithm 1); realism: the simulator also moves the AV
    /// (Algorithm 2)
    #[arg(long, default_value_t = Protocol::Reactive, value_name = "PROTOCOL")]
    protocol: Protocol,
    /// Rollouts per scenario and simulator
    #[arg(long, default_value_t = 1, value_name = "R",
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rollouts: u32,
    #[command(flatten)]
    pub shared: SharedArgs,
}

pub(super) fn study(args: &ReplanArgs, sources: Vec<Source>) -> anyhow::Result<PlannedStudy> {
    let mut intervals = args.intervals.clone();
    intervals.sort_by_key(|i| i.steps());
    if let Some(repeated) = intervals.windows(2).find(|w| w[0] == w[1]) {
        bail!("--intervals has {} steps twice: give each interval once", repeated[0].steps());
    }
    let protocol = args.protocol;
    let steps = intervals.iter().map(|interval| interval.steps()).collect();
    let outline = RunOutline { intervals: steps, protocols: vec![protocol.name()] };
    let (mut simulators, programs) = args.shared.simulators(&outline)?;
    if args.shared.subject.0.models.is_empty() {
        simulators.retain(|s| !s.controller.is_oracle());
    }
    let rollout = RolloutSpec { protocol, rollouts: args.rollouts, ..RolloutSpec::default() };
    let plan = plan(&args.shared.spec(rollout), sources, simulators, &programs, None)?;
    Ok((StudyPlan::replan(plan, &intervals), programs))
}
