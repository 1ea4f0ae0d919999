//! One rollout of a batch while it runs.

use std::collections::BTreeMap;
use std::ops::Deref;
use std::sync::Mutex;

use reactsim_scene::levels::RoadHeights;
use reactsim_scene::{AgentState, DT, Frame, LightState, Scenario};

use super::engine::{
    ENTERED, ENTERED_LATE, KEPT_OUT, LEFT, OVER_LIMIT, PAST_ROAD_END, Rollout, RolloutBeginning, RolloutError,
};
use super::entering::{Coming, Entering};
use super::episode::{Beginning, Controller, Episode, Identity, JointPlan, Memory, PlanError, Simulator};
use super::stream::after_changes;
use super::view::{Changes, View};
use super::{AvPolicy, Observation, Protocol, Purpose, Settings, Stream, stream};

/// State of one scenario of a batch during the rollout.
pub(crate) struct ScenarioRollout<'a, S> {
    pub(crate) scenario: S,
    /// Index among the rollouts of the scenario.
    rollout: u32,
    /// Policy of the AV; `None` if the simulator moves it.
    av: Option<Box<dyn AvPolicy + 'a>>,
    /// Whether planned states come from a recording.
    replayed: bool,
    pub(crate) tracks: Vec<Vec<Frame>>,
    lights: Vec<Vec<Option<LightState>>>,
    /// Heights of the agents of the scenario.
    heights: Mutex<RoadHeights>,
    pub(crate) memory: Memory,
    pub(crate) stream: Stream,
    pub(crate) outcomes: BTreeMap<&'static str, u64>,
    av_next: Option<AgentState>,
    /// Agents that enter and leave; `None` if none may.
    pub(crate) coming: Option<Coming>,
    /// What the simulator observes; `None`: everything.
    view: Option<View>,
    changes: Changes,
    /// What the AV policy observes; `None`: everything.
    av_view: Option<View>,
    av_changes: Changes,
    pub(crate) plan: JointPlan,
    /// Number of steps of the plan that are realised.
    pub(crate) plan_step: usize,
    /// Whether the rollout ended before its last step.
    pub(crate) is_stopped: bool,
    pub(crate) failed: Option<RolloutError>,
}

impl<'a, S: Deref<Target = Scenario>> ScenarioRollout<'a, S> {
    pub(crate) fn new(
        beginning: RolloutBeginning<'a, S>,
        controller: &Controller,
        settings: &Settings,
    ) -> Self {
        let RolloutBeginning { scenario, av, rollout } = beginning;
        let length = scenario.length();
        let with_room = |history: &Vec<Frame>| {
            let mut track = Vec::with_capacity(length.frames());
            track.extend_from_slice(history);
            track
        };
        let av = match settings.protocol {
            Protocol::Reactive => av,
            Protocol::Realism => None,
        };
        let lacks_av = settings.protocol == Protocol::Reactive && av.is_none();
        let tracks: Vec<Vec<Frame>> = scenario.start.history.iter().map(with_room).collect();
        let lights = scenario.start.light_history.clone();
        // Those that are for another length of history observe a view from the beginning.
        let view = |history: Option<usize>| {
            let history = history.filter(|frames| *frames != length.history)?;
            Some(View::new(&scenario, None, &tracks, &lights, history, 0))
        };
        let of_av = av.as_ref().and_then(|av| av.history());
        let (av_view, view) = (view(of_av), view(fair(controller).and_then(|s| s.history())));
        Self {
            tracks,
            lights,
            heights: Mutex::default(),
            memory: Memory::NONE,
            stream: stream(settings.seed, &scenario.id, rollout, Purpose::Plan),
            outcomes: BTreeMap::new(),
            av_next: None,
            coming: (settings.entering == Entering::Log).then(|| Coming::new(&scenario)),
            view,
            changes: Changes::new(&scenario),
            av_view,
            av_changes: Changes::new(&scenario),
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
    pub(crate) fn steps(&self) -> usize {
        self.tracks[0].len() - 1 - self.scenario.start.current()
    }

    /// Returns whether the rollout has steps left and has not failed.
    pub(crate) fn is_active(&self) -> bool {
        self.failed.is_none() && !self.is_stopped && self.steps() < self.scenario.length().future
    }

    /// Returns the number of steps of the plan that is needed now, if one is.
    pub(crate) fn due_plan(&self, settings: &Settings) -> Option<usize> {
        let is_due = self.is_active() && self.plan_step == self.plan.steps();
        is_due.then(|| settings.replan.steps().min(self.scenario.length().future - self.steps()))
    }

    pub(crate) fn plan_error(&self, source: PlanError) -> RolloutError {
        RolloutError::Plan { scenario: self.scenario.id.clone(), step: self.steps(), source }
    }

    /// Returns the observation of the AV policy: states up to the current time.
    pub(crate) fn seen(&self) -> Observation<'_> {
        match &self.av_view {
            Some(view) => view.seen(None),
            None => Observation::new(&self.scenario.start, &self.tracks, &self.lights, None)
                .with_heights(&self.heights),
        }
    }

    /// Returns the episode that the controller plans for `steps` steps. An oracle knows the agents of the
    /// beginning, whose log it has.
    pub(crate) fn episode(&mut self, settings: &Settings, steps: usize) -> Episode<'_> {
        let start = &self.scenario.start;
        let av_next = self.av_next.filter(|_| settings.av_lookahead);
        let seen = match &self.view {
            Some(view) if !self.replayed => view.seen(av_next),
            _ => Observation::new(start, &self.tracks[..start.agents.len()], &self.lights, av_next)
                .with_heights(&self.heights),
        };
        Episode {
            seen,
            memory: &mut self.memory,
            stream: &mut self.stream,
            moves_av: settings.protocol == Protocol::Realism,
            shares_traffic: false,
            plan: JointPlan::new(seen.tracks().len(), steps),
            outcomes: std::mem::take(&mut self.outcomes),
            error: None,
        }
    }

    /// Returns the beginning of the simulator's episode, from the present start on.
    pub(crate) fn beginning(&self, simulator: &dyn Simulator, settings: &Settings) -> Beginning<'_> {
        let stream = stream(settings.seed, &self.scenario.id, self.rollout, Purpose::Begin);
        Beginning {
            start: self.view.as_ref().map_or(&self.scenario.start, View::start),
            stream: after_changes(stream, self.changes.count),
            moves_av: settings.protocol == Protocol::Realism,
            steps: settings.replan.steps(),
            future: self.scenario.length().future,
            identity: simulator.wants_identity().then_some(Identity {
                scenario: &self.scenario.id,
                origin: self.scenario.origin,
                rollout: self.rollout,
            }),
            memory: Memory::NONE,
        }
    }

    /// Makes a new view for the simulator if agents, or objects of the static context, have come or gone
    /// since the last one, or its horizon is over. Returns the slot that each agent had in that, `None` for
    /// those that entered.
    pub(crate) fn regroup(&mut self, controller: &Controller) -> Option<Vec<Option<usize>>> {
        let now = self.tracks[0].len() - 1;
        let (coming, simulator) = (self.coming.as_ref(), fair(controller));
        let horizon = simulator.and_then(|s| s.horizon());
        if self.tracks[0][now].is_none() || !self.changes.has_changed(&self.scenario, coming, now, horizon) {
            return None;
        }
        let all = 0..self.scenario.start.agents.len();
        let before = self.view.as_ref().map_or_else(|| all.collect(), |view| view.slots.clone());
        let history = simulator.and_then(|s| s.history()).unwrap_or(self.scenario.length().history);
        let changes = self.changes.count;
        let view = View::new(&self.scenario, coming, &self.tracks, &self.lights, history, changes);
        let slot_before = |slot: &usize| before.iter().position(|other| other == slot);
        let kept = view.slots.iter().map(slot_before).collect();
        self.view = Some(view);
        Some(kept)
    }

    /// Makes a new view for the AV policy, as [`Self::regroup`] does at plans, whenever something has
    /// changed.
    fn renew_av_view(&mut self) {
        let now = self.tracks[0].len() - 1;
        let (of_av, coming) = (self.av.as_ref(), self.coming.as_ref());
        let horizon = of_av.and_then(|av| av.horizon());
        if self.tracks[0][now].is_none() || !self.av_changes.has_changed(&self.scenario, coming, now, horizon)
        {
            return;
        }
        let history = of_av.and_then(|av| av.history()).unwrap_or(self.scenario.length().history);
        let changes = self.av_changes.count;
        self.av_view = Some(View::new(&self.scenario, coming, &self.tracks, &self.lights, history, changes));
    }

    /// Fetches the AV's next state (Algorithm 1, line 3). The policy sees states up to the current time
    /// only.
    pub(crate) fn look_ahead(&mut self) -> Result<(), RolloutError> {
        if self.av.is_none() || self.av_next.is_some() {
            return Ok(());
        }
        self.renew_av_view();
        let Some(mut av) = self.av.take() else { return Ok(()) };
        let next = av.next(&self.seen());
        self.av = Some(av);
        let next = next.map_err(|source| RolloutError::Av { scenario: self.scenario.id.clone(), source })?;
        self.av_next = Some(next);
        Ok(())
    }

    /// Realises one step: the AV by its policy (or by the plan), the agents by the next step of the
    /// plan.
    pub(crate) fn advance(&mut self) -> Result<(), RolloutError> {
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
                (self.planned(agent, k), self.replayed)
            };
            if planned.is_some_and(|s| !s.is_finite()) {
                return Err(RolloutError::NotFinite {
                    scenario: self.scenario.id.clone(),
                    agent: self.agent_id(agent),
                    step,
                });
            }
            let before = self.tracks[agent].last().copied().flatten();
            self.tracks[agent].push(planned.map(|state| with_velocity(before, state, replayed)));
        }
        for (seen, future) in self.lights.iter_mut().zip(&self.scenario.log_future.lights) {
            seen.push(future[step - 1]);
        }
        if let Some(coming) = &mut self.coming {
            if !self.replayed {
                coming.let_go(&self.scenario, &self.tracks);
            }
            coming.admit(&self.scenario, &mut self.tracks, !self.replayed);
        }
        for view in self.view.iter_mut().chain(&mut self.av_view) {
            view.push(&self.tracks, &self.lights);
        }
        Ok(())
    }

    /// Returns the next state of an agent, which is `step` in the plan. Agents that entered since the plan
    /// was made keep their velocity until the next one; those of an oracle follow their log.
    fn planned(&self, agent: usize, step: usize) -> Frame {
        let of_beginning = self.scenario.start.agents.len();
        let index = match &self.view {
            Some(view) if !self.replayed => view.index(agent),
            _ => Some(agent).filter(|agent| *agent < of_beginning),
        };
        match (index, &self.coming) {
            (_, Some(coming)) if coming.has_left(agent) => None,
            (Some(index), _) => self.plan.get(index, step),
            // A simulator that has no state for an agent has removed it.
            (None, Some(coming)) if agent >= of_beginning && self.is_unplanned(coming, agent) => {
                if self.replayed {
                    // Oracles replay gaps as well.
                    return coming.logged(&self.scenario, agent - of_beginning, self.tracks[agent].len());
                }
                self.tracks[agent].last().copied().flatten().map(AgentState::coasted)
            }
            (None, _) => None,
        }
    }

    /// Returns whether an agent entered after the simulator's view was made, or an oracle replays its log.
    fn is_unplanned(&self, coming: &Coming, agent: usize) -> bool {
        let start = &self.scenario.start;
        let made = self.view.as_ref().map_or(0, |view| view.first_step) + start.current();
        self.replayed || coming.entered[agent - start.agents.len()].frame > made
    }

    /// Returns the realised states, or the reason why the rollout failed.
    pub(crate) fn finish(mut self) -> Result<Rollout, RolloutError> {
        if let Some(error) = self.failed {
            return Err(error);
        }
        let (mut entered, is_on) = (Vec::new(), self.coming.is_some());
        if let Some(coming) = self.coming {
            let late = coming.entered.iter().filter(|agent| agent.waited > 0).count();
            let last = self.tracks[0].len() - 1;
            let counts = [
                (ENTERED, coming.entered.len()),
                (ENTERED_LATE, late),
                (KEPT_OUT, coming.kept_out(last, false)),
                (OVER_LIMIT, coming.kept_out(last, true)),
                (LEFT, coming.left_as_logged),
                (PAST_ROAD_END, coming.past_road_end),
            ];
            let counts = counts.into_iter().filter(|(_, count)| *count > 0);
            self.outcomes.extend(counts.map(|(outcome, count)| (outcome, count as u64)));
            entered = coming.entered;
        }
        let entering = if is_on { Entering::Log } else { Entering::Off };
        Ok(Rollout { tracks: self.tracks, entering, entered, outcomes: self.outcomes })
    }

    fn agent_id(&self, slot: usize) -> String {
        let start = &self.scenario.start;
        let entered = || self.coming.as_ref()?.agents(&self.scenario).nth(slot);
        start.agents.get(slot).or_else(entered).map_or_else(String::new, |agent| agent.id.clone())
    }
}

/// Returns the simulator unless it is an oracle, which takes any history and needs no new start.
fn fair(controller: &Controller) -> Option<&dyn Simulator> {
    match controller {
        Controller::Fair(simulator) => Some(simulator.as_ref()),
        Controller::Oracle(_) => None,
    }
}

/// Returns the state with its realised velocity: the recorded one if a recording is replayed and its
/// velocity is finite, else the position difference. After a gap the state keeps its own velocity.
fn with_velocity(before: Frame, state: AgentState, replayed: bool) -> AgentState {
    match before {
        Some(_) if replayed && state.velocity().is_some() => state,
        Some(b) => AgentState { vx: (state.x - b.x) / DT, vy: (state.y - b.y) / DT, ..state },
        None => state,
    }
}
