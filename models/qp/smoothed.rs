//! A simulator followed by the stage.

use reactsim_baseline::{ModelError, Setup};
use reactsim_rollout::{
    Beginning, Continuation, Controller, Episode, JointPlan, Memory, PlanError, Simulator,
};
use reactsim_scene::{AgentState, named_enum};

use super::guard::GuardSettings;
use super::settings::Settings;
use super::stage::{Intent, KeepClear, Stage, is_planned, mode_of};

named_enum! {
    name, from_name;

    /// Variants of the stage that can follow a simulator; `--smooth` and simulator ids name them.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Smoothing {
        /// The full stage.
        Full = "qp",
        /// Without clearance to other agents: only smoothness, limits and the road.
        WithoutOthers = "qp-alone",
    }
}

/// Text of the card of the stage.
pub const CARD: &str = include_str!("stage.toml");
/// Text of the units and ranges of its parameters.
pub const RANGES: &str = include_str!("ranges.toml");
/// Id of the stage in errors.
const ID: &str = "qp";
/// Error message if the solver rejects the programs of the stage; a test rules this out.
pub const REFUSED: &str = "the solver refuses the programs of the stage `qp`";

impl Smoothing {
    /// Returns the id of a simulator followed by this stage.
    pub fn id(self, simulator: &str) -> String {
        format!("{simulator}+{}", self.name())
    }

    /// Splits an id into the simulator and the stage; `None` for an id without a stage.
    pub fn of_id(id: &str) -> Option<(&str, Self)> {
        let (simulator, stage) = id.rsplit_once('+')?;
        Some((simulator, Self::from_name(stage)?))
    }

    /// Returns the simulator followed by the stage.
    ///
    /// # Errors
    /// [`ModelError::TakesNoStage`] for a simulator that sees the log's future; the error of an invalid
    /// card, which a test rules out.
    pub fn behind(self, id: &'static str, controller: Controller) -> Result<Controller, ModelError> {
        let Controller::Fair(inner) = controller else { return Err(ModelError::TakesNoStage { id }) };
        let settings = settings()?;
        let keep_clear = match self {
            Self::Full => KeepClear::Everybody,
            Self::WithoutOthers => KeepClear::Nobody,
        };
        Ok(Controller::Fair(Box::new(Smoothed { inner, settings, follow: Follow::Plans(keep_clear) })))
    }
}

/// Returns a simulator whose vehicles execute their plans as they are while the guard finds a safe way out.
/// It must plan vehicles within the limits of the benchmark, and make plans of any number of steps.
///
/// # Errors
/// The error of an invalid card of the stage, which a test rules out.
pub fn guarded(inner: Box<dyn Simulator>, guard: GuardSettings) -> Result<Controller, ModelError> {
    Ok(Controller::Fair(Box::new(Smoothed { inner, settings: settings()?, follow: Follow::Guarded(guard) })))
}

/// How vehicles follow the inner simulator.
#[derive(Clone, Copy, Debug)]
enum Follow {
    /// They plan along its plans.
    Plans(KeepClear),
    /// They execute its plans unless the guard decides otherwise.
    Guarded(GuardSettings),
}

/// Reads the parameters of the card.
///
/// # Errors
/// [`ModelError`] for an invalid card, which a test rules out.
pub fn settings() -> Result<Settings, ModelError> {
    Setup::new(ID, CARD, RANGES, None)?.parameters()
}

/// A simulator followed by the stage.
struct Smoothed {
    inner: Box<dyn Simulator>,
    settings: Settings,
    follow: Follow,
}

/// Memory of an episode: that of the inner simulator, and the stage with its solvers.
struct EpisodeMemory {
    inner: Memory,
    stage: Option<Stage>,
}

impl Smoothed {
    /// Puts the memory of the inner simulator together with a new stage.
    fn add_stage(&self, memory: &mut Memory) {
        let inner = std::mem::take(memory);
        let stage = match self.follow {
            Follow::Plans(keep_clear) => Stage::new(&self.settings, keep_clear),
            Follow::Guarded(guard) => Stage::guarded(&self.settings, guard),
        };
        *memory = Memory::new(EpisodeMemory { inner, stage });
    }
}

impl Simulator for Smoothed {
    fn begin_batch(&self, batch: &mut [Beginning<'_>]) -> Result<(), PlanError> {
        self.inner.begin_batch(batch)?;
        batch.iter_mut().for_each(|episode| self.add_stage(&mut episode.memory));
        Ok(())
    }

    fn continue_batch(&self, batch: &mut [Continuation<'_>]) -> Result<(), PlanError> {
        for episode in batch.iter_mut() {
            let before = episode.before.take::<EpisodeMemory>();
            episode.before = before.map(|memory| memory.inner).unwrap_or_default();
        }
        self.inner.continue_batch(batch)?;
        batch.iter_mut().for_each(|episode| self.add_stage(&mut episode.beginning.memory));
        Ok(())
    }

    fn wants_identity(&self) -> bool {
        self.inner.wants_identity()
    }

    fn horizon(&self) -> Option<usize> {
        self.inner.horizon()
    }

    fn end_batch(&self, memories: Vec<Memory>) {
        let inner = |mut memory: Memory| memory.take::<EpisodeMemory>().map(|m| m.inner);
        self.inner.end_batch(memories.into_iter().filter_map(inner).collect());
    }

    fn plan(&self, batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        let mut inner: Vec<Episode<'_>> = Vec::with_capacity(batch.len());
        let mut outer: Vec<Outer<'_>> = Vec::with_capacity(batch.len());
        for episode in batch.iter_mut() {
            let Some(EpisodeMemory { inner: memory, stage }) = episode.memory.get::<EpisodeMemory>() else {
                episode.error = Some(PlanError::ForeignMemory(ID));
                continue;
            };
            let Some(stage) = stage else {
                episode.error = Some(PlanError::Failed(REFUSED.to_owned()));
                continue;
            };
            let steps = match self.follow {
                Follow::Plans(_) => episode.plan.steps(),
                Follow::Guarded(guard) => episode.plan.steps().max(guard.steps),
            };
            inner.push(Episode {
                seen: episode.seen,
                memory,
                stream: &mut *episode.stream,
                moves_av: episode.moves_av,
                shares_traffic: episode.shares_traffic,
                plan: JointPlan::with_outlook(episode.plan.agents(), steps, episode.plan.steps()),
                outcomes: std::mem::take(&mut episode.outcomes),
                error: None,
            });
            let (plan, error, outcomes) = (&mut episode.plan, &mut episode.error, &mut episode.outcomes);
            outer.push(Outer { plan, error, outcomes, stage });
        }
        self.inner.plan(&mut inner)?;
        for (episode, outer) in inner.into_iter().zip(outer) {
            *outer.outcomes = episode.outcomes;
            if episode.error.is_some() {
                *outer.error = episode.error;
                continue;
            }
            let agents = &episode.seen.start().agents;
            let (steps, proposed) = (outer.plan.steps(), episode.plan.steps());
            let intents: Vec<Intent> = (0..agents.len())
                .map(|slot| {
                    if slot == 0 && !episode.moves_av || episode.seen.state(slot).is_none() {
                        return Intent::None;
                    }
                    let states: Vec<AgentState> =
                        (0..proposed).map_while(|k| episode.plan.get(slot, k)).collect();
                    if states.is_empty() {
                        Intent::None
                    } else if !is_planned(agents[slot].kind) || states.len() < steps {
                        Intent::Fixed(states)
                    } else if let Follow::Guarded(_) = self.follow {
                        Intent::Guarded(states)
                    } else {
                        Intent::Vehicle(vec![mode_of(&states)])
                    }
                })
                .collect();
            let plans = outer.stage.plan(&episode.seen, &intents, steps);
            for (slot, plan) in plans.iter().enumerate() {
                for k in 0..steps {
                    let planned = plan.as_ref().and_then(|states| states.get(k)).copied();
                    outer.plan.set(slot, k, planned.or_else(|| episode.plan.get(slot, k)));
                }
            }
            outer.stage.take_endings().report(outer.outcomes);
        }
        Ok(())
    }
}

/// Parts of an episode that the inner simulator does not get.
struct Outer<'a> {
    plan: &'a mut JointPlan,
    error: &'a mut Option<PlanError>,
    outcomes: &'a mut std::collections::BTreeMap<&'static str, u64>,
    stage: &'a mut Stage,
}
