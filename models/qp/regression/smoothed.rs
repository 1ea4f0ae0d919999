//! Vehicles that plan along their predictions.

use burn::tensor::Device;
use reactsim_rollout::{NOT_FINITE, PlanError, Planning, SingleEpisode, Stream};
use reactsim_scene::{AgentState, FUTURE, Start};
use serde::{Deserialize, Serialize};

use super::follow::follow;
use super::policy::Policy;
use super::predict::Prediction;
use super::simulator::{EpisodeMemory, execute, predicted_slots};
use crate::{Intent, KeepClear, Mode, REFUSED, STEPS, Settings, Stage, is_planned};

/// Parameters of planning along predictions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanningParameters {
    /// Number of agents that the network predicts, those nearest to the AV first; the others follow
    /// their lane.
    pub agents: usize,
    /// Whether vehicles keep clear of the AV and of other agents; if not, plans are only smooth, within
    /// limits and on the road.
    pub keep_clear: bool,
}

/// Simulator whose vehicles plan along the predicted modes; pedestrians and cyclists execute the most
/// probable mode.
#[derive(Debug)]
pub struct QpRegressionSimulator {
    policy: Policy,
    parameters: PlanningParameters,
    settings: Settings,
    device: Device,
}

impl QpRegressionSimulator {
    /// Creates a simulator with a policy whose weights are on this device; `settings` are those of the
    /// stage.
    pub fn new(policy: Policy, parameters: PlanningParameters, settings: Settings, device: Device) -> Self {
        Self { policy, parameters, settings, device }
    }

    /// Returns the stage that plans for this simulator; `None` if the solver rejects its programs,
    /// which a test rules out.
    pub fn stage(&self) -> Option<Stage> {
        let keep_clear = if self.parameters.keep_clear { KeepClear::Everybody } else { KeepClear::Nobody };
        Stage::new(&self.settings, keep_clear)
    }

    /// Returns the memory of an episode that begins, for [`Self::intents`].
    pub fn memory(&self, start: &Start) -> EpisodeMemory {
        EpisodeMemory::new(self.policy.ground(start))
    }

    /// Returns the intent of every agent from now on, one entry per slot.
    pub fn intents(&self, memory: &mut EpisodeMemory, episode: &mut Planning<'_, '_>) -> Vec<Intent> {
        let seen = episode.seen;
        let slots = predicted_slots(&seen, episode.moves_av, self.parameters.agents);
        let predictions = memory.predict(&self.policy, &seen, &slots, &self.device);
        let mut predictions = predictions.into_iter().peekable();
        let agents = &seen.start().agents;
        let steps = episode.plan.steps().max(STEPS);
        let mut intents = vec![Intent::None; agents.len()];
        for (slot, intent) in intents.iter_mut().enumerate() {
            let prediction = predictions.next_if(|p| p.slot == slot);
            let Some(now) = seen.state(slot).filter(|_| slot > 0 || episode.moves_av) else { continue };
            let kind = agents[slot].kind;
            let most_probable = prediction.as_ref().and_then(|p| p.modes.first());
            if prediction.is_some() && most_probable.is_none() {
                episode.count(NOT_FINITE);
            }
            let states = match most_probable {
                Some(mode) => execute(mode, kind, now, steps),
                None => follow(&seen, slot, now, steps),
            };
            *intent = match prediction {
                _ if !is_planned(kind) => Intent::Fixed(states),
                Some(p) if !p.modes.is_empty() && !stays(&states, &now) => Intent::Vehicle(stage_modes(&p)),
                _ => Intent::Vehicle(vec![Mode::of(states.iter().map(AgentState::position).collect())]),
            };
        }
        intents
    }
}

/// Memory of an episode, and the stage that plans for it.
pub struct StagedMemory {
    memory: EpisodeMemory,
    stage: Option<Stage>,
}

impl SingleEpisode for QpRegressionSimulator {
    type Memory = StagedMemory;

    fn id(&self) -> &'static str {
        "qp-regression"
    }

    fn begin(&self, start: &Start, _stream: &mut Stream) -> StagedMemory {
        StagedMemory { memory: self.memory(start), stage: self.stage() }
    }

    fn horizon(&self) -> Option<usize> {
        Some(FUTURE)
    }

    fn plan_one(&self, memory: &mut StagedMemory, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let Some(stage) = &mut memory.stage else { return Err(PlanError::Failed(REFUSED.to_owned())) };
        let intents = self.intents(&mut memory.memory, episode);
        let plans = stage.plan(&episode.seen, &intents, episode.plan.steps());
        for (slot, plan) in plans.into_iter().enumerate() {
            for (k, state) in plan.into_iter().flatten().take(episode.plan.steps()).enumerate() {
                episode.plan.set(slot, k, Some(state));
            }
        }
        stage.take_endings().report(episode.outcomes);
        Ok(())
    }
}

/// Returns whether all states keep the present position.
fn stays(states: &[AgentState], now: &AgentState) -> bool {
    states.iter().all(|s| s.position() == now.position())
}

/// Converts the modes of a prediction to modes of the stage.
fn stage_modes(prediction: &Prediction) -> Vec<Mode> {
    let stage_mode = |mode: &super::predict::Mode| {
        let points = &mode.points[..STEPS.min(mode.points.len())];
        let mut direction = reactsim_geometry::direction(prediction.pose.heading);
        let mut before = prediction.pose.position;
        let sigmas = points.iter().map(|p| {
            // Slow motion has no direction of its own.
            if let Some(ahead) = (p.position - before).try_normalize(0.02) {
                direction = ahead;
            }
            before = p.position;
            [p.deviation(direction), p.deviation(reactsim_geometry::left(direction))]
        });
        Mode {
            sigmas: Some(sigmas.collect()),
            points: points.iter().map(|p| p.position).collect(),
            probability: mode.probability,
        }
    };
    prediction.modes.iter().map(stage_mode).collect()
}
