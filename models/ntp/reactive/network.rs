//! Layers of the reactive network.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::Tensor;
use reactsim_nn::perception::{BODY_FEATURES, Class, PLACE_FEATURES};
use reactsim_nn::{
    AttentionConfig, FeedForwardConfig, Initializer, Perceptron, PerceptronKind, RelationalAttention, indices,
};

use super::batch::{MapTensors, NodeTensors};
use super::config::Config;
use super::pair::PAIR_FEATURES;
use super::place_relations::{PLACE_PAIR_FEATURES, TO_PLACE_FEATURES};
use super::step::PAST_FEATURES;

/// A block: attention of agents to their past, to the map and to other agents.
#[derive(Module, Debug)]
pub(crate) struct Block {
    past: RelationalAttention,
    places: RelationalAttention,
    agents: RelationalAttention,
}

/// The reactive network. The last feature of every relation is 1 and replaces a bias.
#[derive(Module, Debug)]
pub struct Network {
    place: Perceptron,
    place_pair: Linear,
    map: Vec<RelationalAttention>,
    body: Perceptron,
    past: Linear,
    to_place: Linear,
    pair: Linear,
    blocks: Vec<Block>,
    heads: Vec<Perceptron>,
}

/// Source of the features of earlier nodes.
#[derive(Debug)]
pub(crate) enum PastNodes<'a> {
    /// Earlier nodes are among those that are computed now.
    Here,
    /// Cached [`Encoding::entering`] of earlier nodes, `[m, hidden]`.
    Cached(&'a [Tensor<2>]),
}

/// Encoding nodes.
#[derive(Debug)]
pub(crate) struct Encoding {
    /// Input of the heads, `[n, hidden]`.
    pub nodes: Tensor<2>,
    /// For each block, the nodes as later steps attend to them.
    pub entering: Vec<Tensor<2>>,
    /// For each block, the nodes as other agents attend to them.
    pub meeting: Vec<Tensor<2>>,
    /// For each block, all agents that nodes attended to: the nodes, and those that stand.
    pub agents: Vec<Tensor<2>>,
}

/// What nodes attend to, for each block.
#[derive(Clone, Debug)]
pub(crate) struct Sources {
    /// Earlier nodes, as [`Encoding::entering`].
    pub past: Vec<Tensor<2>>,
    /// Places, as from [`Network::encode_map`].
    pub places: Vec<Tensor<2>>,
    /// Agents, as [`Encoding::agents`].
    pub agents: Vec<Tensor<2>>,
}

impl Sources {
    /// Returns the same on a device with autodiff.
    pub(crate) fn with_autodiff(&self) -> Self {
        let [past, places, agents] = [&self.past, &self.places, &self.agents]
            .map(|blocks| blocks.iter().map(|rows| Tensor::from_inner(rows.clone())).collect());
        Self { past, places, agents }
    }
}

impl Network {
    /// Builds a network with initial weights. `tokens` holds the number of tokens per class.
    pub(crate) fn init(config: &Config, tokens: [usize; 3], init: &mut Initializer) -> Self {
        let (h, r) = (config.hidden, config.relation);
        let attention = |bipartite| AttentionConfig {
            width: h,
            heads: config.heads,
            head_dim: config.head_width,
            relation_width: r,
            feed_forward: FeedForwardConfig::Relu(config.feed_forward),
            bipartite,
            relation_norm: false,
            dropout: 0.0,
        };
        Self {
            place: PerceptronKind::SMART.init(&[PLACE_FEATURES, h, h], init),
            place_pair: init.linear(PLACE_PAIR_FEATURES, r, false),
            body: PerceptronKind::SMART.init(&[BODY_FEATURES, 2 * h, h], init),
            past: init.linear(PAST_FEATURES, r, false),
            to_place: init.linear(TO_PLACE_FEATURES, r, false),
            pair: init.linear(PAIR_FEATURES, r, false),
            heads: tokens
                .into_iter()
                .map(|n| PerceptronKind::SMART.init(&[h, config.head_hidden, n], init))
                .collect(),
            map: (0..config.map_layers).map(|_| attention(false).init(init)).collect(),
            blocks: (0..config.agent_layers)
                .map(|_| Block {
                    past: attention(false).init(init),
                    places: attention(true).init(init),
                    agents: attention(false).init(init),
                })
                .collect(),
        }
    }

    /// Encodes the places of the map: as agents attend to them, `[p, hidden]` for each block. The result
    /// holds for a whole rollout: everything that changes enters with relations.
    pub(crate) fn encode_map(&self, map: &MapTensors) -> Vec<Tensor<2>> {
        let relation = map.links.embed(&self.place_pair);
        let mut x = self.place.forward(map.places.clone());
        for layer in &self.map {
            x = map.links.attend(layer, x, &relation);
        }
        self.blocks.iter().map(|block| block.places.sources(x.clone())).collect()
    }

    /// Encodes the nodes of some steps, given the encoded places. `standing` are agents without a node, to
    /// which nodes attend as well, as [`Encoding::meeting`]; their rows follow the rows of the nodes.
    pub(crate) fn encode(
        &self,
        nodes: &NodeTensors,
        places: &[Tensor<2>],
        past: &PastNodes<'_>,
        standing: Option<&[Tensor<2>]>,
    ) -> Encoding {
        let to_past = nodes.past.embed(&self.past);
        let to_places = nodes.places.embed(&self.to_place);
        let to_agents = nodes.agents.embed(&self.pair);
        let mut x = self.body.forward(nodes.bodies.clone());
        let mut entering = Vec::with_capacity(self.blocks.len());
        let mut meeting = Vec::with_capacity(self.blocks.len());
        let mut agents = Vec::with_capacity(self.blocks.len());
        for (i, block) in self.blocks.iter().enumerate() {
            entering.push(block.past.sources(x.clone()));
            let earlier = match past {
                PastNodes::Here => entering[i].clone(),
                PastNodes::Cached(cached) => cached[i].clone(),
            };
            x = nodes.past.attend_to(&block.past, x, earlier, &to_past);
            x = nodes.places.attend_to(&block.places, x, places[i].clone(), &to_places);
            meeting.push(block.agents.sources(x.clone()));
            let others = match standing {
                Some(standing) => Tensor::cat(vec![meeting[i].clone(), standing[i].clone()], 0),
                None => meeting[i].clone(),
            };
            x = nodes.agents.attend_to(&block.agents, x, others.clone(), &to_agents);
            agents.push(others);
        }
        Encoding { nodes: x, entering, meeting, agents }
    }

    /// Encodes nodes that attend to known sources only, and not to one another. Returns the input of the
    /// heads, `[n, hidden]`.
    pub(crate) fn encode_among(&self, nodes: &NodeTensors, sources: &Sources) -> Tensor<2> {
        let to_past = nodes.past.embed(&self.past);
        let to_places = nodes.places.embed(&self.to_place);
        let to_agents = nodes.agents.embed(&self.pair);
        let mut x = self.body.forward(nodes.bodies.clone());
        for (i, block) in self.blocks.iter().enumerate() {
            x = nodes.past.attend_to(&block.past, x, sources.past[i].clone(), &to_past);
            x = nodes.places.attend_to(&block.places, x, sources.places[i].clone(), &to_places);
            x = nodes.agents.attend_to(&block.agents, x, sources.agents[i].clone(), &to_agents);
        }
        x
    }

    /// Returns the logits of the next token for nodes of one class, `[m, tokens of the class]`.
    pub(crate) fn logits(&self, class: Class, nodes: Tensor<2>) -> Tensor<2> {
        self.heads[class as usize].forward(nodes)
    }

    /// Returns the logits of each node, one per token of its class. `features` are the input of the heads.
    pub(crate) fn all_logits(&self, nodes: &NodeTensors, features: &Tensor<2>) -> Vec<Vec<f32>> {
        let mut all = vec![Vec::new(); features.dims()[0]];
        for (class, rows) in &nodes.rows {
            let index = indices(rows.iter().copied(), &features.device());
            let logits = self.logits(*class, features.clone().select(0, index));
            let width = logits.dims()[1];
            let values: Vec<f32> = logits.into_data().iter::<f32>().collect();
            for (row, own) in rows.iter().zip(values.chunks_exact(width)) {
                all[*row] = own.to_vec();
            }
        }
        all
    }
}
