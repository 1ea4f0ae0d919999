//! Agents that do what is predicted of them.

use burn::tensor::Device;
use rand::RngExt;
use reactsim::geometry::{direction, heading_of};
use reactsim::rollout::{Observation, PlanError, Planning, SingleEpisode, Stream};
use reactsim::scene::{AgentKind, AgentState, DT, Start};
use serde::{Deserialize, Serialize};

use super::follow::follow;
use super::inputs::Ground;
use super::policy::Policy;
use super::predict::{Mode, Prediction};
use crate::models::ntp::reactive::links::Nearest;

/// How predictions become motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Driving {
    /// How many agents the network is asked about, nearest to the AV first; the others follow their lane.
    pub agents: usize,
    /// Whether the mode is drawn by its probability; else it is the most probable one.
    pub sample: bool,
}

/// Agents that execute what the network predicts, as it is.
#[derive(Debug)]
pub struct RegressionSimulator {
    policy: Policy,
    driving: Driving,
    device: Device,
}

/// Headings come from motion that is faster than this, m/s: slower it is mostly noise.
const TURNS: f64 = 0.5;
/// Who stands now and is predicted to go less far than this in the next second stays, m/s and metres.
const STANDS: f64 = 0.1;
const SETS_OFF: f64 = 0.2;
/// Who has not moved since the first frame is asked about after others who are so much farther away, metres.
const PARKED: f64 = 40.0;

impl RegressionSimulator {
    /// A simulator of this policy, whose weights are on this device.
    pub fn new(policy: Policy, driving: Driving, device: Device) -> Self {
        Self { policy, driving, device }
    }
}

/// The slots of the agents that the network is asked about, at most so many: the AV where the simulator moves it, then those nearest to it,
/// where who has never moved counts as farther away. In ascending order.
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
        let parked = first.is_none_or(|f| (f.position() - state.position()).norm() < STANDS);
        let farther = if parked { PARKED } else { 0.0 };
        nearest.offer((state.position() - av.position()).norm() + farther, slot);
    }
    let mut slots: Vec<usize> = nearest.found().collect();
    slots.sort_unstable();
    slots
}

impl SingleEpisode for RegressionSimulator {
    type Memory = Ground;

    fn id(&self) -> &'static str {
        "regression"
    }

    fn begin(&self, start: &Start, _stream: &mut Stream) -> Ground {
        self.policy.ground(start)
    }

    // One episode at a time: it has a dozen agents, enough for products of a good size, and nothing hangs on what else is in a batch.
    fn plan_one(&self, ground: &mut Ground, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let seen = episode.seen;
        let slots = predicted_slots(&seen, episode.moves_av, self.driving.agents);
        let mut predictions = self.policy.predict(&seen, ground, &slots, &self.device).into_iter().peekable();
        let steps = episode.plan.steps();
        for slot in 0..episode.plan.agents() {
            let prediction = predictions.next_if(|p| p.slot == slot);
            let Some(now) = seen.state(slot) else { continue };
            let mode = prediction.as_ref().and_then(|p| self.choose(p, episode.stream));
            let kind = seen.start().agents[slot].kind;
            let states = match (&prediction, mode) {
                (Some(_), Some(mode)) => execute(mode, kind, now, steps),
                (Some(_), None) => {
                    let what = "predictions that are no numbers: went on as before";
                    *episode.outcomes.entry(what).or_default() += 1;
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

/// The states of somebody who does what a mode says.
pub(super) fn execute(mode: &Mode, kind: AgentKind, now: AgentState, steps: usize) -> Vec<AgentState> {
    let stands = now.velocity().is_none_or(|v| v.norm() < STANDS);
    let soon = mode.points.get(9).or(mode.points.last());
    if stands && soon.is_none_or(|p| (p.position - now.position()).norm() < SETS_OFF) {
        return vec![AgentState { vx: 0.0, vy: 0.0, ..now }; steps];
    }
    let mut last = now;
    let mut states = Vec::with_capacity(steps);
    for k in 0..steps {
        // Beyond what is predicted everybody stays.
        let at = mode.points.get(k).map_or(last.position(), |p| p.position);
        let velocity = (at - last.position()) / DT;
        let mut heading = last.heading;
        if velocity.norm() > TURNS {
            // Wheels may roll backwards; people turn round.
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
