//! The reactive network itself.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::activation::relu;
use burn::tensor::{Int, Tensor, TensorData};

use super::super::tokens::Class;
use super::batch::{LinkTensors, MapTensors, NodeTensors};
use super::body::BODY;
use super::config::Config;
use super::pair::PAIR;
use super::place::{PLACE, PLACE_PAIR, TO_PLACE};
use super::step::PAST;
use crate::models::nn::{
    AttentionConfig, FeedForwardConfig, Initializer, MlpLayer, Noise, RelationalAttention, Relations,
};

/// A block: an agent attends to its past, to the map, to the others.
#[derive(Module, Debug)]
pub(crate) struct Block {
    past: RelationalAttention,
    places: RelationalAttention,
    agents: RelationalAttention,
}

/// The reactive network.
#[derive(Module, Debug)]
pub struct Network {
    place: MlpLayer,
    place_pair: Linear,
    map: Vec<RelationalAttention>,
    body: MlpLayer,
    past: Linear,
    to_place: Linear,
    pair: Linear,
    blocks: Vec<Block>,
    heads: Vec<MlpLayer>,
}

/// Where earlier nodes are found.
#[derive(Debug)]
pub(crate) enum PastNodes<'a> {
    /// Among the nodes that are computed now.
    Here,
    /// Per block the states with which earlier nodes entered it, `[m, hidden]`.
    Kept(&'a [Tensor<2>]),
}

/// What comes out.
#[derive(Debug)]
pub(crate) struct Encoded {
    /// `[n, hidden]`: what the heads read.
    pub nodes: Tensor<2>,
    /// Per block the states with which the nodes entered it: what later steps attend to.
    pub entering: Vec<Tensor<2>>,
}

impl Network {
    /// A network with fresh weights. `tokens` are the numbers of tokens per class.
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
            place: MlpLayer::init(PLACE, h, h, init),
            place_pair: init.linear(PLACE_PAIR, r, false),
            body: MlpLayer::init(BODY, 2 * h, h, init),
            past: init.linear(PAST, r, false),
            to_place: init.linear(TO_PLACE, r, false),
            pair: init.linear(PAIR, r, false),
            heads: tokens.into_iter().map(|n| MlpLayer::init(h, config.head_hidden, n, init)).collect(),
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

    /// `[p, hidden]`: the places of the map. Holds for a whole rollout: what changes enters with relations.
    pub(crate) fn encode_map(&self, map: &MapTensors) -> Tensor<2> {
        let relation = embed(&self.place_pair, &map.links);
        let mut x = self.place.forward(map.places.clone());
        for layer in &self.map {
            x = attend(layer, x, None, &map.links, &relation);
        }
        x
    }

    /// The nodes of some steps, from the encoded places.
    pub(crate) fn encode(&self, nodes: &NodeTensors, places: Tensor<2>, past: &PastNodes<'_>) -> Encoded {
        let to_past = embed(&self.past, &nodes.past);
        let to_places = embed(&self.to_place, &nodes.places);
        let to_agents = embed(&self.pair, &nodes.agents);
        let mut x = self.body.forward(nodes.bodies.clone());
        let mut entering = Vec::with_capacity(self.blocks.len());
        for (i, block) in self.blocks.iter().enumerate() {
            entering.push(x.clone());
            let earlier = match past {
                PastNodes::Here => x.clone(),
                PastNodes::Kept(kept) => kept[i].clone(),
            };
            x = attend(&block.past, x, Some(earlier), &nodes.past, &to_past);
            x = attend(&block.places, x, Some(places.clone()), &nodes.places, &to_places);
            x = attend(&block.agents, x, None, &nodes.agents, &to_agents);
        }
        Encoded { nodes: x, entering }
    }

    /// `[m, tokens of the class]`: unnormalised log-probabilities of the next token of nodes of one class.
    pub(crate) fn logits(&self, class: Class, nodes: Tensor<2>) -> Tensor<2> {
        self.heads[class as usize].forward(nodes)
    }
}

impl Network {
    /// Per node its logits, as many as its class has tokens.
    pub(crate) fn all_logits(&self, nodes: &NodeTensors, encoded: &Encoded) -> Vec<Vec<f32>> {
        let mut all = vec![Vec::new(); encoded.nodes.dims()[0]];
        for (class, rows) in &nodes.rows {
            let index: Vec<i32> = rows.iter().map(|&r| r as i32).collect();
            let index =
                Tensor::<1, Int>::from_data(TensorData::new(index, [rows.len()]), &encoded.nodes.device());
            let logits = self.logits(*class, encoded.nodes.clone().select(0, index));
            let width = logits.dims()[1];
            let values: Vec<f32> = logits.into_data().iter::<f32>().collect();
            for (row, own) in rows.iter().zip(values.chunks_exact(width)) {
                all[*row] = own.to_vec();
            }
        }
        all
    }
}

/// One layer; without `sources` nodes attend to one another.
fn attend(
    layer: &RelationalAttention,
    x: Tensor<2>,
    sources: Option<Tensor<2>>,
    links: &LinkTensors,
    relation: &Relations,
) -> Tensor<2> {
    let sources = layer.sources(sources.unwrap_or_else(|| x.clone()));
    layer.forward_with(x, sources, &links.neighbors, relation, &mut Noise::none())
}

/// `[n, k, relation]`: one hidden layer over the numbers of a relation, the last of which is 1 in place of a bias. The layer of attention
/// has the weights that would follow: what it does with relations is linear.
fn embed(linear: &Linear, links: &LinkTensors) -> Relations {
    let (n, k) = (links.neighbors.destinations(), links.neighbors.slots());
    let embedded = relu(linear.forward(links.relation.clone()));
    let width = embedded.dims()[1];
    Relations::new(embedded.reshape([n, k, width]))
}
