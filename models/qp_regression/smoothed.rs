//! Vehicles that drive plans made of what is predicted of them.

use burn::tensor::Device;
use reactsim::models::qp::{Intent, KeepClear, Mode, REFUSED, STEPS, Settings, Stage, is_planned};
use reactsim::rollout::{PlanError, Planning, SingleEpisode, Stream};
use reactsim::scene::{AgentState, Start};
use serde::{Deserialize, Serialize};

use super::follow::follow;
use super::inputs::Ground;
use super::policy::Policy;
use super::predict::Prediction;
use super::simulator::{execute, predicted_slots};

/// How predictions become plans.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Smooth {
    /// How many agents the network is asked about, nearest to the AV first; the others follow their lane.
    pub agents: usize,
    /// Whether vehicles keep clear of the AV and of others, or are smooth, within limits and on the road alone.
    pub keep_clear: bool,
}

/// Vehicles plan along the modes that the network predicts; people on foot and on bicycles execute the most probable one.
#[derive(Debug)]
pub struct QpRegressionSimulator {
    policy: Policy,
    smooth: Smooth,
    settings: Settings,
    device: Device,
}

impl QpRegressionSimulator {
    /// A simulator of this policy, whose weights are on this device; `settings` are those of the stage.
    pub fn new(policy: Policy, smooth: Smooth, settings: Settings, device: Device) -> Self {
        Self { policy, smooth, settings, device }
    }

    /// The stage that plans for this simulator; `None` where the solver refuses its programs, which a test excludes.
    pub fn stage(&self) -> Option<Stage> {
        let keep_clear = if self.smooth.keep_clear { KeepClear::Everybody } else { KeepClear::Nobody };
        Stage::new(&self.settings, keep_clear)
    }

    /// What is known of a scenario's map, for [`Self::intents`].
    pub fn ground(&self, start: &Start) -> Ground {
        self.policy.ground(start)
    }

    /// What every agent would like to do from now on, one entry per slot.
    pub fn intents(&self, ground: &Ground, episode: &mut Planning<'_, '_>) -> Vec<Intent> {
        let seen = episode.seen;
        let slots = predicted_slots(&seen, episode.moves_av, self.smooth.agents);
        let predictions = self.policy.predict(&seen, ground, &slots, &self.device);
        let mut predictions = predictions.into_iter().peekable();
        let agents = &seen.start().agents;
        let steps = episode.plan.steps().max(STEPS);
        let mut intents = vec![Intent::None; agents.len()];
        for (slot, intent) in intents.iter_mut().enumerate() {
            let prediction = predictions.next_if(|p| p.slot == slot);
            let Some(now) = seen.state(slot).filter(|_| slot > 0 || episode.moves_av) else { continue };
            let kind = agents[slot].kind;
            let likeliest = prediction.as_ref().and_then(|p| p.modes.first());
            if prediction.is_some() && likeliest.is_none() {
                let what = "predictions that are no numbers: went on as before";
                *episode.outcomes.entry(what).or_default() += 1;
            }
            let states = match likeliest {
                Some(mode) => execute(mode, kind, now, steps),
                None => follow(&seen, slot, now, steps),
            };
            *intent = match prediction {
                _ if !is_planned(kind) => Intent::Fixed(states),
                Some(p) if !p.modes.is_empty() && !stays(&states, &now) => Intent::Vehicle(wishes(&p)),
                _ => Intent::Vehicle(vec![Mode::of(states.iter().map(AgentState::position).collect())]),
            };
        }
        intents
    }
}

/// What an episode keeps.
pub struct Kept {
    ground: Ground,
    stage: Option<Stage>,
}

impl SingleEpisode for QpRegressionSimulator {
    type Memory = Kept;

    fn id(&self) -> &'static str {
        "qp-regression"
    }

    fn begin(&self, start: &Start, _stream: &mut Stream) -> Kept {
        Kept { ground: self.policy.ground(start), stage: self.stage() }
    }

    fn plan_one(&self, kept: &mut Kept, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let Some(stage) = &mut kept.stage else { return Err(PlanError::Failed(REFUSED.to_owned())) };
        let intents = self.intents(&kept.ground, episode);
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

/// Whether somebody who stands is to stay.
fn stays(states: &[AgentState], now: &AgentState) -> bool {
    states.iter().all(|s| s.position() == now.position())
}

/// The modes of a prediction as the stage takes them.
fn wishes(prediction: &Prediction) -> Vec<Mode> {
    let wish = |mode: &super::predict::Mode| {
        let points = &mode.points[..STEPS.min(mode.points.len())];
        let mut course = reactsim::geometry::direction(prediction.pose.heading);
        let mut before = prediction.pose.position;
        let sigmas = points.iter().map(|p| {
            // Slow motion has no direction of its own.
            if let Some(ahead) = (p.position - before).try_normalize(0.02) {
                course = ahead;
            }
            before = p.position;
            [p.deviation(course), p.deviation(reactsim::geometry::left(course))]
        });
        Mode {
            sigmas: Some(sigmas.collect()),
            points: points.iter().map(|p| p.position).collect(),
            probability: mode.probability,
        }
    };
    prediction.modes.iter().map(wish).collect()
}
