//! Scenes and steps as the tensors that the network reads.

use std::collections::BTreeMap;

use burn::tensor::{Device, Tensor, TensorData};
use reactsim_nn::Neighbors;
use reactsim_perception::{BODY_FEATURES, Class, PLACE_FEATURES};

use super::config::Config;
use super::linked_places::LinkedPlaces;
use super::links::Links;
use super::pair::PAIR_FEATURES;
use super::place_relations::{PLACE_PAIR_FEATURES, TO_PLACE_FEATURES};
use super::step::{PAST_FEATURES, StepGraph};

/// Neighbours as tensors.
#[derive(Clone, Debug)]
pub(crate) struct LinkTensors {
    /// Neighbours of `n` nodes, with `k` slots each.
    pub neighbors: Neighbors,
    /// `[n * k, features]`: relation of the source of each slot to the node.
    pub relation: Tensor<2>,
}

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

/// Links collected from several scenes, with source indices shifted to the rows of their scene.
#[derive(Default)]
struct LinkCollector(Links);

impl LinkCollector {
    fn add(&mut self, links: &Links, shift: impl Fn(u32) -> u32) {
        self.0.index.extend(links.index.iter().zip(&links.open).map(|(&i, &o)| if o { shift(i) } else { 0 }));
        self.0.open.extend_from_slice(&links.open);
        self.0.relation.extend_from_slice(&links.relation);
    }

    fn tensors(self, k: usize, features: usize, device: &Device) -> LinkTensors {
        let nodes = self.0.index.len() / k;
        LinkTensors {
            neighbors: Neighbors::from_slots(nodes, k, &self.0.index, &self.0.open, device),
            relation: floats(self.0.relation, features, device),
        }
    }
}

/// Lays out all places of several scenes.
pub(crate) fn map_tensors(scenes: &[&LinkedPlaces], config: &Config, device: &Device) -> MapTensors {
    let mut features = Vec::new();
    let mut links = LinkCollector::default();
    let mut base = 0;
    for scene in scenes {
        scene.places.all.iter().for_each(|p| features.extend_from_slice(&p.features));
        links.add(&scene.links, |i| i + base);
        base += scene.places.all.len() as u32;
    }
    MapTensors {
        places: floats(features, PLACE_FEATURES, device),
        links: links.tensors(config.map_neighbours, PLACE_PAIR_FEATURES, device),
    }
}

/// Lays out the steps of several scenes: for each scene its steps, oldest first, and the first rows of
/// its places and of its earlier nodes.
pub(crate) fn node_tensors(
    scenes: &[(&[StepGraph], SceneRows)],
    config: &Config,
    device: &Device,
) -> NodeTensors {
    let (mut past, mut places, mut agents) =
        (LinkCollector::default(), LinkCollector::default(), LinkCollector::default());
    let mut bodies = Vec::new();
    let mut rows: BTreeMap<Class, Vec<usize>> = BTreeMap::new();
    let mut base = 0;
    for (steps, at) in scenes {
        for step in *steps {
            past.add(&step.past, |i| i + at.earlier as u32);
            places.add(&step.places, |i| i + at.places as u32);
            agents.add(&step.agents, |i| i + base as u32);
            bodies.extend_from_slice(&step.bodies);
            for (row, class) in step.classes.iter().enumerate() {
                rows.entry(*class).or_default().push(base + row);
            }
            base += step.slots.len();
        }
    }
    NodeTensors {
        bodies: floats(bodies, BODY_FEATURES, device),
        past: past.tensors(config.past, PAST_FEATURES, device),
        places: places.tensors(config.places(), TO_PLACE_FEATURES, device),
        agents: agents.tensors(config.agents, PAIR_FEATURES, device),
        rows,
    }
}

/// First rows of a scene.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SceneRows {
    /// First row in the table of places.
    pub places: usize,
    /// First row in the table of nodes that links to the past refer to.
    pub earlier: usize,
}
