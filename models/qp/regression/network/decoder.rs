//! The decoder: each motion query predicts a trajectory of its agent towards the query's intention
//! point.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::{Int, Tensor, TensorData};
use reactsim_nn::{Initializer, Perceptron, PerceptronKind};

use super::STATE;
use super::batch::Batch;
use super::collect::collected;
use super::config::Config;
use super::decoder_layer::{AttentionInput, Chosen, DecoderLayer, Queries};
use super::dense::Dense;
use super::encoder::Tokens;
use super::guide;
use super::layers::{NormedMlp, Observed};
use super::output::LayerOutput;
use super::sine::sine;
use crate::regression::inputs::OUTLOOK;

/// Scale of reference positions in the input, 1/m, for numbers near 1.
const REFERENCE_SCALE: f64 = 0.05;

/// The decoder.
#[derive(Module, Debug)]
pub(crate) struct MotionDecoder {
    in_proj_center_obj: Perceptron,
    in_proj_obj: Perceptron,
    in_proj_map: Perceptron,
    dense: Dense,
    intention_query_mlps: NormedMlp,
    obj_decoder_layers: Vec<DecoderLayer>,
    map_decoder_layers: Vec<DecoderLayer>,
    map_query_content_mlps: Vec<Linear>,
    map_query_embed_mlps: Option<Linear>,
    query_feature_fusion_layers: Vec<NormedMlp>,
    motion_reg_heads: Vec<NormedMlp>,
    motion_cls_heads: Vec<NormedMlp>,
    /// Not in MTR: perceptrons of the predicted agent's outlook and of each query's reference motion.
    outlook_mlp: Option<Perceptron>,
    guess_mlp: Option<Perceptron>,
}

impl MotionDecoder {
    pub(crate) fn init(config: &Config, init: &mut Initializer) -> Self {
        let (d, m, norms) = (config.decoder_width, config.map_width, config.norms);
        let each = |init: &mut Initializer, make: &dyn Fn(&mut Initializer) -> NormedMlp| {
            (0..config.decoder_layers).map(|_| make(init)).collect::<Vec<_>>()
        };
        let layers = |width: usize, init: &mut Initializer| {
            let layer = |_| DecoderLayer::init(width, config.heads, config.widening, init);
            (0..config.decoder_layers).map(layer).collect::<Vec<_>>()
        };
        // Different widths need one more layer, in the public code too.
        let narrowing = if d == m { 0 } else { config.decoder_layers };
        let states = config.states() * STATE;
        Self {
            in_proj_center_obj: PerceptronKind::RELU.init(&[config.width, d, d], init),
            in_proj_obj: PerceptronKind::RELU.init(&[config.width, d, d], init),
            in_proj_map: PerceptronKind::RELU.init(&[config.width, m, m], init),
            dense: Dense::init(config, init),
            intention_query_mlps: NormedMlp::init(d, &[d, d], true, norms, init),
            obj_decoder_layers: layers(d, init),
            map_decoder_layers: layers(m, init),
            map_query_content_mlps: (0..narrowing).map(|_| init.linear(d, m, true)).collect(),
            map_query_embed_mlps: (d != m).then(|| init.linear(d, m, true)),
            query_feature_fusion_layers: each(init, &|i| NormedMlp::init(2 * d + m, &[d, d], true, norms, i)),
            motion_reg_heads: each(init, &|i| NormedMlp::init(d, &[d, d, states], true, norms, i)),
            motion_cls_heads: each(init, &|i| NormedMlp::init(d, &[d, d, 1], true, norms, i)),
            outlook_mlp: config.outlook.then(|| PerceptronKind::RELU.init(&[OUTLOOK, 2 * d, d], init)),
            guess_mlp: (config.outlook && config.guided)
                .then(|| PerceptronKind::RELU.init(&[2 * config.states(), d, d], init)),
        }
    }

    /// Removes all layers but the first `count`.
    pub(crate) fn truncate(&mut self, count: usize) {
        self.obj_decoder_layers.truncate(count);
        self.map_decoder_layers.truncate(count);
        self.map_query_content_mlps.truncate(count);
        self.query_feature_fusion_layers.truncate(count);
        self.motion_reg_heads.truncate(count);
        self.motion_cls_heads.truncate(count);
    }

    pub(crate) fn forward(
        &self,
        tokens: Tokens,
        batch: &Batch,
        config: &Config,
        observed: &mut Observed,
    ) -> (Vec<LayerOutput>, Tensor<3>) {
        let (scenes, queries, d, m) = (batch.scenes, batch.queries, config.decoder_width, config.map_width);
        let rows = scenes * queries;
        let device = tokens.agents.device();

        // Computed for all agents although one is needed, so that the sizes of products do not depend
        // on the number of scenes alone.
        let own = self.in_proj_center_obj.forward(tokens.agents.clone());
        let mut own = own.reshape([scenes, config.agents, d]).narrow(1, 0, 1);
        if let (Some(mlp), Some(outlook)) = (&self.outlook_mlp, &batch.outlook) {
            own = own + mlp.forward(outlook.clone()).reshape([scenes, 1, d]);
        }
        let own = own.repeat_dim(1, queries);
        let own = own.reshape([rows, d]);
        let (agents, dense) =
            self.dense.forward(self.in_proj_obj.forward(tokens.agents), batch, config, observed);
        let lines = self.in_proj_map.forward(tokens.lines);

        // Intention points are a table of the classes, of which every scene has the rows of one class.
        let points_of = |&class: &usize| (class * queries..(class + 1) * queries).map(|row| row as i32);
        let chosen: Vec<i32> = batch.classes.iter().flat_map(points_of).collect();
        let chosen = Tensor::<1, Int>::from_data(TensorData::new(chosen, [rows]), &device);
        let of_table = |table: Tensor<2>| Chosen { table, rows: Some(chosen.clone()) };
        let intention = self.intentions(batch, d, observed);
        let narrow_intention = match &self.map_query_embed_mlps {
            Some(narrow) => narrow.forward(intention.clone()),
            None => intention.clone(),
        };
        let (intention, narrow_intention) = (of_table(intention), of_table(narrow_intention));
        let any = Tensor::ones([rows, 1], &device);
        let to_agents = AttentionInput {
            tokens: agents,
            positions: sine(batch.agents.positions.clone(), d),
            closed: batch.agents_closed.clone(),
            any,
        };
        let line_positions = sine(batch.lines.positions.clone(), m);

        // The first layer searches at the intention points, later ones where the prediction ends.
        let mut center = None;
        let (mut trajectories, mut points) = (batch.goals.clone(), 1);
        let mut content = Tensor::zeros([rows, d], &device);
        if let (Some(mlp), Some(reference)) = (&self.guess_mlp, &batch.mode_guide) {
            // Reference motions along lanes are not a function of the goal alone: queries get theirs,
            // and collect lines along it from the first layer.
            let places = reference.clone().narrow(2, 0, 2);
            content = mlp.forward(places.clone().reshape([rows, 2 * config.states()]) * REFERENCE_SCALE);
            trajectories = places.into_data().iter::<f32>().collect();
            points = config.states();
        }
        let mut layers = Vec::with_capacity(config.decoder_layers);
        for i in 0..config.decoder_layers {
            let searching = |width| match &center {
                None => of_table(sine(batch.table.clone(), width)),
                Some(ends) => Chosen { table: sine(Tensor::clone(ends), width), rows: None },
            };
            let queries_of =
                |content, intention, width| Queries { content, intention, searching: searching(width) };
            let about = queries_of(content.clone(), intention.clone(), d);
            let of_agents = self.obj_decoder_layers[i].forward(about, &to_agents, i == 0, scenes);
            let to_lines = AttentionInput {
                tokens: lines.clone(),
                positions: line_positions.clone(),
                closed: collected(batch, &trajectories, points, config, &device),
                any: batch.lines_any.clone(),
            };
            let narrow = match self.map_query_content_mlps.get(i) {
                Some(narrow) => narrow.forward(content),
                None => content,
            };
            let about = queries_of(narrow, narrow_intention.clone(), m);
            let of_lines = self.map_decoder_layers[i].forward(about, &to_lines, i == 0, scenes);
            let all = Tensor::cat(vec![own.clone(), of_agents, of_lines], 1);
            content = self.query_feature_fusion_layers[i].forward(all, None, observed);

            let scores = self.motion_cls_heads[i].forward(content.clone(), None, observed);
            let scores = scores.reshape([scenes, queries]);
            let raw = self.motion_reg_heads[i].forward(content.clone(), None, observed);
            let raw = raw.reshape([rows, config.states(), STATE]);
            let modes = match &batch.mode_guide {
                Some(reference) => guide::add_to_reference(raw, reference.clone(), config),
                None => raw,
            };
            let places = modes.clone().narrow(2, 0, 2);
            if i + 1 < config.decoder_layers {
                // The search position carries no gradient: the shortest wavelength is a metre, so its
                // slope is useless.
                let places = places.detach();
                center = Some(places.clone().narrow(1, config.states() - 1, 1).reshape([rows, 2]));
                trajectories = places.into_data().iter::<f32>().collect();
                points = config.states();
            }
            layers.push(LayerOutput { scores, modes });
        }
        (layers, dense)
    }

    /// Returns the static intention queries of all classes, `[3 * queries, width]`.
    fn intentions(&self, batch: &Batch, width: usize, observed: &mut Observed) -> Tensor<2> {
        // The points of a class count as often as there are predicted agents of it.
        let agents =
            |row: usize| batch.classes.iter().filter(|class| **class == row / batch.queries).count() as f32;
        let points = batch.table.dims()[0];
        let weights: Vec<f32> = (0..points).map(agents).collect();
        let weights = Tensor::from_data(TensorData::new(weights, [points, 1]), &batch.table.device());
        self.intention_query_mlps.forward(sine(batch.table.clone(), width), Some(&weights), observed)
    }
}
