//! The scene encoder.

use burn::module::Module;
use burn::nn::Embedding;
use burn::tensor::{Device, Int, Tensor, TensorData};
use reactsim_nn::{CLOSED, FourierEmbedding, Initializer, Perceptron, PerceptronKind, largest};

use super::config::VbdConfig;
use super::encoder_layer::EncoderLayer;
use super::input::{SceneInput, agent_size, relation_size};
use super::pairs::Pairs;
use super::surroundings::Surroundings;

/// Number of types of agents, of states of lights, and of types of lines.
const KINDS: usize = 4;
const LIGHTS: usize = 8;
const LINES: usize = 21;

/// Reads agents: velocity and size at the current frame, and type.
#[derive(Module, Debug)]
pub(super) struct AgentEncoder {
    motion: Perceptron,
    type_embed: Embedding,
}

/// Reads map lines: points, pooled, the state of the light at the first one, and type.
#[derive(Module, Debug)]
pub(super) struct LineEncoder {
    point: Perceptron,
    traffic_light_embed: Embedding,
    type_embed: Embedding,
}

/// Reads lights: their states.
#[derive(Module, Debug)]
pub(super) struct LightEncoder {
    type_embed: Embedding,
}

/// Layers of attention.
#[derive(Module, Debug)]
pub(super) struct EncoderLayers {
    layers: Vec<EncoderLayer>,
}

/// Reads a scene.
#[derive(Module, Debug)]
pub(super) struct SceneEncoder {
    agent_encoder: AgentEncoder,
    map_encoder: LineEncoder,
    traffic_light_encoder: LightEncoder,
    relation_encoder: FourierEmbedding,
    transformer_encoder: EncoderLayers,
}

/// Features of the elements of a scene, and their surroundings.
#[derive(Clone, Debug)]
pub struct Encoded {
    /// `[elements, width]`.
    pub(super) elements: Tensor<2>,
    /// The elements that each element attends to.
    pub(super) surroundings: Surroundings,
}

impl Encoded {
    /// Returns the features of the first `agents` elements, `[agents, width]`.
    pub(super) fn agents(&self, agents: usize) -> Tensor<2> {
        self.elements.clone().narrow(0, 0, agents)
    }
}

impl SceneEncoder {
    pub(super) fn init(config: &VbdConfig, init: &mut Initializer) -> Self {
        let (d, h) = (config.width, config.hidden);
        let layer = |_| EncoderLayer::init(d, config.heads, init);
        let layers = (0..config.encoder_layers).map(layer).collect();
        Self {
            transformer_encoder: EncoderLayers { layers },
            agent_encoder: AgentEncoder {
                motion: PerceptronKind::RELU.init(&[agent_size(config.reads_av_motion), h, d, d], init),
                type_embed: init.embedding(KINDS, d),
            },
            map_encoder: LineEncoder {
                point: PerceptronKind::RELU.init(&[3, h, d], init),
                traffic_light_embed: init.embedding(LIGHTS, d),
                type_embed: init.embedding(LINES, d),
            },
            traffic_light_encoder: LightEncoder { type_embed: init.embedding(LIGHTS, d) },
            relation_encoder: FourierEmbedding::init(
                relation_size(config.relates_motion),
                config.frequencies,
                d,
                init,
            ),
        }
    }

    pub(super) fn forward(&self, scene: &SceneInput, config: &VbdConfig, device: &Device) -> Encoded {
        let (n, d) = (scene.len(), config.width);
        let matrix = |values: Vec<f32>, columns: usize| {
            let rows = values.len() / columns;
            Tensor::<2>::from_data(TensorData::new(values, [rows, columns]), device)
        };
        let kinds = rows_of(&self.agent_encoder.type_embed, scene.kinds.iter().copied(), device);
        let agents = scene.agent_features(config.zeros_are_absent, config.reads_av_motion);
        let agents = matrix(agents, agent_size(config.reads_av_motion));
        let agents = self.agent_encoder.motion.forward(agents) + kinds;
        let mut parts = vec![agents];
        if let Some(line) = scene.lines.first() {
            let points = matrix(scene.line_features(config.zeros_are_absent), 3);
            let points = self.map_encoder.point.forward(points);
            let points = largest(points.reshape([scene.lines.len(), line.points.len(), d]));
            let lights = scene.lines.iter().map(|line| line.light);
            let lights = rows_of(&self.map_encoder.traffic_light_embed, lights, device);
            let kinds = rows_of(&self.map_encoder.type_embed, scene.lines.iter().map(|l| l.kind), device);
            parts.push(points + lights + kinds);
        }
        if !scene.lights.is_empty() {
            let states = scene.lights.iter().map(|(_, state)| *state);
            parts.push(rows_of(&self.traffic_light_encoder.type_embed, states, device));
        }
        let own = if config.map_attends { n } else { scene.agents.len() };
        let pairs = scene.nearest(own, n, config.near_elements, config.zeros_are_absent);
        let surroundings = self.relate(scene, &pairs, config, device);
        // Without keys that are open, an element attends to all alike.
        let closed = if config.masked {
            surroundings.closed.clone()
        } else {
            absent(scene, config, device).narrow(0, 0, own).reshape([own, 1, 1, 1])
        };
        let mut x = Tensor::cat(parts, 0);
        for layer in &self.transformer_encoder.layers {
            x = layer.forward(x, &surroundings, closed.clone());
        }
        Encoded { elements: x, surroundings }
    }

    /// Encodes how elements lie to each other.
    pub(super) fn relate(
        &self,
        scene: &SceneInput,
        pairs: &Pairs,
        config: &VbdConfig,
        device: &Device,
    ) -> Surroundings {
        let relations = scene.relations(pairs, config.zeros_are_absent, config.relates_motion);
        let relations = self.relation_encoder.forward_host(&relations, None, device);
        let relations = relations.reshape([pairs.own, pairs.each, config.width]);
        Surroundings::new(pairs, relations, absent(scene, config, device))
    }
}

/// Returns what is added to the scores of elements, `[elements]`: closed if absent.
fn absent(scene: &SceneInput, config: &VbdConfig, device: &Device) -> Tensor<1> {
    let present = scene.present(config.zeros_are_absent);
    let absent: Vec<f32> = present.iter().map(|p| if *p { 0.0 } else { CLOSED }).collect();
    let count = absent.len();
    Tensor::from_data(TensorData::new(absent, [count]), device)
}

/// Returns the vectors of these numbers, `[count, width]`.
pub(super) fn rows_of(table: &Embedding, numbers: impl Iterator<Item = usize>, device: &Device) -> Tensor<2> {
    let numbers: Vec<i32> = numbers.map(|n| n as i32).collect();
    let count = numbers.len();
    let numbers = Tensor::<1, Int>::from_data(TensorData::new(numbers, [count]), device);
    table.weight.val().select(0, numbers)
}
