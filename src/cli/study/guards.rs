//! `reactsim study guards`: what each part of the simulators is worth.

use clap::Args;

use super::Shared;
use crate::evaluation::{PlannedSimulator, StudyPlan};
use crate::rollout::{Replan, Settings};

const AFTER: &str = "\
What a simulator's card has (projection, keep_clear) is switched: off where it is on, on where it
is off. The stage `qp` is put behind those that take it; `qp-regression` has it in it, and is
`regression` without it. Everything is run with AV look-ahead 1 and 0.";

/// Arguments of `study guards`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct GuardsArgs {
    /// How often simulators plan anew, such as 2hz or 5steps
    #[arg(long, default_value = "2hz", value_name = "RATE")]
    replan: Replan,
    /// Rollouts per scenario and simulator
    #[arg(long, default_value_t = 1, value_name = "R", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rollouts: u32,
    #[command(flatten)]
    pub shared: Shared,
}

pub(super) fn plan(args: &GuardsArgs) -> anyhow::Result<StudyPlan> {
    let subject = &args.shared.subject;
    let asked = subject.adjustments(None)?;
    let simulators = PlannedSimulator::adjusted(&subject.models, &asked)?;
    let settings = Settings { replan: args.replan, seed: subject.seed, ..Settings::default() };
    let plan = subject.plan(simulators, settings, args.rollouts, args.shared.keep_rollouts)?;
    Ok(StudyPlan::guards(plan, &asked)?)
}
