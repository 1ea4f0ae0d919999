//! Closed-loop evaluation of a network during training: benchmark metrics on a few scenarios.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, bail};
use clap::Args;
use parking_lot::Mutex;

use crate::cli::inputs::find_inputs;
use crate::evaluation::{
    self, AvChoice, EvaluationError, Execution, Outcome, Plan, PlannedSimulator, Row, RunObserver, RunParts,
    RunSpec, Source, Summary, Tally,
};
use crate::formats::native::ByNumber;
use crate::rollout::Controller;
use crate::scene::Scenario;

/// Ids of the reported metrics.
const REPORTED: [&str; 7] =
    ["aav-collision", "aav-ttc", "aa-collision", "offroad", "direction", "ade", "min-ade"];
/// Number of scenarios rolled out together.
const BATCH: usize = 4;
/// Id of the network as a simulator.
pub(super) const NETWORK: &str = "network";

/// Scenarios for closed-loop evaluation.
#[derive(Debug, Args)]
pub(super) struct ClosedLoopArgs {
    /// Scenarios for closed-loop evaluation at every validation; the log records the metrics
    #[arg(long, value_name = "SCENARIOS")]
    closed_loop: Option<PathBuf>,
    /// Maximum number of scenarios for closed-loop evaluation
    #[arg(long, default_value_t = 32, value_name = "N")]
    most_closed_loop: usize,
    /// Rollouts of each of them: the log records means, and the minimum displacement over rollouts
    #[arg(long, default_value_t = 2, value_name = "R", value_parser = clap::value_parser!(u32).range(1..))]
    closed_loop_rollouts: u32,
}

impl ClosedLoopArgs {
    /// Reads the scenarios; `None` if none are requested.
    pub(super) fn read(&self) -> anyhow::Result<Option<ClosedLoop>> {
        let read = |path| ClosedLoop::read(path, self.most_closed_loop, self.closed_loop_rollouts);
        self.closed_loop.as_ref().map(read).transpose()
    }
}

/// Scenarios to drive in, with their deviated AV if they have one, else with the logged AV.
pub(super) struct ClosedLoop {
    scenarios: Arc<[Scenario]>,
    /// Rollouts per scenario.
    rollouts: u32,
}

impl ClosedLoop {
    /// Reads the first `most` scenarios of a native file; `None` if it has none.
    pub(super) fn of_file(path: &Path, most: usize, rollouts: u32) -> anyhow::Result<Option<Self>> {
        let is_empty = ByNumber::open(path)?.is_empty();
        if is_empty { Ok(None) } else { Self::read(&path.to_owned(), most, rollouts).map(Some) }
    }

    /// Reads the first `most` scenarios of a file or folder.
    fn read(path: &PathBuf, most: usize, rollouts: u32) -> anyhow::Result<Self> {
        let (mut scenarios, mut ids) = (Vec::new(), BTreeSet::new());
        for input in find_inputs(std::slice::from_ref(path))? {
            for scenario in input.open()?.take(most - scenarios.len()) {
                let scenario = scenario?;
                if !ids.insert(scenario.id.clone()) {
                    bail!("{}: scenario `{}`: an earlier one has this id", path.display(), scenario.id);
                }
                scenarios.push(scenario);
            }
        }
        if scenarios.is_empty() {
            bail!("{}: no scenario to drive in", path.display());
        }
        let closed_loop = Self { scenarios: scenarios.into(), rollouts };
        let plan = closed_loop.plan(Vec::new())?;
        for scenario in closed_loop.scenarios.iter() {
            plan.av(scenario).with_context(|| format!("{}: scenario `{}`", path.display(), scenario.id))?;
        }
        Ok(closed_loop)
    }

    fn plan(&self, simulators: Vec<PlannedSimulator>) -> Result<Plan, EvaluationError> {
        let mut spec = RunSpec::default();
        (spec.subject.av, spec.rollout.rollouts) = (Some(AvChoice::DeviatedOrLog), self.rollouts);
        let sources = vec![Source::of_scenarios(self.scenarios.clone(), usize::MAX, None)];
        spec.plan(RunParts { sources, simulators, ..RunParts::default() })
    }

    fn plan_of(&self, network: Controller) -> Result<Plan, String> {
        self.plan(vec![PlannedSimulator::own(NETWORK, network)]).map_err(|error| error.to_string())
    }

    /// Returns the ids of the scenarios.
    pub(super) fn ids(&self) -> impl Iterator<Item = &str> {
        self.scenarios.iter().map(|scenario| scenario.id.as_str())
    }

    /// Returns the values of a simulator in the scenarios, in which it is called [`NETWORK`].
    pub(super) fn tally(&self, network: Controller, jobs: usize) -> Result<Tally, String> {
        let plan = self.plan_of(network)?;
        let tally = Mutex::new(plan.tally());
        run(&plan, jobs, &Collecting(&tally))?;
        Ok(tally.into_inner())
    }

    /// Returns the means over scenarios of a simulator's metrics, by metric id.
    pub(super) fn measure(&self, network: Controller, jobs: usize) -> Result<BTreeMap<String, f64>, String> {
        let summary = run(&self.plan_of(network)?, jobs, &())?;
        let metrics = &summary.simulators[NETWORK].metrics;
        Ok(REPORTED.iter().filter_map(|id| Some(((*id).to_owned(), metrics.get(*id)?.mean?))).collect())
    }
}

/// Collects the values of a run.
struct Collecting<'a>(&'a Mutex<Tally>);

impl RunObserver for Collecting<'_> {
    fn rows(&self, rows: &[Row]) {
        self.0.lock().add(rows);
    }
}

/// Runs a plan to its end. The first scenario that fails is an error.
fn run(plan: &Plan, jobs: usize, observer: &dyn RunObserver) -> Result<Summary, String> {
    // An interrupted training ends after this evaluation, which is short.
    let stop = AtomicBool::new(false);
    let execution = Execution { jobs, batch: BATCH };
    let ended = evaluation::run(plan, execution, None, plan.tally(), observer, &stop);
    let Outcome::Finished(summary) = ended.map_err(|error| error.to_string())? else {
        unreachable!("nothing stops the run")
    };
    match summary.provenance.failures.first() {
        Some(failure) => Err(failure.error.clone()),
        None => Ok(*summary),
    }
}
