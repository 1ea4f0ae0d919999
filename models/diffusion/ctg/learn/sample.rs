//! Training samples: what agents saw and did.

use reactsim_geometry::{direction, into_frame, wrap};
use reactsim_nn::learning::{LearningScene, Window};
use reactsim_nn::training::Stream;
use reactsim_scene::{AgentState, Frame, Scenario};

use super::super::inputs::Seen;
use super::super::network::{CtgConfig, normalized_state};
use super::super::raster::{Ground, GroundShapes};
use super::Recipe;
use crate::{actions, normalized};

/// Training sample of one scene.
#[derive(Clone, Debug, Default)]
pub struct Sample {
    pub(super) seen: Seen,
    /// True trajectories as the network's, `[agents, actions, 6]`; 0 where unknown.
    pub(super) truth: Vec<f32>,
    /// Weights of their steps, `[agents, actions]`: those of an agent add up to the agent's weight.
    pub(super) weights: Vec<f32>,
    /// Sum of the agents' weights.
    pub(super) weight: f64,
}

/// Builds the sample of a scenario, augmented by draws from the stream, or as logged. `None` if there is
/// nothing to learn.
pub(super) fn sample(
    scenario: &Scenario,
    recipe: &Recipe,
    mut varied: Option<&mut Stream>,
) -> Option<Sample> {
    let window = Window::of(scenario, varied.as_deref_mut());
    let shapes = GroundShapes::of(&window.start);
    let scene = LearningScene::of(window, shapes);
    let (scene, now) = scene.augmented(&recipe.augmentation, varied);
    let (scene, shapes) = scene.split_map();
    let ground = Ground::of(&shapes, recipe.sight.radius);
    let lights = scene.lights_at(now);
    let view = scene.view(&scene.tracks, now, false, &lights);
    let mut slots = view.nearest_agents(view.agents.len());
    // A stable sort: by distance among those that move, then among those that are parked.
    slots.sort_by_key(|slot| scene.is_parked(*slot));
    slots.truncate(recipe.agents);
    let seen = Seen::of(&view, slots, &ground, &recipe.sight);
    let mut sample = Sample { seen, ..Sample::default() };
    for i in 0..sample.seen.slots.len() {
        let slot = sample.seen.slots[i];
        let weight = if scene.is_parked(slot) { recipe.parked } else { 1.0 };
        sample.add(i, &scene.tracks[slot], now, weight, &recipe.network);
    }
    (sample.weight > 0.0).then_some(sample)
}

impl Sample {
    /// Adds what an agent did.
    fn add(&mut self, agent: usize, track: &[Frame], now: usize, weight: f64, config: &CtgConfig) {
        let from = self.seen.states[agent];
        let count = config.states() + 1;
        // The current state has a velocity, even if the recorded one has none.
        let mut future: Vec<Frame> = track.iter().skip(now).take(count).copied().collect();
        future.resize(count, None);
        future[0] = Some(from);
        let done = actions(&future, config.hold);
        let axis = direction(from.heading);
        let first = self.weights.len();
        let mut yaw = 0.0;
        for (k, (action, known)) in done.values.iter().zip(done.known).enumerate() {
            let state = future[(k + 1) * config.hold].filter(|_| known);
            let state = state.and_then(|s: AgentState| Some((s, s.velocity()?.norm())));
            let numbers = state.map(|(s, speed)| {
                // Yaws go on beyond half a turn, as those of plans do.
                yaw += wrap(s.heading - from.heading - yaw);
                let at = into_frame(axis, s.position() - from.position());
                let [x, y, speed, yaw] = normalized_state([at.x, at.y, speed, yaw].map(|v| v as f32));
                let [acceleration, yaw_rate] = normalized(*action);
                [x, y, speed, yaw, acceleration, yaw_rate]
            });
            self.weights.push(f32::from(numbers.is_some()));
            self.truth.extend(numbers.unwrap_or_default());
        }
        let known: f32 = self.weights[first..].iter().sum();
        let weight = if known > 0.0 { weight } else { 0.0 };
        self.weights[first..].iter_mut().for_each(|w| *w *= weight as f32 / known.max(1.0));
        self.weight += weight;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_truth_is_where_the_agent_will_be() {
        let config = CtgConfig { actions: 4, hold: 2, ..CtgConfig::default() };
        // A bend of radius 20 m that begins almost at a heading of half a turn, at 5 m/s.
        let state = |k: u8| {
            let turned = 0.25 * 0.1 * f64::from(k);
            let heading = wrap(3.1 + turned);
            let v = direction(heading) * 5.0;
            let (x, y) = (20.0 * turned.sin(), 20.0 * (1.0 - turned.cos()));
            let p = direction(3.1) * x + reactsim_geometry::left(direction(3.1)) * y;
            AgentState { x: p.x, y: p.y, heading, vx: v.x, vy: v.y }
        };
        let mut track: Vec<Frame> = vec![None; 3];
        track.extend((0..7).map(|k| Some(state(k))));
        let mut sample = Sample::default();
        sample.seen.states.push(state(0));
        sample.add(0, &track, 3, 0.6, &config);
        // Three of four steps are known.
        assert_eq!(
            sample.weights.iter().map(|w| (w * 10.0).round()).collect::<Vec<_>>(),
            [2.0, 2.0, 2.0, 0.0]
        );
        assert!((sample.weight - 0.6).abs() < 1e-12);
        for (k, found) in sample.truth.as_chunks::<6>().0.iter().enumerate().take(3) {
            let turned = 0.25 * 0.2 * (k + 1) as f64;
            let at = [20.0 * turned.sin(), 20.0 * (1.0 - turned.cos()), 5.0, turned];
            let state = normalized_state(at.map(|v| v as f32));
            let wanted = [&state[..], &normalized([0.0, 0.25])].concat();
            assert!(
                found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-3),
                "{k}: {found:?} {wanted:?}"
            );
        }
        assert_eq!(sample.truth[18..], [0.0; 6]);
    }
}
