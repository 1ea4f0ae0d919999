//! Scenes and steps as the tensors that the network reads.

use std::collections::BTreeMap;

use burn::tensor::{Device, Tensor, TensorData};
use reactsim_nn::perception::{BODY_FEATURES, Class, PLACE_FEATURES};
use reactsim_nn::{LinkTensors, Links};

use super::config::Config;
use super::linked_places::LinkedPlaces;
use super::pair::PAIR_FEATURES;
use super::place_relations::{PLACE_PAIR_FEATURES, TO_PLACE_FEATURES};
use super::step::{PAST_FEATURES, StepGraph};

/// Places of several scenes as tensors, and their relations to each other.
#[derive(Clone, Debug)]
pub(crate) struct MapTensors {
    /// Features, `[p, PLACE_FEATURES]`.
    pub places: Tensor<2>,
    /// Links among places.
    pub links: LinkTensors,
}

/// Steps of agents as tensors.
#[derive(Clone, Debug)]
pub(crate) struct NodeTensors {
    /// Features, `[n, BODY_FEATURES]`.
    pub bodies: Tensor<2>,
    /// Links to earlier nodes.
    pub past: LinkTensors,
    /// Links to places.
    pub places: LinkTensors,
    /// Links to other agents at the same step.
    pub agents: LinkTensors,
    /// Rows of the nodes of each class.
    pub rows: BTreeMap<Class, Vec<usize>>,
}

/// Converts floats to a tensor of rows.
pub(crate) fn floats(values: Vec<f32>, columns: usize, device: &Device) -> Tensor<2> {
    let rows = values.len() / columns;
    Tensor::from_data(TensorData::new(values, [rows, columns]), device)
}

/// Lays out all places of several scenes.
pub(crate) fn map_tensors(scenes: &[&LinkedPlaces], config: &Config, device: &Device) -> MapTensors {
    let mut features = Vec::new();
    let mut links = Links::default();
    let mut base = 0;
    for scene in scenes {
        scene.places.all.iter().for_each(|p| features.extend_from_slice(&p.features));
        links.append(&scene.links, |place| base + place);
        base += scene.places.all.len();
    }
    MapTensors {
        places: floats(features, PLACE_FEATURES, device),
        links: links.tensors(config.map_neighbours, PLACE_PAIR_FEATURES, device),
    }
}

/// Steps of agents in rows, as [`NodeTensors`].
#[derive(Clone, Debug, Default)]
pub(crate) struct NodeRows {
    bodies: Vec<f32>,
    past: Links,
    places: Links,
    agents: Links,
    classes: Vec<Class>,
}

impl NodeRows {
    /// Lays out the steps of several scenes: for each scene its steps, oldest first, and the first rows of
    /// its places and of its earlier nodes.
    pub(crate) fn of(scenes: &[(&[StepGraph], SceneRows)], config: &Config) -> Self {
        let nodes: usize = scenes.iter().flat_map(|(steps, _)| *steps).map(|step| step.slots.len()).sum();
        let mut rows = Self {
            bodies: Vec::with_capacity(nodes * BODY_FEATURES),
            past: Links::with_capacity(nodes * config.past, PAST_FEATURES),
            places: Links::with_capacity(nodes * config.places(), TO_PLACE_FEATURES),
            agents: Links::with_capacity(nodes * config.agents, PAIR_FEATURES),
            classes: Vec::with_capacity(nodes),
        };
        let mut base = 0;
        for (steps, at) in scenes {
            for step in *steps {
                let nodes = step.slots.len();
                rows.past.append(&step.past, |node| at.earlier + node);
                rows.places.append(&step.places, |place| at.places + place);
                // Agents that stand follow the nodes.
                rows.agents.append(&step.agents, |agent| match agent.checked_sub(nodes) {
                    None => base + agent,
                    Some(standing) => at.standing + standing,
                });
                rows.bodies.extend_from_slice(&step.bodies);
                rows.classes.extend_from_slice(&step.classes);
                base += nodes;
            }
        }
        rows
    }

    /// Returns some of the nodes, in this order. Their links are to the same rows.
    pub(crate) fn chosen(&self, nodes: &[usize], config: &Config) -> Self {
        let body = |node: &usize| self.bodies[node * BODY_FEATURES..(node + 1) * BODY_FEATURES].iter();
        Self {
            bodies: nodes.iter().flat_map(body).copied().collect(),
            past: self.past.of_nodes(nodes, config.past, PAST_FEATURES),
            places: self.places.of_nodes(nodes, config.places(), TO_PLACE_FEATURES),
            agents: self.agents.of_nodes(nodes, config.agents, PAIR_FEATURES),
            classes: nodes.iter().map(|node| self.classes[*node]).collect(),
        }
    }

    /// Converts the rows to tensors.
    pub(crate) fn tensors(self, config: &Config, device: &Device) -> NodeTensors {
        let mut rows: BTreeMap<Class, Vec<usize>> = BTreeMap::new();
        for (row, class) in self.classes.iter().enumerate() {
            rows.entry(*class).or_default().push(row);
        }
        NodeTensors {
            bodies: floats(self.bodies, BODY_FEATURES, device),
            past: self.past.tensors(config.past, PAST_FEATURES, device),
            places: self.places.tensors(config.places(), TO_PLACE_FEATURES, device),
            agents: self.agents.tensors(config.agents, PAIR_FEATURES, device),
            rows,
        }
    }
}

/// Lays out the steps of several scenes as tensors, as [`NodeRows::of`].
pub(crate) fn node_tensors(
    scenes: &[(&[StepGraph], SceneRows)],
    config: &Config,
    device: &Device,
) -> NodeTensors {
    NodeRows::of(scenes, config).tensors(config, device)
}

/// First rows of a scene.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SceneRows {
    /// First row in the table of places.
    pub places: usize,
    /// First row in the table of nodes that links to the past refer to.
    pub earlier: usize,
    /// First row of its agents that stand, which follow all nodes.
    pub standing: usize,
}
