//! Agents that execute their predictions.

use burn::tensor::Device;
use rand::RngExt;
use reactsim_geometry::{direction, heading_of};
use reactsim_nn::perception::Nearest;
use reactsim_rollout::{NOT_FINITE, Observation, PlanError, Planning, SingleEpisode, Stream};
use reactsim_scene::dynamics::STANDSTILL_SPEED;
use reactsim_scene::levels::RoadHeights;
use reactsim_scene::{AgentKind, AgentState, DT, FUTURE, Start};
use serde::{Deserialize, Serialize};

use super::follow::follow;
use super::policy::{Ground, Policy};
use super::predict::{Mode, Prediction};

/// Parameters of executing predictions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Driving {
    /// Number of agents that the network predicts, those nearest to the AV first; the others follow
    /// their lane.
    pub agents: usize,
    /// Whether the mode is drawn by its probability; otherwise it is the most probable one.
    pub sample: bool,
}

/// Simulator whose agents execute the predictions of the network as they are.
#[derive(Debug)]
pub struct RegressionSimulator {
    policy: Policy,
    driving: Driving,
    device: Device,
}

/// Speed in m/s above which the heading follows the motion; at lower speeds the direction is mostly
/// noise.
const MIN_HEADING_SPEED: f64 = 0.5;
/// Distance in metres: a standing agent stays if its prediction for the next second is shorter.
const SET_OFF_DISTANCE: f64 = 0.2;
/// Index of the point of a mode after that second.
const SET_OFF_STEP: usize = 9;
/// Longest time, in steps, for which an agent that stands is not predicted again.
const MAX_REST: usize = 5;
/// Displacement in metres since the first frame below which an agent counts as parked.
const PARKED_DISPLACEMENT: f64 = 0.1;
/// Distance handicap in metres: parked agents are predicted after others that are up to this much farther
/// from the AV.
const PARKED_HANDICAP: f64 = 40.0;

impl RegressionSimulator {
    /// Creates a simulator with a policy whose weights are on this device.
    pub fn new(policy: Policy, driving: Driving, device: Device) -> Self {
        Self { policy, driving, device }
    }
}

/// Returns the slots of the agents to predict, at most `most`, in ascending order: the AV if the
/// simulator moves it, then the agents nearest to it. Agents that have never moved count as farther
/// away.
pub fn predicted_slots(seen: &Observation<'_>, moves_av: bool, most: usize) -> Vec<usize> {
    let Some(av) = seen.state(0) else { return Vec::new() };
    let agents = &seen.start().agents;
    let mut nearest = Nearest::new(most);
    if moves_av {
        nearest.offer(-1.0, 0);
    }
    for (slot, agent) in agents.iter().enumerate().skip(1) {
        let Some(state) = seen.state(slot).filter(|_| agent.kind != AgentKind::Other) else { continue };
        let first = seen.track(slot).iter().flatten().next();
        let parked = first.is_none_or(|f| (f.position() - state.position()).norm() < PARKED_DISPLACEMENT);
        let handicap = if parked { PARKED_HANDICAP } else { 0.0 };
        nearest.offer((state.position() - av.position()).norm() + handicap, slot);
    }
    let mut slots: Vec<usize> = nearest.found().collect();
    slots.sort_unstable();
    slots
}

/// Memory of an episode.
#[derive(Debug)]
pub struct EpisodeMemory {
    ground: Ground,
    /// Heights of the road under agents.
    heights: RoadHeights,
    /// For each slot, the last frame at which the agent rests and is not predicted.
    resting: Vec<usize>,
}

impl EpisodeMemory {
    /// Creates the memory of an episode that begins.
    pub(super) fn new(ground: Ground) -> Self {
        Self { ground, heights: RoadHeights::default(), resting: Vec::new() }
    }

    /// Predicts the agents of these slots, except agents that rest.
    pub(super) fn predict(
        &mut self,
        policy: &Policy,
        seen: &Observation<'_>,
        slots: &[usize],
        device: &Device,
    ) -> Vec<Prediction> {
        let now = seen.frame();
        self.resting.resize(seen.start().agents.len(), 0);
        let mut asked = slots.to_vec();
        asked.retain(|&slot| now > self.resting[slot] || !stands(seen, slot));
        let predictions = policy.predict(seen, &self.ground, &mut self.heights, &asked, device);
        for p in predictions.iter().filter(|p| stands(seen, p.slot)) {
            self.resting[p.slot] = now + p.modes.first().map_or(0, |mode| rest(mode, p));
        }
        predictions
    }
}

/// Returns whether an agent stands now.
fn stands(seen: &Observation<'_>, slot: usize) -> bool {
    seen.state(slot).and_then(|s| s.velocity()).is_some_and(|v| v.norm() < STANDSTILL_SPEED)
}

/// Returns for how many steps, at most [`MAX_REST`], [`execute`] would have an agent stay if it followed this
/// mode.
fn rest(mode: &Mode, prediction: &Prediction) -> usize {
    let stays = |steps: &usize| {
        let point = mode.points.get(steps + SET_OFF_STEP).or(mode.points.last());
        point.is_some_and(|p| (p.position - prediction.pose.position).norm() < SET_OFF_DISTANCE)
    };
    (1..=MAX_REST).take_while(stays).count()
}

impl SingleEpisode for RegressionSimulator {
    type Memory = EpisodeMemory;

    fn id(&self) -> &'static str {
        "regression"
    }

    fn begin(&self, start: &Start, _stream: &mut Stream) -> EpisodeMemory {
        EpisodeMemory::new(self.policy.ground(start))
    }

    fn horizon(&self) -> Option<usize> {
        Some(FUTURE)
    }

    // One episode at a time: a dozen agents are enough for matrix products of a good size, and the
    // result does not depend on the rest of a batch.
    fn plan_one(&self, memory: &mut EpisodeMemory, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let seen = episode.seen;
        let slots = predicted_slots(&seen, episode.moves_av, self.driving.agents);
        let mut predictions =
            memory.predict(&self.policy, &seen, &slots, &self.device).into_iter().peekable();
        let steps = episode.plan.steps();
        for slot in 0..episode.plan.agents() {
            let prediction = predictions.next_if(|p| p.slot == slot);
            let Some(now) = seen.state(slot) else { continue };
            let mode = prediction.as_ref().and_then(|p| self.choose(p, episode.stream));
            let kind = seen.start().agents[slot].kind;
            let states = match (&prediction, mode) {
                (Some(_), Some(mode)) => execute(mode, kind, now, steps),
                (Some(_), None) => {
                    episode.count(NOT_FINITE);
                    follow(&seen, slot, now, steps)
                }
                (None, _) => follow(&seen, slot, now, steps),
            };
            for (k, state) in states.into_iter().enumerate() {
                episode.plan.set(slot, k, Some(state));
            }
        }
        Ok(())
    }
}

impl RegressionSimulator {
    fn choose<'p>(&self, prediction: &'p Prediction, stream: &mut Stream) -> Option<&'p Mode> {
        if !self.driving.sample {
            return prediction.modes.first();
        }
        let mut left = stream.random::<f64>();
        let drawn = prediction.modes.iter().find(|mode| {
            left -= mode.probability;
            left < 0.0
        });
        drawn.or(prediction.modes.first())
    }
}

/// Returns the states of an agent that follows a mode.
pub(super) fn execute(mode: &Mode, kind: AgentKind, now: AgentState, steps: usize) -> Vec<AgentState> {
    let stands = now.velocity().is_none_or(|v| v.norm() < STANDSTILL_SPEED);
    let soon = mode.points.get(SET_OFF_STEP).or(mode.points.last());
    if stands && soon.is_none_or(|p| (p.position - now.position()).norm() < SET_OFF_DISTANCE) {
        return vec![AgentState { vx: 0.0, vy: 0.0, ..now }; steps];
    }
    let mut last = now;
    let mut states = Vec::with_capacity(steps);
    for k in 0..steps {
        // Beyond the prediction every agent stays.
        let at = mode.points.get(k).map_or(last.position(), |p| p.position);
        let velocity = (at - last.position()) / DT;
        let mut heading = last.heading;
        if velocity.norm() > MIN_HEADING_SPEED {
            // Vehicles and cyclists may roll backwards; pedestrians turn around.
            let backwards = velocity.dot(&direction(heading)) < 0.0;
            if !backwards || kind == AgentKind::Pedestrian {
                heading = heading_of(velocity);
            }
        }
        last = AgentState { x: at.x, y: at.y, heading, vx: velocity.x, vy: velocity.y };
        states.push(last);
    }
    states
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;
    use reactsim_scene::dynamics::Pose;

    use super::super::predict::ModePoint;
    use super::*;

    #[test]
    fn agents_rest_until_they_are_to_set_off() {
        // Stays for `frames` frames, then leaves at 5 m/s.
        let rest_before_leaving_at = |frames: usize| {
            let x = |k: usize| 0.5 * (k + 1).saturating_sub(frames) as f64;
            let point = |k| ModePoint { position: Vec2::new(3.0 + x(k), 4.0), covariance: [0.0; 3] };
            let mode = Mode { probability: 1.0, points: (0..80).map(point).collect() };
            let pose = Pose { position: Vec2::new(3.0, 4.0), heading: 0.0 };
            let prediction = Prediction { slot: 1, pose, velocity: Vec2::zeros(), modes: vec![mode.clone()] };
            rest(&mode, &prediction)
        };
        let found = [0, 10, 11, 12, 15, 16, 80].map(rest_before_leaving_at);
        assert_eq!(found, [0, 0, 1, 2, 5, 5, 5]);
    }
}
