//! Algorithms 1 and 2: the loop that computes the realised states.

use std::collections::BTreeMap;
use std::ops::Deref;
use std::sync::Arc;

use reactsim_scene::{AgentState, DT, Frame, LightState, Scenario};

use super::episode::{Beginning, Controller, Episode, Identity, JointPlan, Memory, PlanError};
use super::{Av, AvError, AvPolicy, Observation, Protocol, Purpose, Settings, Stream, stream};

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
    /// The frames of each agent, in the order of the scenario.
    ///
    /// Velocities of the steps are position differences over 0.1 s, so that no simulator can state one
    /// speed and drive another. A replayed recording (an oracle, or the logged AV) keeps its recorded
    /// velocities where they are finite. The first state after a gap keeps its stated velocity.
    pub tracks: Vec<Vec<Frame>>,
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
    /// The AV policy returned no state.
    #[error("scenario `{scenario}`: {source}")]
    Av {
        /// Id of the scenario.
        scenario: String,
        /// Reason.
        source: AvError,
    },
}

/// State of one scenario of a batch during the rollout.
struct ScenarioRollout<'a, S> {
    scenario: S,
    /// Index among the rollouts of the scenario.
    rollout: u32,
    /// Policy of the AV; `None` if the simulator moves it.
    av: Option<Box<dyn AvPolicy + 'a>>,
    /// Whether planned states come from a recording.
    replayed: bool,
    tracks: Vec<Vec<Frame>>,
    lights: Vec<Vec<Option<LightState>>>,
    memory: Memory,
    stream: Stream,
    outcomes: BTreeMap<&'static str, u64>,
    av_next: Option<AgentState>,
    plan: JointPlan,
    /// Number of steps of the plan that are realised.
    plan_step: usize,
    /// Whether the rollout ended before its last step.
    is_stopped: bool,
    failed: Option<RolloutError>,
}

/// Outcome of an episode of a batch that the simulator broke off twice, so that it was rolled out alone.
pub const PLANNED_ALONE: &str = "planned-alone";

/// Outcome of an episode of a batch that the simulator broke off once and then completed.
const PLANNED_AGAIN: &str = "planned-again";

/// Rolls out a batch of scenarios in lockstep. The result of a scenario does not depend on the rest of
/// the batch, unless the simulator breaks off the whole batch ([`PlanError::BrokenOff`]): then the batch is
/// repeated once, and after that its scenarios are rolled out singly.
pub fn roll_out(
    batch: Vec<Request<'_>>,
    controller: &Controller,
    settings: &Settings,
) -> Vec<Result<Rollout, RolloutError>> {
    let first = attempt(&batch, controller, settings);
    if !is_broken_off(&first) {
        return first;
    }
    let mut second = attempt(&batch, controller, settings);
    for rollout in second.iter_mut().flatten() {
        *rollout.outcomes.entry(PLANNED_AGAIN).or_default() += 1;
    }
    if batch.len() == 1 || !is_broken_off(&second) {
        return second;
    }
    let alone = |request| {
        let mut result = attempt(std::slice::from_ref(request), controller, settings).remove(0);
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
) -> Vec<Result<Rollout, RolloutError>> {
    let is_reactive = settings.protocol == Protocol::Reactive;
    let beginning = batch.iter().map(|request| RolloutBeginning {
        scenario: request.scenario,
        av: request.av.as_ref().filter(|_| is_reactive).map(|av| av.begin(request.rollout)),
        rollout: request.rollout,
    });
    let mut lockstep = Lockstep::begin(beginning, controller, settings);
    while !lockstep.is_over() {
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
        self.running
            .into_iter()
            .map(|r| match r.failed {
                Some(error) => Err(error),
                None => Ok(Rollout { tracks: r.tracks, outcomes: r.outcomes }),
            })
            .collect()
    }
}

/// Begins the episodes of a batch.
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
    let mut episodes: Vec<Beginning<'_>> = running
        .iter()
        .map(|r| Beginning {
            start: &r.scenario.start,
            stream: stream(settings.seed, &r.scenario.id, r.rollout, Purpose::Begin),
            moves_av: settings.protocol == Protocol::Realism,
            steps: settings.replan.steps(),
            future: r.scenario.length().future,
            identity: simulator.wants_identity().then_some(Identity {
                scenario: &r.scenario.id,
                origin: r.scenario.origin,
                rollout: r.rollout,
            }),
            memory: Memory::NONE,
        })
        .collect();
    let begun = simulator.begin_batch(&mut episodes);
    let memories: Vec<Memory> = episodes.into_iter().map(|e| e.memory).collect();
    for (scenario, memory) in running.iter_mut().zip(memories) {
        scenario.memory = memory;
        if let Err(error) = &begun {
            scenario.failed = Some(scenario.plan_error(error.for_each_episode()));
        }
    }
}

/// Ends the episodes of a batch.
fn end_episodes<S>(running: &mut [ScenarioRollout<'_, S>], controller: &Controller) {
    if let Controller::Fair(simulator) = controller {
        simulator
            .end_batch(running.iter_mut().map(|r| std::mem::replace(&mut r.memory, Memory::NONE)).collect());
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
        let agents = scenario.tracks.len();
        episodes.push(Episode {
            seen: Observation::new(
                &scenario.scenario.start,
                &scenario.tracks,
                &scenario.lights,
                if settings.av_lookahead { scenario.av_next } else { None },
            ),
            memory: &mut scenario.memory,
            stream: &mut scenario.stream,
            moves_av: settings.protocol == Protocol::Realism,
            shares_traffic: false,
            plan: JointPlan::new(agents, steps),
            outcomes: std::mem::take(&mut scenario.outcomes),
            error: None,
        });
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

impl<'a, S: Deref<Target = Scenario>> ScenarioRollout<'a, S> {
    fn new(beginning: RolloutBeginning<'a, S>, controller: &Controller, settings: &Settings) -> Self {
        let RolloutBeginning { scenario, av, rollout } = beginning;
        let frames = scenario.length().frames();
        let with_room = |history: &Vec<Frame>| {
            let mut track = Vec::with_capacity(frames);
            track.extend_from_slice(history);
            track
        };
        let av = match settings.protocol {
            Protocol::Reactive => av,
            Protocol::Realism => None,
        };
        let lacks_av = settings.protocol == Protocol::Reactive && av.is_none();
        Self {
            tracks: scenario.start.history.iter().map(with_room).collect(),
            lights: scenario.start.light_history.clone(),
            memory: Memory::NONE,
            stream: stream(settings.seed, &scenario.id, rollout, Purpose::Plan),
            outcomes: BTreeMap::new(),
            av_next: None,
            plan: JointPlan::new(0, 0),
            plan_step: 0,
            is_stopped: false,
            failed: lacks_av.then(|| RolloutError::NoAv { scenario: scenario.id.clone() }),
            replayed: controller.is_oracle(),
            rollout,
            av,
            scenario,
        }
    }

    /// Returns the number of realised steps.
    fn steps(&self) -> usize {
        self.tracks[0].len() - 1 - self.scenario.start.current()
    }

    /// Returns whether the rollout has steps left and has not failed.
    fn is_active(&self) -> bool {
        self.failed.is_none() && !self.is_stopped && self.steps() < self.scenario.length().future
    }

    /// Returns the number of steps of the plan that is needed now, if one is.
    fn due_plan(&self, settings: &Settings) -> Option<usize> {
        let is_due = self.is_active() && self.plan_step == self.plan.steps();
        is_due.then(|| settings.replan.steps().min(self.scenario.length().future - self.steps()))
    }

    fn plan_error(&self, source: PlanError) -> RolloutError {
        RolloutError::Plan { scenario: self.scenario.id.clone(), step: self.steps(), source }
    }

    /// Returns the observation of the AV policy: states up to the current time.
    fn seen(&self) -> Observation<'_> {
        Observation::new(&self.scenario.start, &self.tracks, &self.lights, None)
    }

    /// Fetches the AV's next state (Algorithm 1, line 3). The policy sees states up to the current time
    /// only.
    fn look_ahead(&mut self) -> Result<(), RolloutError> {
        let Some(av) = self.av.as_mut().filter(|_| self.av_next.is_none()) else { return Ok(()) };
        let seen = Observation::new(&self.scenario.start, &self.tracks, &self.lights, None);
        let next = av.next(&seen);
        let next = next.map_err(|source| RolloutError::Av { scenario: self.scenario.id.clone(), source })?;
        self.av_next = Some(next);
        Ok(())
    }

    /// Realises one step: the AV by its policy (or by the plan), the agents by the next step of the
    /// plan.
    fn advance(&mut self) -> Result<(), RolloutError> {
        self.look_ahead()?;
        let k = self.plan_step;
        self.plan_step += 1;
        let step = self.steps() + 1;
        let external = self.av_next.take();
        let replays_recording = self.av.as_ref().is_some_and(|av| av.replays_recording());
        for agent in 0..self.tracks.len() {
            let (planned, replayed) = if agent == 0 && external.is_some() {
                (external, replays_recording)
            } else {
                (self.plan.get(agent, k), self.replayed)
            };
            if planned.is_some_and(|s| !s.is_finite()) {
                return Err(RolloutError::NotFinite {
                    scenario: self.scenario.id.clone(),
                    agent: self.scenario.start.agents[agent].id.clone(),
                    step,
                });
            }
            let before = self.tracks[agent].last().copied().flatten();
            self.tracks[agent].push(planned.map(|state| with_velocity(before, state, replayed)));
        }
        for (seen, future) in self.lights.iter_mut().zip(&self.scenario.log_future.lights) {
            seen.push(future[step - 1]);
        }
        Ok(())
    }
}

/// Returns the state with its realised velocity: the recorded one if a recording is replayed and its
/// velocity is finite, else the position difference. After a gap the state keeps its own velocity.
fn with_velocity(before: Frame, state: AgentState, replayed: bool) -> AgentState {
    match before {
        Some(_) if replayed && state.velocity().is_some_and(|v| v.x.is_finite() && v.y.is_finite()) => state,
        Some(b) => AgentState { vx: (state.x - b.x) / DT, vy: (state.y - b.y) / DT, ..state },
        None => state,
    }
}
