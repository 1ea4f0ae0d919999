//! Simulators, and what they are handed.

use std::any::Any;
use std::collections::BTreeMap;

use super::{Observation, Stream};
use crate::scene::{Frame, Scenario, Start};

/// What a simulator keeps between two plans of one episode: routes, caches.
pub struct Memory(Option<Box<dyn Any + Send>>);

impl Memory {
    /// Nothing to keep.
    pub const NONE: Self = Self(None);

    /// Keeps a value.
    pub fn new<T: Any + Send>(value: T) -> Self {
        Self(Some(Box::new(value)))
    }

    /// The value, if it is of this type.
    pub fn get<T: Any>(&mut self) -> Option<&mut T> {
        self.0.as_mut()?.downcast_mut()
    }
}

/// Planned states of all agents for some steps, to be filled. Slot 0 is executed only where the simulator moves the AV.
#[derive(Clone, Debug, PartialEq)]
pub struct JointPlan {
    agents: usize,
    steps: usize,
    states: Vec<Frame>,
}

impl JointPlan {
    /// A plan in which every agent is absent.
    pub fn new(agents: usize, steps: usize) -> Self {
        Self { agents, steps, states: vec![None; agents * steps] }
    }

    /// Number of agents.
    pub fn agents(&self) -> usize {
        self.agents
    }

    /// Number of steps.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Sets the state of an agent after `step` + 1 steps. Velocities are recomputed by the engine from the positions.
    pub fn set(&mut self, agent: usize, step: usize, state: Frame) {
        self.states[agent * self.steps + step] = state;
    }

    /// The planned state of an agent after `step` + 1 steps.
    pub fn get(&self, agent: usize, step: usize) -> Frame {
        self.states[agent * self.steps + step]
    }
}

/// Why a plan could not be made for one episode.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// The simulator gave up; the text names what and why.
    #[error("{0}")]
    Failed(String),
    /// The simulator was handed an episode that it had not begun.
    #[error("simulator `{0}` was handed the memory of another simulator")]
    ForeignMemory(&'static str),
}

/// One scenario in the course of a rollout, as a simulator is handed it.
pub struct Episode<'a> {
    /// What may be seen.
    pub seen: Observation<'a>,
    /// What the simulator keeps.
    pub memory: &'a mut Memory,
    /// The stream of this episode for choices made while planning.
    pub stream: &'a mut Stream,
    /// Whether the simulator moves the AV too (realism protocol).
    pub moves_av: bool,
    /// To be filled.
    pub plan: JointPlan,
    /// How parts of the plan ended (a fallback taken, a solve not quite solved): counted and reported.
    pub outcomes: BTreeMap<&'static str, u64>,
    /// Set where no plan could be made; only this episode fails.
    pub error: Option<PlanError>,
}

/// A simulator: moves every agent but the AV (or every agent, in the realism protocol).
pub trait Simulator: Send + Sync {
    /// What this simulator keeps for an episode; called once before its first plan.
    fn begin(&self, _start: &Start, _stream: &mut Stream) -> Memory {
        Memory::NONE
    }

    /// Fills the plan of every episode in the batch. An episode's plan may depend on this episode only.
    ///
    /// # Errors
    /// Only for what makes every episode impossible; what concerns one is set as its `error`.
    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError>;
}

/// A simulator that looks at one episode at a time; it gets the batch for free.
pub trait SingleEpisode: Send + Sync {
    /// What it keeps between plans.
    type Memory: Any + Send;

    /// Its id, for messages.
    fn id(&self) -> &'static str;

    /// Called once before the first plan.
    fn begin(&self, start: &Start, stream: &mut Stream) -> Self::Memory;

    /// Fills the plan of one episode.
    ///
    /// # Errors
    /// [`PlanError`] when there is no plan for this episode.
    fn plan_one(&self, memory: &mut Self::Memory, episode: &mut Planning<'_, '_>) -> Result<(), PlanError>;
}

/// What [`SingleEpisode::plan_one`] reads and fills: an [`Episode`] without its memory.
pub struct Planning<'a, 'b> {
    /// What may be seen.
    pub seen: Observation<'a>,
    /// The stream of this episode for choices made while planning.
    pub stream: &'b mut Stream,
    /// Whether the simulator moves the AV too (realism protocol).
    pub moves_av: bool,
    /// To be filled.
    pub plan: &'b mut JointPlan,
    /// How parts of the plan ended.
    pub outcomes: &'b mut BTreeMap<&'static str, u64>,
}

impl<S: SingleEpisode> Simulator for S {
    fn begin(&self, start: &Start, stream: &mut Stream) -> Memory {
        Memory::new(SingleEpisode::begin(self, start, stream))
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
                plan: &mut episode.plan,
                outcomes: &mut episode.outcomes,
            };
            episode.error = self.plan_one(memory, &mut planning).err();
        }
        Ok(())
    }
}

/// A simulator that is shown the log's future (log replay). Marked † in every table.
pub trait Oracle: Send + Sync {
    /// What it keeps for an episode, made with full sight of the scenario.
    fn begin(&self, scenario: &Scenario) -> Memory;

    /// As [`Simulator::plan`].
    ///
    /// # Errors
    /// As [`Simulator::plan`].
    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError>;
}

/// Who moves the agents.
pub enum Controller {
    /// Knows what was known.
    Fair(Box<dyn Simulator>),
    /// Knows the log's future.
    Oracle(Box<dyn Oracle>),
}

impl Controller {
    /// Whether it is shown the log's future.
    pub fn is_oracle(&self) -> bool {
        matches!(self, Self::Oracle(_))
    }
}
