//! Data of a scene that all its predictions share.

use reactsim_nn::perception::{Body, Places, SceneView, forecast};
use reactsim_scene::AgentState;

use super::MapFeatures;

/// Data of a scene that all its predictions share.
#[derive(Debug)]
pub(crate) struct SceneContext<'a> {
    /// Agents, their tracks and the lights.
    pub view: &'a SceneView<'a>,
    /// Map features.
    pub ground: &'a MapFeatures,
    /// Forecast of the AV: its states after 0.1 s and so on.
    pub av: Option<Vec<AgentState>>,
    /// Agents as possible conflicts of others, if the configuration has an outlook.
    pub(super) bodies: Vec<Body>,
    /// Slots of these agents.
    pub(super) slots: Vec<usize>,
}

impl<'a> SceneContext<'a> {
    /// Prepares the scene of a view.
    pub(crate) fn of(view: &'a SceneView<'a>, ground: &'a MapFeatures) -> Self {
        let av = view.tracks.first().and_then(|track| forecast(track, view.now, view.av_next));
        let mut scene = Self { view, ground, av, bodies: Vec::new(), slots: Vec::new() };
        if ground.places.is_some() {
            // The destinations of other agents do not matter.
            let nowhere = Places::default();
            for slot in 0..view.agents.len() {
                if let Some((body, _)) = view.body(slot, &nowhere) {
                    scene.bodies.push(body);
                    scene.slots.push(slot);
                }
            }
        }
        scene
    }
}
