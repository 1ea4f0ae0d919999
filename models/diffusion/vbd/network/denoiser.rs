//! The denoiser: from noisy actions of all agents to clean ones.

use burn::module::Module;
use burn::nn::Embedding;
use burn::tensor::{Device, Tensor, TensorData};
use reactsim_nn::{CLOSED, Initializer, Perceptron, PerceptronKind, largest};

use super::config::VbdConfig;
use super::cross_block::{CrossBlock, KeysValues};
use super::pairs::Pairs;
use super::perceptrons::ELU;
use super::scene_encoder::{Encoded, rows_of};
use super::surroundings::Surroundings;

/// Numbers of a state: x, y (m), yaw (rad), vx, vy (m/s).
const STATE: usize = 5;

/// Denoises actions.
#[derive(Module, Debug)]
pub(super) struct Denoiser {
    decoder: Decoder,
    noise_level_embedding: Embedding,
}

/// Everything but the noise level.
#[derive(Module, Debug)]
pub(super) struct Decoder {
    encoder: Perceptron,
    time_embedding: Embedding,
    attention_layers: Vec<CrossBlock>,
    decoder: Perceptron,
}

/// A scene with all that stays the same while the plans of its first agents are denoised.
#[derive(Clone, Debug)]
pub struct DenoisingScene {
    pub(super) agents: usize,
    /// Encodings of these agents, `[agents, width]`.
    own: Tensor<2>,
    /// For each agent, the agents to whose plans it attends.
    others: Surroundings,
    /// Added to scores among plans, `[agents, 1, actions, others * actions]`.
    plans_closed: Tensor<4>,
    /// Added to scores of elements, `[agents or 1, 1, 1, elements]`.
    scenery_closed: Tensor<4>,
    /// By pair of blocks: relations among agents, and elements as agents see them.
    sources: Vec<(KeysValues<3>, KeysValues<2>)>,
}

impl Denoiser {
    pub(super) fn init(config: &VbdConfig, init: &mut Initializer) -> Self {
        let (d, h) = (config.width, config.hidden);
        Self {
            decoder: Decoder {
                encoder: PerceptronKind::RELU
                    .init(&[STATE + if config.reads_actions { 2 } else { 0 }, h, d], init),
                time_embedding: init.embedding(config.actions, d),
                attention_layers: (0..2 * config.pairs)
                    .map(|_| CrossBlock::init(d, config.heads, init))
                    .collect(),
                decoder: ELU.init(&[d, h, 2], init),
            },
            noise_level_embedding: init.embedding(config.noise_levels, d),
        }
    }

    /// Prepares the denoising of the plans of the first agents of a scene: what stays the same at all noise
    /// levels. `others` are the agents that they see, by `pairs`; `av_given` says that the plan of the first
    /// one has no noise.
    pub(super) fn prepare(
        &self,
        scene: &Encoded,
        pairs: &Pairs,
        others: Surroundings,
        av_given: bool,
        config: &VbdConfig,
    ) -> DenoisingScene {
        let all = scene.surroundings.first(pairs.own);
        let of_pair = |pair: &[CrossBlock; 2]| {
            let [among, around] = pair;
            (among.relate(&others), around.sources(&all, &around.relate(&all), &scene.elements, 1))
        };
        let device = scene.elements.device();
        let open = |own: usize, other: usize| other == own || (config.foresight && av_given && other == 0);
        let plans_closed = later_actions(pairs, config.actions, open, &device);
        let blocks = self.decoder.attention_layers.as_chunks::<2>().0;
        DenoisingScene {
            agents: pairs.own,
            own: scene.agents(pairs.own),
            plans_closed,
            scenery_closed: all.closed.clone(),
            sources: blocks.iter().map(of_pair).collect(),
            others,
        }
    }

    /// Returns the clean actions, `[agents, actions, 2]`, normalised, of `noisy` ones. `states`, `[agents,
    /// states, 5]`, are those to which the noisy actions lead, in each agent's own frame.
    pub(super) fn forward(
        &self,
        scene: &DenoisingScene,
        noisy: Tensor<3>,
        states: Tensor<3>,
        level: usize,
        config: &VbdConfig,
    ) -> Tensor<3> {
        let Decoder { encoder, time_embedding, attention_layers, decoder } = &self.decoder;
        let (d, actions) = (config.width, config.actions);
        let [agents, count, _] = states.dims();
        let device = states.device();
        let mut read = states.reshape([agents * count, STATE]);
        if config.reads_actions {
            let held = noisy.reshape([agents * actions, 1, 2]).repeat_dim(1, config.hold);
            read = Tensor::cat(vec![read, held.reshape([agents * count, 2])], 1);
        }
        let held = encoder.forward(read);
        let held = largest(held.reshape([agents * actions, config.hold, d]));
        let level = rows_of(&self.noise_level_embedding, std::iter::once(level), &device);
        let when = time_embedding.weight.val() + level;
        let mut first = held.reshape([agents, actions, d]) + when.unsqueeze_dim::<3>(0);
        if config.residual {
            first = first + scene.own.clone().unsqueeze_dim::<3>(1);
        }
        let first = first.reshape([agents * actions, d]);
        let mut x = first.clone();
        let pairs = attention_layers.as_chunks::<2>().0.iter();
        for (i, ([among, around], (related, scenery))) in pairs.zip(&scene.sources).enumerate() {
            if i > 0 {
                x = x + first.clone();
            }
            let plans = among.sources(&scene.others, related, &x, actions);
            x = among.forward(agents, x, plans, &scene.plans_closed, config.residual);
            x = around.forward(agents, x, scenery.clone(), &scene.scenery_closed, config.residual);
        }
        decoder.forward(x).reshape([agents, actions, 2])
    }
}

/// Closes the later actions of those that are not `open` to an agent, `[agents, 1, actions, others *
/// actions]`.
fn later_actions(
    pairs: &Pairs,
    actions: usize,
    open: impl Fn(usize, usize) -> bool,
    device: &Device,
) -> Tensor<4> {
    let shape = [pairs.own, 1, actions, pairs.each * actions];
    let mut closed = Vec::with_capacity(shape.iter().product());
    for own in 0..pairs.own {
        for now in 0..actions {
            for other in pairs.of(own) {
                let seen = |then: usize| then <= now || open(own, other);
                closed.extend((0..actions).map(|then| if seen(then) { 0.0 } else { CLOSED }));
            }
        }
    }
    Tensor::from_data(TensorData::new(closed, shape), device)
}

#[cfg(test)]
mod tests {
    use reactsim_nn::device;

    use super::*;

    #[test]
    fn later_actions_are_those_of_oneself_and_of_whom_is_open() {
        let pairs = Pairs { own: 2, each: 2, others: None };
        let open = |own: usize, other: usize| own == other || other == 0;
        let closed = later_actions(&pairs, 2, open, &device());
        assert_eq!(closed.dims(), [2, 1, 2, 4]);
        // By agent, then its action: both actions of the first agent, then both of the second.
        let seen: Vec<bool> = closed.into_data().iter::<f32>().map(|score| score == 0.0).collect();
        let all = [true; 4];
        let causal = [true, true, true, false];
        assert_eq!(seen, [causal, all, all, all].concat());
    }
}
