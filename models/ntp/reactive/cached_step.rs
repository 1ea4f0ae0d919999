//! The network's part of a plan, without what leads to its input, to measure it and to compute it elsewhere.

use std::collections::BTreeMap;

use burn::tensor::{Device, Tensor};
use reactsim_nn::Links;
use reactsim_nn::perception::{BODY_FEATURES, Class};

use super::batch::{NodeTensors, SceneRows, floats, node_tensors};
use super::config::Config;
use super::network::{Network, PastNodes};
use super::pair::PAIR_FEATURES;
use super::place_relations::TO_PLACE_FEATURES;
use super::step::{PAST_FEATURES, StepGraph};

/// A step of known motion as in a rollout: what it attends to of the map and of earlier steps is cached.
#[derive(Debug)]
pub struct CachedStep<'a> {
    network: &'a Network,
    config: Config,
    step: StepGraph,
    nodes: NodeTensors,
    /// Places, for each block.
    map: Vec<Tensor<2>>,
    /// Earlier nodes, for each block.
    past: Vec<Tensor<2>>,
}

impl<'a> CachedStep<'a> {
    /// Takes a step whose links to the past are rows of `past`.
    pub(crate) fn new(
        network: &'a Network,
        config: Config,
        step: StepGraph,
        map: Vec<Tensor<2>>,
        past: Vec<Tensor<2>>,
        device: &Device,
    ) -> Self {
        let nodes = node_tensors(&[(std::slice::from_ref(&step), SceneRows::default())], &config, device);
        Self { network, config, step, nodes, map, past }
    }

    /// Returns the logits of the agents, in slot order: one per token of the agent's class.
    pub fn logits(&self) -> Vec<Vec<f32>> {
        let encoded = self.network.encode(&self.nodes, &self.map, &PastNodes::Cached(&self.past), None);
        self.network.all_logits(&self.nodes, &encoded.nodes)
    }

    /// Returns the class of each agent.
    pub fn classes(&self) -> &[Class] {
        &self.step.classes
    }

    /// Returns the input of the network, row by row:
    ///
    /// - `bodies`: features of the n agents, `[n, features]`;
    /// - `past`, `places` and `agents`, the three kinds of links, with k slots per agent: `.sources`, rows of
    ///   what is attended to, and `.open`, 1 for slots that are used, `[n, k]`; and `.relations`, features of
    ///   the links, `[n * k, features]`;
    /// - `map.0`, `map.1`, …, and `earlier.0`, …: places and earlier agents as each block attends to them,
    ///   `[rows, width]`, after the norm of its sources.
    pub fn input(&self) -> BTreeMap<String, Tensor<2>> {
        let device = self.nodes.bodies.device();
        let (step, config) = (&self.step, &self.config);
        let mut all = BTreeMap::new();
        all.insert("bodies".to_owned(), floats(step.bodies.clone(), BODY_FEATURES, &device));
        let mut put_links = |name: &str, links: &Links, k: usize, features: usize| {
            let sources = links.index.iter().map(|&row| row as f32).collect();
            let open = links.open.iter().map(|&open| f32::from(open)).collect();
            all.insert(format!("{name}.sources"), floats(sources, k, &device));
            all.insert(format!("{name}.open"), floats(open, k, &device));
            all.insert(format!("{name}.relations"), floats(links.relation.clone(), features, &device));
        };
        put_links("past", &step.past, config.past, PAST_FEATURES);
        put_links("places", &step.places, config.places(), TO_PLACE_FEATURES);
        put_links("agents", &step.agents, config.agents, PAIR_FEATURES);
        for (name, blocks) in [("map", &self.map), ("earlier", &self.past)] {
            let named = blocks.iter().enumerate().map(|(i, rows)| (format!("{name}.{i}"), rows.clone()));
            all.extend(named);
        }
        all
    }
}
