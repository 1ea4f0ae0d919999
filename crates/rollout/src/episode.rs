//! The simulator interface: traits, and the data that simulators receive and return.

use std::any::Any;
use std::collections::BTreeMap;

use reactsim_geometry::Vec2;
use reactsim_scene::{Frame, HISTORY, Scenario, Start};

use super::{Observation, Stream};

/// Data that a simulator keeps between the plans of one episode, such as routes and caches.
#[derive(Default)]
pub struct Memory(Option<Box<dyn Any + Send>>);

impl Memory {
    /// Empty memory.
    pub const NONE: Self = Self(None);

    /// Stores a value.
    pub fn new<T: Any + Send>(value: T) -> Self {
        Self(Some(Box::new(value)))
    }

    /// Returns the value if it has this type.
    pub fn get<T: Any>(&mut self) -> Option<&mut T> {
        self.0.as_mut()?.downcast_mut()
    }

    /// Takes the value out if it has this type.
    pub fn take<T: Any>(&mut self) -> Option<T> {
        match self.0.take()?.downcast() {
            Ok(value) => Some(*value),
            Err(other) => {
                self.0 = Some(other);
                None
            }
        }
    }
}

/// Planned states of all agents over several steps. Slot 0 is executed only if the simulator moves the
/// AV.
#[derive(Clone, Debug, PartialEq)]
pub struct JointPlan {
    agents: usize,
    steps: usize,
    executed: usize,
    states: Vec<Frame>,
}

impl JointPlan {
    /// Creates a plan in which every agent is absent.
    pub fn new(agents: usize, steps: usize) -> Self {
        Self::with_outlook(agents, steps, steps)
    }

    /// Creates a plan of `steps` steps, of which at most the first `executed` are executed. The others show
    /// where agents are going and may be planned with less effort.
    pub fn with_outlook(agents: usize, steps: usize, executed: usize) -> Self {
        Self { agents, steps, executed: executed.min(steps), states: vec![None; agents * steps] }
    }

    /// Returns the number of agents.
    pub fn agents(&self) -> usize {
        self.agents
    }

    /// Returns the number of steps.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Returns the number of steps that are executed at most; the others are an outlook.
    pub fn executed(&self) -> usize {
        self.executed
    }

    /// Sets the state of an agent after `step` + 1 steps. The engine recomputes velocities from the
    /// positions.
    pub fn set(&mut self, agent: usize, step: usize, state: Frame) {
        self.states[agent * self.steps + step] = state;
    }

    /// Returns the planned state of an agent after `step` + 1 steps.
    pub fn get(&self, agent: usize, step: usize) -> Frame {
        self.states[agent * self.steps + step]
    }
}

/// Reason why planning failed for one episode.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// The simulator found no plan; the text gives the subject and the reason.
    #[error("{0}")]
    Failed(String),
    /// The simulator broke off the whole batch, for instance because its process crashed. The engine
    /// repeats the batch once, then rolls out its episodes singly, so that only those fail that cause it.
    #[error("{0}")]
    BrokenOff(String),
    /// The simulator received an episode that it had not begun.
    #[error("simulator `{0}` received the memory of another simulator")]
    ForeignMemory(&'static str),
}

impl PlanError {
    /// Returns the failure of one episode of a batch that failed as a whole.
    pub(super) fn for_each_episode(&self) -> Self {
        match self {
            Self::BrokenOff(text) => Self::BrokenOff(text.clone()),
            other => Self::Failed(other.to_string()),
        }
    }
}

/// One scenario during a rollout, as passed to a simulator.
pub struct Episode<'a> {
    /// The observation available for planning.
    pub seen: Observation<'a>,
    /// The simulator's data for this episode.
    pub memory: &'a mut Memory,
    /// Random stream of this episode for choices during planning.
    pub stream: &'a mut Stream,
    /// Whether the simulator moves the AV too (realism protocol).
    pub moves_av: bool,
    /// Whether other simulators move some of the agents, which may therefore not have executed the plans.
    pub shares_traffic: bool,
    /// The plan to fill in.
    pub plan: JointPlan,
    /// Counts of how parts of the plan ended, by outcome (a fallback, a solve that only nearly
    /// converged).
    pub outcomes: BTreeMap<&'static str, u64>,
    /// Set if planning failed; only this episode fails.
    pub error: Option<PlanError>,
}

/// An episode that begins.
pub struct Beginning<'a> {
    /// The information known at the current frame.
    pub start: &'a Start,
    /// Random stream for choices made once per episode.
    pub stream: Stream,
    /// Whether the simulator will move the AV too (realism protocol).
    pub moves_av: bool,
    /// Number of steps between two plans.
    pub steps: usize,
    /// Number of steps of the rollout. An episode that continues with other agents has fewer left.
    pub future: usize,
    /// Names of the episode, for simulators that ask for them with [`Simulator::wants_identity`].
    pub identity: Option<Identity<'a>>,
    /// The memory to fill in.
    pub memory: Memory,
}

impl<'a> Beginning<'a> {
    /// Returns the same beginning without a memory.
    pub fn again(&self) -> Beginning<'a> {
        Beginning {
            start: self.start,
            stream: self.stream.clone(),
            moves_av: self.moves_av,
            steps: self.steps,
            future: self.future,
            identity: self.identity,
            memory: Memory::NONE,
        }
    }
}

/// An episode that continues with other agents.
pub struct Continuation<'a> {
    /// The memory so far.
    pub before: Memory,
    /// Slot that each agent of the new start had before; `None` for those that entered.
    pub kept: &'a [Option<usize>],
    /// The beginning with the new start; its memory is to be filled in.
    pub beginning: Beginning<'a>,
}

impl Continuation<'_> {
    /// Takes the memories of the episodes that are continued.
    pub fn take_memories(batch: &mut [Self]) -> Vec<Memory> {
        batch.iter_mut().map(|c| std::mem::take(&mut c.before)).collect()
    }

    /// Begins the episodes anew by a function that fills in their memories.
    ///
    /// # Errors
    /// Those of the function.
    pub fn begin_anew(
        batch: &mut [Self],
        begin: impl FnOnce(&mut [Beginning<'_>]) -> Result<(), PlanError>,
    ) -> Result<(), PlanError> {
        let mut begun: Vec<Beginning<'_>> = batch.iter().map(|c| c.beginning.again()).collect();
        let result = begin(&mut begun);
        let memories: Vec<Memory> = begun.into_iter().map(|b| b.memory).collect();
        batch.iter_mut().zip(memories).for_each(|(c, memory)| c.beginning.memory = memory);
        result
    }
}

/// Names of an episode, which simulators normally do not receive.
#[derive(Clone, Copy, Debug)]
pub struct Identity<'a> {
    /// Id of the scenario.
    pub scenario: &'a str,
    /// World point that is the origin of the scenario's coordinates, metres.
    pub origin: Vec2,
    /// Index among the rollouts of the scenario.
    pub rollout: u32,
}

/// A simulator: moves every agent except the AV (in the realism protocol, the AV too).
pub trait Simulator: Send + Sync {
    /// Creates the memory of an episode; called once before its first plan.
    fn begin(&self, _start: &Start, _stream: &mut Stream) -> Memory {
        Memory::NONE
    }

    /// Creates the memories of a batch of episodes that are planned together.
    ///
    /// # Errors
    /// Only for failures of the whole batch.
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        for episode in batch {
            episode.memory = self.begin(episode.start, &mut episode.stream);
        }
        Ok(())
    }

    /// Returns whether [`Beginning::identity`] is to be filled in. A simulator that needs names of
    /// scenarios, for instance for caches, must say so in its results.
    fn wants_identity(&self) -> bool {
        false
    }

    /// Returns the number of frames up to the current one that the simulator was built for: longer histories
    /// are cut, and shorter ones begin with absent frames. `None`: any number.
    fn history(&self) -> Option<usize> {
        Some(HISTORY)
    }

    /// Returns the number of steps after which an episode continues from a new start at the present frame, if
    /// its future is longer: that of a network that was trained for this time, with a map around the position
    /// of the AV at the start. `None`: it does not. In a mix, all members continue at the shortest horizon.
    fn horizon(&self) -> Option<usize> {
        None
    }

    /// Continues episodes in which agents entered or left, or whose [`Self::horizon`] is over: fills in their
    /// memories for the new start, whose current frame is the present one. By default they begin anew.
    ///
    /// # Errors
    /// Only for failures of the whole batch.
    fn continue_batch(&self, batch: &mut [Continuation<'_>]) -> Result<(), PlanError> {
        self.end_batch(Continuation::take_memories(batch));
        Continuation::begin_anew(batch, |begun| self.begin_batch(begun))
    }

    /// Takes the memories of a batch back when its episodes are over, however they ended.
    fn end_batch(&self, _memories: Vec<Memory>) {}

    /// Fills the plan of every episode in the batch. An episode's plan may depend on this episode only.
    ///
    /// # Errors
    /// Only for failures of the whole batch; the failure of one episode goes into its `error`.
    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError>;
}

/// A simulator that plans one episode at a time; the batch interface is derived from it.
pub trait SingleEpisode: Send + Sync {
    /// Data kept between plans.
    type Memory: Any + Send;

    /// Returns the simulator's id, for messages.
    fn id(&self) -> &'static str;

    /// Creates the memory of an episode; called once before its first plan.
    fn begin(&self, start: &Start, stream: &mut Stream) -> Self::Memory;

    /// Returns the number of steps after which an episode continues from a new start, as
    /// [`Simulator::horizon`] does.
    fn horizon(&self) -> Option<usize> {
        None
    }

    /// Creates the memory of an episode in which agents entered or left, or whose horizon is over: `kept` has
    /// the slot that each agent of the new start had before. By default the episode begins anew.
    fn resume(
        &self,
        _before: Self::Memory,
        _kept: &[Option<usize>],
        start: &Start,
        stream: &mut Stream,
    ) -> Self::Memory {
        self.begin(start, stream)
    }

    /// Fills the plan of one episode.
    ///
    /// # Errors
    /// [`PlanError`] when planning fails for this episode.
    fn plan_one(&self, memory: &mut Self::Memory, episode: &mut Planning<'_, '_>) -> Result<(), PlanError>;
}

/// Outcome of a plan of an agent whose model found no finite numbers: the agent goes on as before.
pub const NOT_FINITE: &str = "not-finite";

/// Input and output of [`SingleEpisode::plan_one`]: an [`Episode`] without its memory.
pub struct Planning<'a, 'b> {
    /// The observation available for planning.
    pub seen: Observation<'a>,
    /// Random stream of this episode for choices during planning.
    pub stream: &'b mut Stream,
    /// Whether the simulator moves the AV too (realism protocol).
    pub moves_av: bool,
    /// Whether other simulators move some of the agents, which may therefore not have executed the plans.
    pub shares_traffic: bool,
    /// The plan to fill in.
    pub plan: &'b mut JointPlan,
    /// Counts of how parts of the plan ended, by outcome.
    pub outcomes: &'b mut BTreeMap<&'static str, u64>,
}

impl Planning<'_, '_> {
    /// Counts an outcome of a part of the plan.
    pub fn count(&mut self, outcome: &'static str) {
        *self.outcomes.entry(outcome).or_default() += 1;
    }
}

impl<S: SingleEpisode> Simulator for S {
    fn begin(&self, start: &Start, stream: &mut Stream) -> Memory {
        Memory::new(SingleEpisode::begin(self, start, stream))
    }

    fn horizon(&self) -> Option<usize> {
        SingleEpisode::horizon(self)
    }

    fn continue_batch(&self, batch: &mut [Continuation<'_>]) -> Result<(), PlanError> {
        for Continuation { before, kept, beginning } in batch {
            let Some(before) = before.take::<S::Memory>() else {
                return Err(PlanError::ForeignMemory(self.id()));
            };
            beginning.memory = Memory::new(self.resume(before, kept, beginning.start, &mut beginning.stream));
        }
        Ok(())
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        for episode in batch {
            let Some(memory) = episode.memory.get::<S::Memory>() else {
                episode.error = Some(PlanError::ForeignMemory(self.id()));
                continue;
            };
            let mut planning = Planning {
                seen: episode.seen,
                stream: &mut *episode.stream,
                moves_av: episode.moves_av,
                shares_traffic: episode.shares_traffic,
                plan: &mut episode.plan,
                outcomes: &mut episode.outcomes,
            };
            episode.error = self.plan_one(memory, &mut planning).err();
        }
        Ok(())
    }
}

/// A simulator with access to the log's future (log replay). Marked † in every table.
pub trait Oracle: Send + Sync {
    /// Creates the memory of an episode from the whole scenario, its future included.
    fn begin(&self, scenario: &Scenario) -> Memory;

    /// Fills the plan of every episode in the batch, like [`Simulator::plan`].
    ///
    /// # Errors
    /// As for [`Simulator::plan`].
    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError>;
}

/// The simulator that moves the agents.
pub enum Controller {
    /// A simulator without access to the log's future.
    Fair(Box<dyn Simulator>),
    /// A simulator with access to the log's future.
    Oracle(Box<dyn Oracle>),
}

impl Controller {
    /// Returns whether the simulator has access to the log's future.
    pub fn is_oracle(&self) -> bool {
        matches!(self, Self::Oracle(_))
    }
}
