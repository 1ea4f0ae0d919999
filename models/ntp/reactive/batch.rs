//! Scenes and steps, laid out as the tensors that the network reads.

use std::collections::BTreeMap;

use burn::tensor::{Device, Tensor, TensorData};

use super::super::tokens::Class;
use super::body::BODY;
use super::config::Config;
use super::links::Links;
use super::pair::PAIR;
use super::place::{PLACE, PLACE_PAIR, TO_PLACE};
use super::places::Places;
use super::step::{PAST, Step};
use crate::models::nn::Neighbors;

/// Neighbours as tensors.
#[derive(Clone, Debug)]
pub(crate) struct LinkTensors {
    /// Who attends to whom: `n` nodes, `k` slots each.
    pub neighbors: Neighbors,
    /// `[n * k, numbers]`: how the source of each slot stands to the node.
    pub relation: Tensor<2>,
}

/// The places of some scenes as tensors, and how they stand to one another.
#[derive(Clone, Debug)]
pub(crate) struct MapTensors {
    /// `[p, PLACE]`.
    pub places: Tensor<2>,
    /// Among places.
    pub links: LinkTensors,
}

/// Steps of agents as tensors.
#[derive(Clone, Debug)]
pub(crate) struct NodeTensors {
    /// `[n, BODY]`.
    pub bodies: Tensor<2>,
    /// To earlier nodes.
    pub past: LinkTensors,
    /// To places.
    pub places: LinkTensors,
    /// To other agents at the same step.
    pub agents: LinkTensors,
    /// Per class the rows of its nodes.
    pub rows: BTreeMap<Class, Vec<usize>>,
}

/// Floats as a tensor of rows.
pub(crate) fn floats(values: Vec<f32>, columns: usize, device: &Device) -> Tensor<2> {
    let rows = values.len() / columns;
    Tensor::from_data(TensorData::new(values, [rows, columns]), device)
}

/// Links that are collected from several scenes, with indices moved to where their sources stand.
#[derive(Default)]
struct Collected(Links);

impl Collected {
    fn add(&mut self, links: &Links, shift: impl Fn(u32) -> u32) {
        self.0.index.extend(links.index.iter().zip(&links.open).map(|(&i, &o)| if o { shift(i) } else { 0 }));
        self.0.open.extend_from_slice(&links.open);
        self.0.relation.extend_from_slice(&links.relation);
    }

    fn tensors(self, k: usize, numbers: usize, device: &Device) -> LinkTensors {
        let nodes = self.0.index.len() / k;
        LinkTensors {
            neighbors: Neighbors::from_slots(nodes, k, &self.0.index, &self.0.open, device),
            relation: floats(self.0.relation, numbers, device),
        }
    }
}

/// All places of several scenes.
pub(crate) fn map_tensors(scenes: &[&Places], config: &Config, device: &Device) -> MapTensors {
    let mut features = Vec::new();
    let mut links = Collected::default();
    let mut base = 0;
    for scene in scenes {
        scene.all.iter().for_each(|p| features.extend_from_slice(&p.features));
        links.add(&scene.links, |i| i + base);
        base += scene.all.len() as u32;
    }
    MapTensors {
        places: floats(features, PLACE, device),
        links: links.tensors(config.map_neighbours, PLACE_PAIR, device),
    }
}

/// The steps of several scenes: per scene its steps, oldest first, and at which rows its places and its earlier nodes begin.
pub(crate) fn node_tensors(scenes: &[(&[Step], SceneRows)], config: &Config, device: &Device) -> NodeTensors {
    let (mut past, mut places, mut agents) =
        (Collected::default(), Collected::default(), Collected::default());
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
        bodies: floats(bodies, BODY, device),
        past: past.tensors(config.past, PAST, device),
        places: places.tensors(config.places(), TO_PLACE, device),
        agents: agents.tensors(config.agents, PAIR, device),
        rows,
    }
}

/// Where the rows of a scene begin.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SceneRows {
    /// In the table of places.
    pub places: usize,
    /// In the table of nodes that the past refers to.
    pub earlier: usize,
}
