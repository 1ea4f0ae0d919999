//! Scenes as inputs of the network.

use burn::tensor::{Device, Tensor, TensorData};
use reactsim_nn::perception::{Class, SceneView};
use reactsim_scene::AgentState;

use super::network::ATTRIBUTES;
use super::raster::{Ground, image};
use super::sight::Sight;

/// Agents of a scene as the network sees them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Seen {
    /// Images, `[agents, pixels, pixels, channels]`.
    images: Vec<f32>,
    /// Attributes, `[agents, ATTRIBUTES]`.
    attributes: Vec<f32>,
    /// Slots of the agents.
    pub(super) slots: Vec<usize>,
    /// Their current states, with velocities.
    pub(super) states: Vec<AgentState>,
    /// Their lengths and widths, metres.
    pub(super) sizes: Vec<[f64; 2]>,
    /// Their classes.
    pub(super) classes: Vec<Class>,
}

impl Seen {
    /// Describes the agents in these slots; absent ones and those without a class are left out.
    pub(super) fn of(
        view: &SceneView<'_>,
        slots: impl IntoIterator<Item = usize>,
        ground: &Ground,
        sight: &Sight,
    ) -> Self {
        let mut seen = Self::default();
        for slot in slots {
            let agent = &view.agents[slot];
            let (Some(state), Some(class)) = (view.state(slot), Class::of(agent.kind)) else { continue };
            let v = view.velocity(slot);
            let state = AgentState { vx: v.x, vy: v.y, ..state };
            seen.images.extend(image(view, slot, &state, ground, sight));
            let mut attributes = [0.0; ATTRIBUTES];
            let sizes = [state.speed() / 10.0, agent.length / 5.0, agent.width / 2.0];
            attributes[..3].copy_from_slice(&sizes.map(|x| x as f32));
            attributes[3 + class.index()] = 1.0;
            seen.attributes.extend(attributes);
            seen.slots.push(slot);
            seen.states.push(state);
            seen.sizes.push([agent.length, agent.width]);
            seen.classes.push(class);
        }
        seen
    }

    /// Returns images, attributes and speeds of all agents of several scenes, as the network reads them.
    pub(super) fn tensors(
        all: &[&Self],
        sight: &Sight,
        device: &Device,
    ) -> (Tensor<4>, Tensor<2>, Tensor<2>) {
        let count = all.iter().map(|seen| seen.slots.len()).sum();
        let join = |part: fn(&Self) -> &[f32]| all.iter().flat_map(|seen| part(seen)).copied().collect();
        let (images, attributes): (Vec<f32>, Vec<f32>) = (join(|s| &s.images), join(|s| &s.attributes));
        let speeds = all.iter().flat_map(|seen| &seen.states).map(|state| state.speed() as f32).collect();
        let shape = [count, sight.pixels, sight.pixels, sight.channels()];
        (
            Tensor::from_data(TensorData::new(images, shape), device),
            Tensor::from_data(TensorData::new(attributes, [count, ATTRIBUTES]), device),
            Tensor::from_data(TensorData::new::<f32, _>(speeds, [count, 1]), device),
        )
    }
}
