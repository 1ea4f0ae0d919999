//! Rollouts whose agents a program moves, while the AV follows a trajectory.

use std::fmt::Display;
use std::sync::Arc;

use parking_lot::Mutex;

use super::action::{ActionKind, Mover};
use super::arrays::{Arrays, Kept, SceneArrays, Sizes};
use super::traffic::{Traffic, reason};
use super::wire::{RequestError, missing, refused};
use crate::evaluation::{Plan, Row, judge_in_memory};
use crate::metrics::{Event, Options};
use crate::planning::EgoShape;
use crate::rollout::{
    Av, AvError, AvPolicy, Beginning, Continuation, Controller, Entering, Episode, JointPlan, Lockstep,
    Memory, Observation, PlanError, Protocol, Replan, Rollout, RolloutBeginning, Settings, Simulator,
};
use crate::scene::{AgentKind, AgentState, Frame, Scenario};

/// Slot of the AV among the agents.
const AV: usize = 0;

/// Names of the measures of a step of an agent.
pub const AGENT_MEASURES: [&str; 4] = ["contact_av", "contact_agents", "off_road", "speed"];

/// Settings of a [`World`].
pub struct WorldSettings {
    /// The policy of the AV, which may not be a planner.
    pub plan: Plan,
    /// The simulator of the agents that actions do not move, if there are such agents; no oracle.
    pub traffic: Option<Traffic>,
    /// Number of agents after the AV that actions move, at most; `usize::MAX` without `traffic`.
    pub controlled: usize,
    /// Kind of the actions.
    pub action: ActionKind,
    /// Sizes of the observations.
    pub sizes: Sizes,
    /// Variants of the metrics with which finished episodes are scored; `None` if they are not.
    pub scores: Option<Options>,
}

/// An environment in which actions move agents, and not the AV.
pub struct World {
    plan: Plan,
    scenarios: Vec<Arc<Scenario>>,
    controlled: usize,
    action: ActionKind,
    sizes: Sizes,
    options: Option<Options>,
    /// Name of the traffic in rows and messages.
    id: String,
    settings: Settings,
    controller: Controller,
    /// The next states of the agents that actions move.
    next: Arc<Mutex<Vec<Frame>>>,
    episode: Option<WorldEpisode>,
}

struct WorldEpisode {
    scenario: Arc<Scenario>,
    arrays: SceneArrays,
    kept: Kept,
    lockstep: Lockstep<'static, Arc<Scenario>>,
    /// Motion of each agent that actions move.
    movers: Vec<Mover>,
}

/// The result of a step.
#[derive(Clone, Debug)]
pub struct WorldStepped {
    /// Values of [`AGENT_MEASURES`] per agent that actions move, NaN where unknown.
    pub measures: Vec<[f64; AGENT_MEASURES.len()]>,
    /// Whether all steps of the scenario are over.
    pub is_over: bool,
}

/// Simulator that is asked at every step: the first agents take states that others have set, and the rest the
/// plans of another simulator, which plans at its own interval.
struct Puppets {
    next: Arc<Mutex<Vec<Frame>>>,
    others: Option<(Box<dyn Simulator>, Replan)>,
}

/// Memory and latest plan of the other simulator.
struct OthersMemory {
    memory: Memory,
    plan: JointPlan,
    /// Step at which the plan ends.
    planned_until: usize,
    /// Slot in the scenario of each observed agent.
    slots: Vec<usize>,
    /// Number of steps of the episode.
    future: usize,
}

impl Simulator for Puppets {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        let Some((simulator, replan)) = &self.others else { return Ok(()) };
        let mut begun = Vec::with_capacity(batch.len());
        for episode in batch.iter() {
            begun.push(Beginning {
                start: episode.start,
                stream: episode.stream.clone(),
                moves_av: false,
                steps: replan.steps(),
                future: episode.future,
                identity: None,
                memory: Memory::NONE,
            });
        }
        let result = simulator.begin_batch(&mut begun);
        for (episode, Beginning { memory, .. }) in batch.iter_mut().zip(begun) {
            let (plan, future) = (JointPlan::new(0, 0), episode.future);
            let slots = (0..episode.start.agents.len()).collect();
            episode.memory = Memory::new(OthersMemory { memory, plan, planned_until: 0, slots, future });
        }
        result
    }

    fn continue_batch(&self, batch: &mut [Continuation<'_>]) -> Result<(), PlanError> {
        let Some((simulator, replan)) = &self.others else { return Ok(()) };
        let (mut own, mut before) = (Vec::with_capacity(batch.len()), Vec::with_capacity(batch.len()));
        for Continuation { before: memory, kept, beginning } in batch.iter_mut() {
            let Some(mut old) = memory.take::<OthersMemory>() else {
                return Err(PlanError::ForeignMemory("puppets"));
            };
            let beginning = Beginning { moves_av: false, steps: replan.steps(), ..beginning.again() };
            let memory = std::mem::replace(&mut old.memory, Memory::NONE);
            own.push(Continuation { before: memory, kept, beginning });
            before.push(old);
        }
        let result = simulator.continue_batch(&mut own);
        for ((episode, own), old) in batch.iter_mut().zip(own).zip(before) {
            // No agent enters.
            let slots = episode.kept.iter().flatten().map(|slot| old.slots[*slot]).collect();
            let (plan, memory) = (JointPlan::new(0, 0), own.beginning.memory);
            episode.beginning.memory =
                Memory::new(OthersMemory { memory, plan, planned_until: 0, slots, future: old.future });
        }
        result
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        let next = self.next.lock();
        for Episode { seen, memory, stream, plan, outcomes, error, .. } in batch {
            let Some((simulator, replan)) = &self.others else {
                for (agent, state) in next.iter().enumerate() {
                    plan.set(agent + 1, 0, *state);
                }
                continue;
            };
            let Some(OthersMemory { memory, plan: latest, planned_until, slots, future }) = memory.get()
            else {
                *error = Some(PlanError::ForeignMemory("puppets"));
                continue;
            };
            let (agents, step) = (plan.agents(), seen.step());
            if step >= *planned_until {
                let mut own = [Episode {
                    seen: *seen,
                    memory,
                    stream,
                    moves_av: false,
                    shares_traffic: !next.is_empty(),
                    plan: JointPlan::new(agents, replan.steps().min(*future - step)),
                    outcomes: std::mem::take(outcomes),
                    error: None,
                }];
                simulator.plan(&mut own)?;
                let [own] = own;
                (*latest, *outcomes, *error) = (own.plan, own.outcomes, own.error);
                *planned_until = step + latest.steps();
            }
            let of_plan = step + latest.steps() - *planned_until;
            for (agent, slot) in slots.iter().enumerate().skip(AV + 1) {
                let moved = next.get(slot - 1);
                plan.set(agent, 0, moved.copied().unwrap_or_else(|| latest.get(agent, of_plan)));
            }
        }
        Ok(())
    }

    fn history(&self) -> Option<usize> {
        let (simulator, _) = self.others.as_ref()?;
        simulator.history()
    }

    fn horizon(&self) -> Option<usize> {
        let (simulator, _) = self.others.as_ref()?;
        simulator.horizon()
    }

    fn end_batch(&self, memories: Vec<Memory>) {
        let Some((simulator, _)) = &self.others else { return };
        let own = memories.into_iter().filter_map(|mut memory| memory.take::<OthersMemory>());
        simulator.end_batch(own.map(|own| own.memory).collect());
    }
}

/// Policy of an AV whose next state depends on the observation only: trajectories and scripts.
struct StatelessPolicy {
    av: Arc<dyn Av>,
    rollout: u32,
}

impl AvPolicy for StatelessPolicy {
    fn next(&mut self, seen: &Observation<'_>) -> Result<AgentState, AvError> {
        self.av.begin(self.rollout).next(seen)
    }

    fn replays_recording(&self) -> bool {
        self.av.begin(self.rollout).replays_recording()
    }
}

impl World {
    /// Creates an environment without an episode.
    ///
    /// # Errors
    /// If the AV is driven by a planner, or a setting is out of range.
    pub fn new(scenarios: Vec<Arc<Scenario>>, settings: WorldSettings) -> Result<Self, RequestError> {
        let WorldSettings { plan, traffic, controlled, action, sizes, scores: options } = settings;
        if let Some(av) = plan.policy().filter(|av| av.is_judged()) {
            return refused(format_args!(
                "the AV is driven by `{av}`, expected a trajectory or a script, such as deviated or log"
            ));
        }
        if let Some(fault) = sizes.fault() {
            return refused(fault);
        }
        if matches!(action, ActionKind::Plan { .. }) {
            return refused("agents have no tracker: expected bicycle or state");
        }
        let (id, controller, settings) = match traffic {
            Some(Traffic { id, controller, settings }) => (id, Some(controller), settings),
            None => ("agents".to_owned(), None, Settings::default()),
        };
        let others = match controller {
            Some(Controller::Fair(simulator)) => Some((simulator, settings.replan)),
            Some(Controller::Oracle(_)) => {
                return refused(format_args!(
                    "`{id}` observes the logged future and moves all agents or none"
                ));
            }
            None => None,
        };
        let next = Arc::<Mutex<Vec<Frame>>>::default();
        let controller = Controller::Fair(Box::new(Puppets { next: Arc::clone(&next), others }));
        let settings = Settings { protocol: Protocol::Reactive, replan: Replan::EVERY_STEP, ..settings };
        let episode = None;
        Ok(Self {
            plan,
            scenarios,
            controlled,
            action,
            sizes,
            options,
            id,
            settings,
            controller,
            next,
            episode,
        })
    }

    /// Returns the scenarios.
    pub fn scenarios(&self) -> &[Arc<Scenario>] {
        &self.scenarios
    }

    /// Returns the sizes of the observations.
    pub fn sizes(&self) -> &Sizes {
        &self.sizes
    }

    /// Returns the number of agents that actions move, and the number of values of an action.
    pub fn actions(&self) -> [usize; 2] {
        [self.episode.as_ref().map_or(0, |episode| episode.movers.len()), self.action.values()]
    }

    /// Begins an episode. Returns the scenario.
    ///
    /// # Errors
    /// If there is no such scenario, it has no AV of the chosen kind, or the simulator fails.
    pub fn reset(&mut self, scenario: usize, rollout: u32) -> Result<Arc<Scenario>, RequestError> {
        let count = self.scenarios.len();
        let of = self.scenarios.get(scenario).ok_or_else(|| missing("scenario", scenario, count))?;
        let scenario = Arc::clone(of);
        let named =
            |error: &dyn Display| RequestError::new(format_args!("scenario `{}`: {error}", scenario.id));
        let (av, _) = self.plan.av(&scenario).map_err(|error| named(&error))?;
        let av: Option<Box<dyn AvPolicy>> =
            av.map(|av| -> Box<dyn AvPolicy> { Box::new(StatelessPolicy { av, rollout }) });
        let mover = |track: &Vec<Frame>| Mover::new(self.action, track, &EgoShape::PACIFICA);
        let tracks = scenario.start.history[AV + 1..].iter().take(self.controlled);
        let movers: Option<Vec<Mover>> = tracks.map(mover).collect();
        let movers = movers.ok_or_else(|| named(&"an agent is absent now"))?;
        // A simulator ends its episode before it begins another one.
        if let Some(ended) = self.episode.take() {
            ended.lockstep.finish(&self.controller);
        }
        let beginning = RolloutBeginning { scenario: Arc::clone(&scenario), av, rollout };
        let lockstep = Lockstep::begin([beginning], &self.controller, &self.settings);
        let arrays = SceneArrays::new(&scenario, self.sizes.points);
        let (scenario_of, kept) = (Arc::clone(&scenario), Kept::default());
        let new = WorldEpisode { scenario: scenario_of, arrays, kept, lockstep, movers };
        match self.episode.insert(new).lockstep.failure(0) {
            Some(error) => refused(reason(&self.id, error)),
            None => Ok(scenario),
        }
    }

    /// Moves the agents by their actions, `values` numbers per agent.
    ///
    /// # Errors
    /// If an action cannot be executed, no episode has begun, or it is over; nothing has changed then. Or if
    /// the AV cannot be moved, or the simulator fails.
    pub fn step(&mut self, actions: &[f64]) -> Result<WorldStepped, RequestError> {
        let rows: Vec<_> = (1..=self.actions()[0]).map(|agent| Some(format!("agent {agent}"))).collect();
        self.action.check(actions, &rows)?;
        let none = || RequestError::new("no episode has begun: reset first");
        let episode = self.episode.as_mut().ok_or_else(none)?;
        if episode.lockstep.is_over() {
            return refused("the episode is over: reset it");
        }
        let mut movers = episode.movers.clone();
        let mut next = Vec::with_capacity(movers.len());
        let tracks = &episode.lockstep.tracks(0)[AV + 1..];
        for ((mover, track), action) in
            movers.iter_mut().zip(tracks).zip(actions.chunks(self.action.values()))
        {
            let now = track.last().copied().flatten();
            next.push(now.map(|now| mover.advance(&now, action, true)).transpose()?);
        }
        episode.movers = movers;
        *self.next.lock() = next;
        episode.lockstep.step(&self.controller, &self.settings);
        if let Some(error) = episode.lockstep.failure(0) {
            return refused(reason(&self.id, error));
        }
        let (seen, is_over) = (episode.lockstep.seen(0), episode.lockstep.is_over());
        Ok(WorldStepped { measures: measures(&seen, episode.movers.len()), is_over })
    }

    /// Returns the observation of each agent that actions move.
    pub fn observe(&mut self) -> Arrays {
        let mut arrays = Arrays::with_capacity(&self.sizes, self.actions()[0]);
        if let Some(WorldEpisode { arrays: of_scene, kept, lockstep, movers, .. }) = &mut self.episode {
            let seen = lockstep.seen(0);
            kept.follow(&seen);
            for agent in AV + 1..=movers.len() {
                of_scene.write(&seen, kept, agent, &self.sizes, &mut arrays);
            }
        }
        arrays
    }

    /// Returns the frames of each agent so far, and the scenario.
    ///
    /// # Errors
    /// If no episode has begun.
    pub fn tracks(&self) -> Result<(&Scenario, &[Vec<Frame>]), RequestError> {
        let none = || RequestError::new("no episode has begun: reset first");
        let episode = self.episode.as_ref().ok_or_else(none)?;
        Ok((&episode.scenario, episode.lockstep.tracks(0)))
    }

    /// Scores an episode that is over, as a run does. `None` if episodes are not scored.
    pub fn scores(&self) -> Option<(Vec<Row>, Vec<Vec<Event>>)> {
        let (options, episode) = (self.options?, self.episode.as_ref()?);
        let (_, deviation) = self.plan.av(&episode.scenario).ok()?;
        let tracks = episode.lockstep.tracks(0).to_vec();
        let rollout = Rollout {
            tracks,
            entering: Entering::Off,
            entered: Vec::new(),
            outcomes: episode.lockstep.outcomes(0).clone(),
        };
        Some(judge_in_memory(&episode.scenario, &self.id, rollout, &deviation, options, None))
    }
}

/// Returns the measures of the first agents after the AV.
fn measures(seen: &Observation<'_>, count: usize) -> Vec<[f64; AGENT_MEASURES.len()]> {
    let agents = &seen.start().agents;
    let boxes: Vec<_> = agents
        .iter()
        .enumerate()
        .map(|(i, agent)| Some(seen.state(i).filter(|_| agent.has_extent())?.footprint(agent)))
        .collect();
    let (road, heights) = (seen.start().road(), seen.heights());
    // NaN, as in scenarios of one level, separates nothing.
    let height = |i: usize| heights.get(i).copied().unwrap_or(f64::NAN);
    let touches = |a: usize, b: usize| match (&boxes[a], &boxes[b]) {
        (Some(one), Some(other)) => {
            let distance = (one.center - other.center).norm();
            distance < one.radius() + other.radius()
                && one.separation(other) < 0.0
                && !road.is_apart((one.center, height(a)), (other.center, height(b)))
        }
        _ => false,
    };
    let flag = |is_so: bool| f64::from(u8::from(is_so));
    let of = |i: usize| {
        let Some(state) = seen.state(i) else { return [f64::NAN; AGENT_MEASURES.len()] };
        let hits_agent = (AV + 1..agents.len()).any(|other| other != i && touches(i, other));
        let drivable = match agents[i].kind {
            AgentKind::Vehicle => {
                road.on_level(state.position(), height(i)).drivable(state.position(), &mut None)
            }
            _ => None,
        };
        let off_road = drivable.map_or(f64::NAN, |is_drivable| flag(!is_drivable));
        [flag(touches(i, AV)), flag(hits_agent), off_road, state.speed()]
    };
    (AV + 1..=count).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::super::scenarios::of_length;
    use crate::evaluation::{AvChoice, RunParts, RunSpec, Source};

    use super::*;

    fn world(av: AvChoice, traffic: Option<Traffic>, controlled: usize) -> Result<World, RequestError> {
        let scenarios: Vec<_> =
            Source::shipped(1).scenarios().unwrap().map(|scenario| Arc::new(scenario.unwrap())).collect();
        let plan = {
            let mut spec = RunSpec::default();
            spec.subject.av = Some(av);
            spec.plan(RunParts::default()).unwrap()
        };
        let sizes = Sizes { agents: 2, frames: 1, lanes: 2, points: 2, lights: 1, route: 0 };
        let (action, scores) = (ActionKind::State, Some(Options::default()));
        World::new(scenarios, WorldSettings { plan, traffic, controlled, action, sizes, scores })
    }

    #[test]
    fn logged_agents_have_the_metrics_of_the_log() {
        let mut world = world(AvChoice::Log, None, usize::MAX).unwrap();
        let logged = Arc::clone(&world.scenarios()[0]);
        world.reset(0, 0).unwrap();
        let [agents, values] = world.actions();
        assert_eq!((agents, values), (logged.start.agents.len() - 1, 5));
        let mut last = None;
        for step in 0..80 {
            let state = |agent: usize| {
                // Agents that leave the log stay where they are.
                let now = world.tracks().unwrap().1[agent].last().copied().flatten();
                let next = logged.log_future.tracks[agent][step].or(now).unwrap();
                [next.x, next.y, next.heading, next.vx, next.vy]
            };
            let actions: Vec<f64> = (1..=agents).flat_map(state).collect();
            last = Some(world.step(&actions).unwrap());
        }
        assert!(last.unwrap().is_over);
        let (rows, _) = world.scores().unwrap();
        assert!(rows[0].metrics.contains_key("aav-collision") && !rows[0].metrics.contains_key("av-score"));
        let tracks = world.tracks().unwrap().1;
        assert_eq!(tracks[0][90].map(|state| state.x), logged.log_future.tracks[0][79].map(|state| state.x));
        assert!(world.step(&vec![0.0; agents * values]).is_err());
    }

    #[test]
    fn episodes_have_the_steps_of_their_scenario() {
        for steps in [60, 150] {
            let mut world = world(AvChoice::Log, None, usize::MAX).unwrap();
            world.scenarios[0] = Arc::new(of_length(&world.scenarios[0], steps));
            let scenario = world.reset(0, 0).unwrap();
            let length = scenario.length().frames();
            let [agents, _] = world.actions();
            for step in 1..=steps {
                let state = |agent: usize| {
                    let now = world.tracks().unwrap().1[agent].last().copied().flatten().unwrap();
                    [now.x, now.y, now.heading, 0.0, 0.0]
                };
                let actions: Vec<f64> = (1..=agents).flat_map(state).collect();
                assert_eq!(world.step(&actions).unwrap().is_over, step == steps, "{step} of {steps}");
            }
            assert!(world.tracks().unwrap().1.iter().all(|track| track.len() == length));
            let (rows, _) = world.scores().unwrap();
            assert_eq!(rows[0].length.map(|length| length.steps), Some(steps));
        }
    }

    #[test]
    fn planners_are_refused() {
        let error = world("planner:idm".parse().unwrap(), None, 1).err().unwrap();
        assert_eq!(
            error.to_string(),
            "the AV is driven by `planner:idm`, expected a trajectory or a script, such as deviated or log"
        );
    }
}
