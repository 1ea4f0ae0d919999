//! `reactsim study planners`: planners of the AV under several simulators.

use anyhow::bail;
use clap::{Args, ValueEnum};

use super::{PlannedStudy, RolloutArgs, SharedArgs};
use crate::cli::subject;
use crate::evaluation::{AvChoice, AvDriver, Driver, PlannedAv, RunParts, Source, StudyPlan};
use crate::external::RunOutline;
use crate::planning::tracking::Controller;
use crate::rollout::Replan;

const AFTER: &str = "\
Every planner drives the AV of every scenario under every simulator and is judged by nuPlan's \
closed-loop metrics. The tables show the score of each planner, its rank under each simulator, \
Kendall's tau between simulators, and which collisions exist because agents ignored the AV or \
vanish because they froze. The log always takes part: agents are compared with their motion \
around it. Scenarios with deviated AVs also run with these, for over-reaction.

Examples:
  reactsim study planners --models log-replay,idm,ntp-guarded --out studies/planners
  reactsim study planners logs/ --planners idm,pdm-closed,simulator:ntp-guarded --out studies/mine
  reactsim study planners --planner mine='python mine.py' --out studies/mine";

/// Simulators that are used if none are named.
const SIMULATORS: [&str; 3] = ["log-replay", "idm", "ntp-guarded"];

/// Arguments of `study planners`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct PlannersArgs {
    /// Planners, separated by commas: pdm-closed, idm, diffusion-planner, simulator:ID; external ones
    /// (--planner) are added
    #[arg(long, value_delimiter = ',', value_name = "IDS", default_value = "idm,pdm-closed")]
    planners: Vec<String>,
    /// Controller that follows the trajectories of planners
    #[arg(long, value_enum, default_value = "lqr")]
    tracker: Tracker,
    /// Steps between two plans of a planner; simulators that drive the AV plan every 5 steps
    #[arg(long, default_value = "1steps", value_name = "STEPS")]
    plan_every: Replan,
    #[command(flatten)]
    rolling: RolloutArgs,
    #[command(flatten)]
    pub shared: SharedArgs,
}

/// Name of a controller.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Tracker {
    // No doc comments here: clap would list them, and the guide explains both.
    Lqr,
    Perfect,
}

pub(super) fn study(args: &PlannersArgs, sources: Vec<Source>) -> anyhow::Result<PlannedStudy> {
    let mut spec = args.shared.spec(args.rolling.rollout());
    if spec.subject.av.replace(AvChoice::Log).is_some() {
        bail!("--av: the planners of this study drive the AV: name them with --planners");
    }
    spec.keep_rollouts = Some(true);
    let default: Vec<String> = SIMULATORS.map(str::to_owned).to_vec();
    let outline = RunOutline::of(&spec.settings());
    let (simulators, programs) = subject::simulators(&spec.subject, &default, None, &outline)?;
    let drivers: Vec<Driver> = programs.planners.iter().cloned().map(Driver::external).collect();
    let mut planners: Vec<PlannedAv> = vec!["log".parse()?];
    for id in &args.planners {
        let planned: PlannedAv = id.parse()?;
        if planned.driver == AvDriver::Log {
            continue;
        }
        planners.push(with_settings(planned, args)?);
    }
    for driver in &drivers {
        let planned: PlannedAv = driver.driver().to_string().parse()?;
        if !planners.iter().any(|given| given.driver == planned.driver) {
            planners.push(with_settings(planned, args)?);
        }
    }
    if let Some((i, _)) = planners.iter().enumerate().find(|(i, p)| planners[..*i].contains(p)) {
        bail!("--planners: `{}` is given twice", planners[i]);
    }
    let plan = spec.plan(RunParts { sources, simulators, drivers, partition: None })?;
    Ok((StudyPlan::planners(plan, &planners)?, programs))
}

/// Sets the tracker and the interval of a planner. Simulators have neither.
fn with_settings(planned: PlannedAv, args: &PlannersArgs) -> anyhow::Result<PlannedAv> {
    if matches!(planned.driver, AvDriver::Simulator(_)) {
        return Ok(planned);
    }
    let controller = match args.tracker {
        Tracker::Lqr => Controller::LqrBicycle,
        Tracker::Perfect => Controller::PerfectTracking,
    };
    // Parsed again, for the check that the controller can follow the planner.
    Ok(PlannedAv { controller, every: args.plan_every, ..planned }.to_string().parse()?)
}
