//! The diffusion transformer: from noisy trajectories to clean ones.

use burn::module::Module;
use burn::nn::{Embedding, LayerNorm, Linear};
use burn::tensor::activation::silu;
use burn::tensor::{Int, Tensor, TensorData};
use reactsim_nn::{Initializer, MultiHeadAttention, Part, Perceptron, Rows, linear};

use super::PlannerConfig;
use super::final_layer::{FinalLayer, modulated};
use super::perceptron::{GELU, GELU_TANH};
use super::planner::EncodedPlan;
use super::route::RouteEncoder;
use super::time::TimeEmbedder;

/// Hidden width of the perceptron that reads trajectories.
const READING: usize = 512;

/// Attention among trajectories and a perceptron, both modulated, then attention to the scene and a
/// perceptron without residuals, as in the public code.
#[derive(Module, Debug)]
struct TransformerBlock {
    norm1: LayerNorm,
    attn: MultiHeadAttention,
    norm2: LayerNorm,
    mlp1: Perceptron,
    modulation: Linear,
    norm3: LayerNorm,
    cross_attn: MultiHeadAttention,
    norm4: LayerNorm,
    mlp2: Perceptron,
}

/// The transformer.
#[derive(Module, Debug)]
pub(super) struct Transformer {
    pub(super) route_encoder: RouteEncoder,
    agent_embedding: Embedding,
    preproj: Perceptron,
    t_embedder: TimeEmbedder,
    blocks: Vec<TransformerBlock>,
    final_layer: FinalLayer,
}

impl TransformerBlock {
    fn init(config: &PlannerConfig, init: &mut Initializer) -> Self {
        let d = config.width;
        Self {
            norm1: init.norm(d),
            attn: MultiHeadAttention::init(d, config.heads, init),
            norm2: init.norm(d),
            mlp1: GELU_TANH.init(&[d, 4 * d, d], init),
            modulation: init.linear(d, 6 * d, true),
            norm3: init.norm(d),
            cross_attn: MultiHeadAttention::init(d, config.heads, init),
            norm4: init.norm(d),
            mlp2: GELU_TANH.init(&[d, 4 * d, d], init),
        }
    }

    fn forward(&self, x: Tensor<2>, changes: &Tensor<2>, samples: usize, given: &EncodedPlan) -> Tensor<2> {
        let [rows, width] = x.dims();
        let gate = |k: usize| changes.clone().narrow(1, k * width, width);
        let inner = modulated(Rows::of(x.clone()).norm(&self.norm1).done(), changes, 0, width);
        let part = |part: Part| self.attn.part(part, inner.clone());
        let (queries, keys, values) = (part(Part::Query), part(Part::Key), part(Part::Value));
        let taken = self.attn.take(samples, queries, keys, values, given.closed.clone());
        let x = x + self.attn.output(taken).done() * gate(2);
        let inner = modulated(Rows::of(x.clone()).norm(&self.norm2).done(), changes, 3, width);
        let x = x + self.mlp1.forward(inner) * gate(5);

        // All trajectories of all samples attend to the same scene.
        let queries = self.cross_attn.part(Part::Query, Rows::of(x).norm(&self.norm3).done());
        let part = |part: Part| self.cross_attn.part(part, given.scene.clone());
        let open = Tensor::zeros([1, 1, 1, 1], &queries.device());
        let taken = self.cross_attn.take(1, queries, part(Part::Key), part(Part::Value), open);
        let taken = self.cross_attn.output(taken).done();
        debug_assert_eq!(taken.dims(), [rows, width]);
        self.mlp2.forward(Rows::of(taken).norm(&self.norm4).done())
    }
}

impl Transformer {
    pub(super) fn init(config: &PlannerConfig, init: &mut Initializer) -> Self {
        let d = config.width;
        Self {
            route_encoder: RouteEncoder::init(config, init),
            agent_embedding: init.embedding(2, d),
            preproj: GELU.init(&[config.trajectory(), READING, d], init),
            t_embedder: TimeEmbedder::init(d, init),
            blocks: (0..config.decoder_depth).map(|_| TransformerBlock::init(config, init)).collect(),
            final_layer: FinalLayer::init(config, init),
        }
    }

    /// Returns the clean trajectories found in noisy ones, `[samples, trajectories, numbers]`, at a time.
    pub(super) fn forward(&self, noisy: Tensor<3>, time: f64, given: &EncodedPlan) -> Tensor<3> {
        let [samples, count, numbers] = noisy.dims();
        let device = noisy.device();
        let whose: Vec<i32> = (0..samples * count).map(|row| i32::from(row % count > 0)).collect();
        let whose = Tensor::<1, Int>::from_data(TensorData::new(whose, [samples * count]), &device);
        let read = self.preproj.forward(noisy.reshape([samples * count, numbers]));
        let mut x = read + self.agent_embedding.weight.val().select(0, whose);
        let condition = self.t_embedder.forward(time, &device) + given.route.clone();
        for block in &self.blocks {
            let changes = linear(&block.modulation, silu(condition.clone()));
            x = block.forward(x, &changes, samples, given);
        }
        self.final_layer.forward(x, &condition).reshape([samples, count, numbers])
    }
}
