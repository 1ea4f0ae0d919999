//! Algorithms 1 and 2: the loop that computes the realised states.

use std::collections::BTreeMap;
use std::ops::Deref;
use std::sync::Arc;

use reactsim_scene::{Frame, Scenario};

use super::entering::{Entered, Entering};
use super::episode::{Beginning, Continuation, Controller, Episode, Memory, PlanError};
use super::running::ScenarioRollout;
use super::{Av, AvError, AvPolicy, Observation, Protocol, Settings};

/// Request for one rollout.
#[derive(Clone)]
pub struct Request<'a> {
    /// Scenario to roll out.
    pub scenario: &'a Scenario,
    /// The AV; `None` if the simulator moves it, as in the realism protocol, which uses no other AV.
    pub av: Option<Arc<dyn Av>>,
    /// Index among the rollouts of this scenario: part of the names of its random streams.
    pub rollout: u32,
}

/// The realised states of one scenario: history, then the steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Rollout {
    /// The frames of each agent, in the order of the scenario, and then of those that entered.
    ///
    /// Velocities of the steps are position differences over 0.1 s, so that no simulator can state one
    /// speed and drive another. A replayed recording (an oracle, or the logged AV) keeps its recorded
    /// velocities where they are finite. The first state after a gap keeps its stated velocity.
    pub tracks: Vec<Vec<Frame>>,
    /// Whether agents could enter.
    pub entering: Entering,
    /// Agents that entered after the beginning, in the order of their tracks.
    pub entered: Vec<Entered>,
    /// Counts of how parts of the plans ended, by outcome.
    pub outcomes: BTreeMap<&'static str, u64>,
}

/// Reason why one rollout failed; the others of its batch continue.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RolloutError {
    /// The simulator returned no plan.
    #[error("scenario `{scenario}`: no plan at step {step}: {source}")]
    Plan {
        /// Id of the scenario.
        scenario: String,
        /// Realised steps before the plan.
        step: usize,
        /// Reason.
        source: PlanError,
    },
    /// The simulator planned a state that is not finite.
    #[error("scenario `{scenario}`: the planned state of agent `{agent}` is not finite at step {step}")]
    NotFinite {
        /// Id of the scenario.
        scenario: String,
        /// Id of the agent.
        agent: String,
        /// Step, from 1.
        step: usize,
    },
    /// The reactive protocol needs an AV.
    #[error(
        "scenario `{scenario}`: the request has no AV, which the reactive protocol needs: give one, \
         or choose the realism protocol"
    )]
    NoAv {
        /// Id of the scenario.
        scenario: String,
    },
    /// The caller stopped the rollout.
    #[error("scenario `{scenario}`: stopped after {step} steps")]
    Stopped {
        /// Id of the scenario.
        scenario: String,
        /// Realised steps.
        step: usize,
    },
    /// The AV policy returned no state.
    #[error("scenario `{scenario}`: {source}")]
    Av {
        /// Id of the scenario.
        scenario: String,
        /// Reason.
        source: AvError,
    },
}

/// Outcome of an episode of a batch that the simulator broke off twice, so that it was rolled out alone.
pub const PLANNED_ALONE: &str = "planned-alone";

/// Outcome of an episode of a batch that the simulator broke off once and then completed.
const PLANNED_AGAIN: &str = "planned-again";

/// Outcome of an agent that entered.
pub const ENTERED: &str = "agents-entered";

/// Outcome of an agent that entered later than in the log, because another stood in its place or too many
/// were present.
pub const ENTERED_LATE: &str = "agents-entered-late";

/// Outcome of an agent that the log shows, but whose place was never free.
pub const KEPT_OUT: &str = "agents-kept-out";

/// Outcome of an agent that the log shows, but that could not enter while [`MAX_PRESENT`](super::MAX_PRESENT)
/// agents were present.
pub const OVER_LIMIT: &str = "agents-over-limit";

/// Outcome of an agent that left where the log loses it, outside of the observed area.
pub const LEFT: &str = "agents-left";

/// Outcome of an agent that left the map past the end of a road, where the log's agents vanish.
pub const PAST_ROAD_END: &str = "agents-past-road-end";

/// Rolls out a batch of scenarios in lockstep. The result of a scenario does not depend on the rest of
/// the batch, unless the simulator breaks off the whole batch ([`PlanError::BrokenOff`]): then the batch is
/// repeated once, and after that its scenarios are rolled out singly.
pub fn roll_out(
    batch: Vec<Request<'_>>,
    controller: &Controller,
    settings: &Settings,
) -> Vec<Result<Rollout, RolloutError>> {
    roll_out_while(batch, controller, settings, &|_| true)
}

/// Rolls out a batch as [`roll_out`] does, and asks before every step whether to continue.
///
/// `wanted` takes the number of realised steps. Once it returns `false`, rollouts that have not all their
/// steps fail with [`RolloutError::Stopped`].
pub fn roll_out_while(
    batch: Vec<Request<'_>>,
    controller: &Controller,
    settings: &Settings,
    wanted: &dyn Fn(usize) -> bool,
) -> Vec<Result<Rollout, RolloutError>> {
    let first = attempt(&batch, controller, settings, wanted);
    if !is_broken_off(&first) {
        return first;
    }
    let mut second = attempt(&batch, controller, settings, wanted);
    for rollout in second.iter_mut().flatten() {
        *rollout.outcomes.entry(PLANNED_AGAIN).or_default() += 1;
    }
    if batch.len() == 1 || !is_broken_off(&second) {
        return second;
    }
    let alone = |request| {
        let mut result = attempt(std::slice::from_ref(request), controller, settings, wanted).remove(0);
        if let Ok(rollout) = &mut result {
            *rollout.outcomes.entry(PLANNED_ALONE).or_default() += 1;
        }
        result
    };
    batch.iter().map(alone).collect()
}

fn is_broken_off(results: &[Result<Rollout, RolloutError>]) -> bool {
    let broken = |r: &_| matches!(r, Err(RolloutError::Plan { source: PlanError::BrokenOff(_), .. }));
    results.iter().any(broken)
}

/// Rolls out a batch once.
fn attempt(
    batch: &[Request<'_>],
    controller: &Controller,
    settings: &Settings,
    wanted: &dyn Fn(usize) -> bool,
) -> Vec<Result<Rollout, RolloutError>> {
    let is_reactive = settings.protocol == Protocol::Reactive;
    let beginning = batch.iter().map(|request| RolloutBeginning {
        scenario: request.scenario,
        av: request.av.as_ref().filter(|_| is_reactive).map(|av| av.begin(request.rollout)),
        rollout: request.rollout,
    });
    let mut lockstep = Lockstep::begin(beginning, controller, settings);
    for step in 0.. {
        if lockstep.is_over() {
            break;
        }
        if !wanted(step) {
            lockstep.abandon();
            break;
        }
        lockstep.step(controller, settings);
    }
    lockstep.finish(controller)
}

/// The beginning of one rollout of a [`Lockstep`].
pub struct RolloutBeginning<'a, S> {
    /// Scenario to roll out: a reference or an `Arc`.
    pub scenario: S,
    /// Policy of the AV; `None` if the simulator moves it, as in the realism protocol, which uses no other
    /// AV.
    pub av: Option<Box<dyn AvPolicy + 'a>>,
    /// Index among the rollouts of this scenario: part of the names of its random streams.
    pub rollout: u32,
}

/// Rollouts that are computed step by step, with one plan for all whose plans end at the same time.
///
/// [`roll_out`] runs it to its end. The controller and the settings must be the same at every call.
pub struct Lockstep<'a, S> {
    running: Vec<ScenarioRollout<'a, S>>,
}

impl<'a, S: Deref<Target = Scenario>> Lockstep<'a, S> {
    /// Begins rollouts.
    pub fn begin(
        batch: impl IntoIterator<Item = RolloutBeginning<'a, S>>,
        controller: &Controller,
        settings: &Settings,
    ) -> Self {
        let new = |beginning| ScenarioRollout::new(beginning, controller, settings);
        let mut running: Vec<_> = batch.into_iter().map(new).collect();
        begin_episodes(running.iter_mut().collect(), controller, settings);
        Self { running }
    }

    /// Begins other rollouts in place of those at these indices, which may have ended or not.
    pub fn restart(
        &mut self,
        batch: impl IntoIterator<Item = (usize, RolloutBeginning<'a, S>)>,
        controller: &Controller,
        settings: &Settings,
    ) {
        let (mut begun, mut ended) = (Vec::new(), Vec::new());
        for (index, beginning) in batch {
            let new = ScenarioRollout::new(beginning, controller, settings);
            ended.push(std::mem::replace(&mut self.running[index], new));
            begun.push(index);
        }
        end_episodes(&mut ended, controller);
        let running = self.running.iter_mut().enumerate();
        let begun = running.filter(|(index, _)| begun.contains(index)).map(|(_, rollout)| rollout);
        begin_episodes(begun.collect(), controller, settings);
    }

    /// Ends a rollout early: it takes no further steps.
    pub fn stop(&mut self, index: usize) {
        self.running[index].is_stopped = true;
    }

    /// Fails all rollouts that have steps left.
    fn abandon(&mut self) {
        for rollout in self.running.iter_mut().filter(|rollout| rollout.is_active()) {
            let (scenario, step) = (rollout.scenario.id.clone(), rollout.steps());
            rollout.failed = Some(RolloutError::Stopped { scenario, step });
        }
    }

    /// Returns whether every rollout has all its steps, is stopped or has failed.
    pub fn is_over(&self) -> bool {
        self.running.iter().all(|rollout| !rollout.is_active())
    }

    /// Realises the next step of all rollouts that are not over. Plans that have ended are made anew before.
    pub fn step(&mut self, controller: &Controller, settings: &Settings) {
        // Rollouts that began together plan together; restarted ones may have fewer steps left.
        let mut lengths: Vec<usize> =
            self.running.iter().filter_map(|rollout| rollout.due_plan(settings)).collect();
        lengths.sort_unstable();
        lengths.dedup();
        regroup(&mut self.running, controller, settings);
        for steps in lengths {
            plan_all(&mut self.running, controller, settings, steps);
        }
        for rollout in self.running.iter_mut().filter(|rollout| rollout.is_active()) {
            rollout.failed = rollout.advance().err();
        }
    }

    /// Returns the realised frames of each agent of a rollout so far, in the order of its scenario.
    pub fn tracks(&self, index: usize) -> &[Vec<Frame>] {
        &self.running[index].tracks
    }

    /// Returns the observation of a rollout at present, without the state of the AV one step ahead.
    pub fn seen(&self, index: usize) -> Observation<'_> {
        self.running[index].seen()
    }

    /// Returns the counts of how parts of the plans of a rollout ended so far, by outcome.
    pub fn outcomes(&self, index: usize) -> &BTreeMap<&'static str, u64> {
        &self.running[index].outcomes
    }

    /// Returns the reason why a rollout failed, if it did.
    pub fn failure(&self, index: usize) -> Option<&RolloutError> {
        self.running[index].failed.as_ref()
    }

    /// Ends all rollouts and returns their realised states.
    pub fn finish(mut self, controller: &Controller) -> Vec<Result<Rollout, RolloutError>> {
        end_episodes(&mut self.running, controller);
        self.running.into_iter().map(ScenarioRollout::finish).collect()
    }
}

fn begin_episodes<S: Deref<Target = Scenario>>(
    mut running: Vec<&mut ScenarioRollout<'_, S>>,
    controller: &Controller,
    settings: &Settings,
) {
    let simulator = match controller {
        Controller::Fair(simulator) => simulator,
        Controller::Oracle(oracle) => {
            running.iter_mut().for_each(|r| r.memory = oracle.begin(&r.scenario));
            return;
        }
    };
    let mut episodes: Vec<Beginning<'_>> =
        running.iter().map(|r| r.beginning(simulator.as_ref(), settings)).collect();
    let begun = simulator.begin_batch(&mut episodes);
    let memories: Vec<Memory> = episodes.into_iter().map(|e| e.memory).collect();
    for (scenario, memory) in running.iter_mut().zip(memories) {
        scenario.memory = memory;
        if let Err(error) = &begun {
            scenario.failed = Some(scenario.plan_error(error.for_each_episode()));
        }
    }
}

/// Continues the episodes of the rollouts that need a plan now, and in which agents have come or gone or
/// whose horizon is over.
fn regroup<S: Deref<Target = Scenario>>(
    running: &mut [ScenarioRollout<'_, S>],
    controller: &Controller,
    settings: &Settings,
) {
    let (mut changed, mut kept) = (Vec::new(), Vec::new());
    for rollout in running.iter_mut().filter(|rollout| rollout.due_plan(settings).is_some()) {
        if let Some(slots) = rollout.regroup(controller) {
            changed.push(rollout);
            kept.push(slots);
        }
    }
    let Controller::Fair(simulator) = controller else { return };
    if changed.is_empty() {
        return;
    }
    let before: Vec<Memory> = changed.iter_mut().map(|r| std::mem::take(&mut r.memory)).collect();
    let parts = changed.iter().zip(before).zip(&kept);
    let mut batch: Vec<Continuation<'_>> = parts
        .map(|((rollout, before), kept)| Continuation {
            before,
            kept,
            beginning: rollout.beginning(simulator.as_ref(), settings),
        })
        .collect();
    let continued = simulator.continue_batch(&mut batch);
    let memories: Vec<Memory> = batch.into_iter().map(|c| c.beginning.memory).collect();
    for (rollout, memory) in changed.into_iter().zip(memories) {
        rollout.memory = memory;
        if let Err(error) = &continued {
            rollout.failed = Some(rollout.plan_error(error.for_each_episode()));
        }
    }
}

fn end_episodes<S>(running: &mut [ScenarioRollout<'_, S>], controller: &Controller) {
    if let Controller::Fair(simulator) = controller {
        simulator.end_batch(running.iter_mut().map(|r| std::mem::take(&mut r.memory)).collect());
    }
}

/// Calls the controller once for the plans of `steps` steps of all scenarios that need one now.
fn plan_all<S: Deref<Target = Scenario>>(
    running: &mut [ScenarioRollout<'_, S>],
    controller: &Controller,
    settings: &Settings,
    steps: usize,
) {
    let is_due = |r: &&mut ScenarioRollout<'_, S>| r.due_plan(settings) == Some(steps);
    for scenario in running.iter_mut().filter(is_due) {
        scenario.failed = scenario.look_ahead().err();
    }
    let mut active: Vec<&mut ScenarioRollout<'_, S>> = running.iter_mut().filter(is_due).collect();
    let mut episodes: Vec<Episode<'_>> = Vec::with_capacity(active.len());
    for scenario in &mut active {
        episodes.push(scenario.episode(settings, steps));
    }
    let batch_error = match controller {
        Controller::Fair(simulator) => simulator.plan(&mut episodes),
        Controller::Oracle(oracle) => oracle.plan(&mut episodes),
    };
    let done: Vec<_> = episodes.into_iter().map(|e| (e.plan, e.outcomes, e.error)).collect();
    for (scenario, (plan, outcomes, error)) in active.into_iter().zip(done) {
        (scenario.plan, scenario.plan_step) = (plan, 0);
        scenario.outcomes = outcomes;
        let of_batch = batch_error.as_ref().err().map(PlanError::for_each_episode);
        // The failure of the batch decides whether it is repeated.
        scenario.failed = of_batch.or(error).map(|source| scenario.plan_error(source));
    }
}
