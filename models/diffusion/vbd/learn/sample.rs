//! Training samples: scenes, and what agents did in them.

use reactsim_geometry::{Vec2, direction, into_frame, wrap};
use reactsim_nn::learning::{Intentions, LearningScene, Window};
use reactsim_nn::perception::KnownMap;
use reactsim_nn::training::Stream;
use reactsim_scene::{Agent, AgentState, FUTURE, Frame, Scenario};

use super::super::inputs::Seen;
use super::Recipe;
use crate::{actions, normalized};

/// Numbers of a true state: x, y, yaw.
pub(super) const TRUTH: usize = 3;
/// Numbers of the AV at a state.
pub(super) const AV: usize = 6;
/// Distance between boxes that agents are to keep, metres.
const MARGIN: f64 = 0.3;

/// Training sample of one scene.
#[derive(Clone, Debug, Default)]
pub struct Sample {
    pub(super) seen: Seen,
    /// Normalised actions, `[agents, actions, 2]`; 0 where unknown.
    pub(super) actions: Vec<f32>,
    /// True states in the frames of the agents, `[agents, states, 3]`: x, y (m), yaw (rad); 0 where unknown.
    pub(super) truth: Vec<f32>,
    /// Weights of these states, `[agents, states]`: those of an agent add up to the agent's weight.
    pub(super) weights: Vec<f32>,
    /// The AV at these states, in the frames of the agents, `[agents, states, 6]`: x, y (m), cosine and sine
    /// of the agent's true yaw, and distances along and across it (m) below both of which the two overlap; 0
    /// where they do in truth, or where one of them is unknown.
    pub(super) av: Vec<f32>,
    /// Weight of each agent; 0 if nothing is known of what it did.
    pub(super) agents: Vec<f32>,
    /// Anchor that each agent headed for.
    pub(super) headings: Vec<usize>,
}

/// Builds the sample of a scenario, augmented by draws from the stream, or as logged. `None` if there is
/// nothing to learn.
pub(super) fn sample(
    scenario: &Scenario,
    recipe: &Recipe,
    anchors: &Intentions,
    mut varied: Option<&mut Stream>,
) -> Option<Sample> {
    let window = Window::of(scenario, varied.as_deref_mut());
    let map = recipe.sight.map(&window.start);
    let scene = LearningScene::<KnownMap>::of(window, map);
    let (scene, now) = scene.augmented(&recipe.augmentation, varied);
    let (scene, map) = scene.split_map();
    let lights = scene.lights_at(now);
    let view = scene.view(&scene.tracks, now, false, &lights);
    let seen = Seen::of(&view, &map, &recipe.sight)?;
    let mut sample = Sample { seen, ..Sample::default() };
    let av = sample.seen.states[0].position();
    for i in 0..sample.seen.slots.len() {
        let slot = sample.seen.slots[i];
        let parked = if scene.is_parked(slot) { recipe.parked } else { 1.0 };
        // The benchmark judges reactions to the AV, so agents near it matter most.
        let away = (sample.seen.states[i].position() - av).norm() / recipe.near;
        let weight = parked / (1.0 + away * away);
        sample.add(i, &scene.tracks[slot], now, weight, recipe, anchors);
        let (tracks, agents) =
            ([&scene.tracks[slot], &scene.tracks[0]], [&scene.agents[slot], &scene.agents[0]]);
        sample.add_av(i, tracks.map(Vec::as_slice), agents, now, recipe.network.states());
    }
    sample.agents.iter().any(|weight| *weight > 0.0).then_some(sample)
}

impl Sample {
    /// Adds where the AV was while an agent moved. `tracks` and `agents` are those of the agent and of the
    /// AV.
    fn add_av(
        &mut self,
        agent: usize,
        tracks: [&[Frame]; 2],
        agents: [&Agent; 2],
        now: usize,
        states: usize,
    ) {
        let from = self.seen.states[agent];
        let axis = direction(from.heading);
        for frame in now + 1..=now + states {
            let state = |track: &[Frame]| track.get(frame).copied().flatten();
            let numbers = match (state(tracks[0]), state(tracks[1])) {
                (Some(own), Some(av)) if agent > 0 => {
                    let ahead = direction(own.heading);
                    let apart = into_frame(ahead, av.position() - own.position());
                    let reach = reach(agents, wrap(av.heading - own.heading));
                    let overlap = apart.x.abs() < reach.x && apart.y.abs() < reach.y;
                    let reach = if overlap { Vec2::zeros() } else { reach };
                    let at = into_frame(axis, av.position() - from.position());
                    let ahead = into_frame(axis, ahead);
                    [at.x, at.y, ahead.x, ahead.y, reach.x, reach.y]
                }
                _ => [0.0; AV],
            };
            self.av.extend(numbers.map(|v| v as f32));
        }
    }

    /// Adds what an agent did.
    fn add(
        &mut self,
        agent: usize,
        track: &[Frame],
        now: usize,
        weight: f64,
        recipe: &Recipe,
        anchors: &Intentions,
    ) {
        let from = self.seen.states[agent];
        let states = recipe.network.states();
        // The current state has a velocity, even if the recorded one has none.
        let mut future: Vec<Frame> = track.iter().skip(now).take(FUTURE + 1).copied().collect();
        future.resize(FUTURE + 1, None);
        future[0] = Some(from);
        for value in actions(&future[..=states], recipe.network.hold).values {
            self.actions.extend(normalized(value));
        }
        let axis = direction(from.heading);
        let local = |s: &AgentState| {
            (into_frame(axis, s.position() - from.position()), wrap(s.heading - from.heading))
        };
        let first = self.weights.len();
        for state in &future[1..=states] {
            let (at, yaw) = state.as_ref().map(local).unwrap_or_default();
            self.truth.extend([at.x, at.y, yaw].map(|v| v as f32));
            self.weights.push(f32::from(state.is_some()));
        }
        let known: f32 = self.weights[first..].iter().sum();
        let weight = if known > 0.0 { weight as f32 } else { 0.0 };
        self.weights[first..].iter_mut().for_each(|w| *w *= weight / known.max(1.0));
        let last = future[1..].iter().flatten().next_back().map(|s| local(s).0);
        self.agents.push(weight);
        self.headings.push(anchors.nearest(self.seen.classes[agent], last.unwrap_or_default()));
    }
}

/// Returns the distances of two centres along and across the first agent, metres, below both of which the
/// boxes come closer than they should. The second agent is turned by this angle against the first.
fn reach(agents: [&Agent; 2], turn: f64) -> Vec2 {
    let [own, other] = agents.map(|agent| Vec2::new(agent.length, agent.width) * 0.5);
    let ahead = direction(turn);
    let (cos, sin) = (ahead.x.abs(), ahead.y.abs());
    let turned = Vec2::new(other.x * cos + other.y * sin, other.x * sin + other.y * cos);
    own + turned + Vec2::new(MARGIN, MARGIN)
}
