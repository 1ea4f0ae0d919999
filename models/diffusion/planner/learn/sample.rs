//! Training samples: scenes, and what the AV and its neighbours did in them.

use reactsim_geometry::direction;
use reactsim_nn::learning::{LearningScene, Window};
use reactsim_nn::training::Stream;
use reactsim_scene::{AgentState, DT, FUTURE, Scenario};

use super::super::inputs::{PlannerScene, rear_axle};
use super::super::lanes::PlannerMap;
use super::super::units::Units;
use super::Recipe;

/// Training sample of one scene.
#[derive(Clone, Debug)]
pub struct Sample {
    pub(super) scene: PlannerScene,
    /// True states in the units of the network, `[1 + predicted, 4 (1 + states)]`, the current one first; 0
    /// where unknown.
    pub(super) truth: Vec<f32>,
    /// Weights of these numbers: those of the AV add up to 1, and those of all neighbours.
    pub(super) weights: Vec<f32>,
}

/// Builds the sample of a scenario, augmented by draws from the stream, or as logged. `None` if the AV's motion is
/// unknown.
pub(super) fn sample(
    scenario: &Scenario,
    recipe: &Recipe,
    mut varied: Option<&mut Stream>,
) -> Option<Sample> {
    let config = &recipe.network;
    let window = Window::of(scenario, varied.as_deref_mut());
    let map = recipe.sight.map(&window.start, config);
    let learned = LearningScene::<PlannerMap>::of(window, map);
    let (learned, now) = learned.augmented(&recipe.augmentation, varied);
    let (learned, map) = learned.split_map();
    let lights = learned.lights_at(now);
    let view = learned.view(&learned.tracks, now, true, &lights);
    let scene = PlannerScene::of(&view, &map, config, &recipe.sight)?;

    let step = FUTURE / config.states;
    let mut truth = vec![0.0; (1 + config.predicted) * config.trajectory()];
    let mut weights = vec![0.0; truth.len()];
    let rows = scene.slots.iter().zip(truth.chunks_mut(config.trajectory()));
    let place = |slot: usize, state: &AgentState| match slot {
        0 => rear_axle(&learned.agents[0], state.position(), state.heading),
        _ => state.position(),
    };
    let relative = recipe.sight.relative;
    for ((slot, own), weights) in rows.zip(weights.chunks_mut(config.trajectory())) {
        let Some(current) = view.state(*slot) else { continue };
        let at = place(*slot, &current);
        // The current state is given, in the units of the scene.
        own[..4].copy_from_slice(&scene.frame.pose(at, current.heading));
        let units = Units::of(relative, &scene.frame, at, current.heading, view.velocity(*slot));
        for k in 1..=config.states {
            let Some(state) = learned.tracks[*slot].get(now + k * step).copied().flatten() else { continue };
            let at = scene.frame.point(place(*slot, &state));
            let pose = units.write((k * step) as f64 * DT, at, scene.frame.vector(direction(state.heading)));
            own[4 * k..4 * k + 4].copy_from_slice(&pose);
            weights[4 * k..4 * k + 4].fill(1.0);
        }
    }
    let (of_av, of_others) = weights.split_at_mut(config.trajectory());
    let total = |weights: &[f32]| weights.iter().sum::<f32>();
    if total(of_av) == 0.0 {
        return None;
    }
    for part in [of_av, of_others] {
        let all = total(part).max(1.0);
        part.iter_mut().for_each(|weight| *weight /= all);
    }
    Some(Sample { scene, truth, weights })
}
