//! The dense prediction: one future of every agent, which is encoded and added to the agent's token.

use burn::module::Module;
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, Perceptron, PerceptronKind};

use super::STATE;
use super::batch::Batch;
use super::config::{Attributes, Config};
use super::guide;
use super::layers::{NormedMlp, Observed};

/// Layers of the dense prediction. Their tensors belong to the decoder.
#[derive(Module, Debug)]
pub(crate) struct Dense {
    obj_pos_encoding_layer: Perceptron,
    dense_future_head: NormedMlp,
    future_traj_mlps: Perceptron,
    traj_fusion_mlps: Perceptron,
}

impl Dense {
    pub(crate) fn init(config: &Config, init: &mut Initializer) -> Self {
        let (d, states) = (config.decoder_width, config.states());
        Self {
            obj_pos_encoding_layer: PerceptronKind::RELU.init(&[2, d, d, d], init),
            dense_future_head: NormedMlp::init(2 * d, &[d, d, states * STATE], true, config.norms, init),
            future_traj_mlps: PerceptronKind::RELU.init(&[4 * states, d, d, d], init),
            traj_fusion_mlps: PerceptronKind::RELU.init(&[2 * d, d, d, d], init),
        }
    }

    /// Returns agents `[n, width]` with their encoded futures, and the futures `[n, states, 7]` in the
    /// frame of the predicted agent.
    pub(crate) fn forward(
        &self,
        agents: Tensor<2>,
        batch: &Batch,
        config: &Config,
        observed: &mut Observed,
    ) -> (Tensor<2>, Tensor<3>) {
        let (rows, states) = (agents.dims()[0], config.states());
        // Own attributes are scaled to about 1; published ones are in metres.
        let scale = match config.attributes {
            Attributes::Published => 1.0,
            Attributes::Own => 0.05,
        };
        let positions = batch.agents.positions.clone();
        let at = self.obj_pos_encoding_layer.forward(positions.clone() * scale);
        let both = Tensor::cat(vec![at, agents.clone()], 1);
        let raw = self.dense_future_head.forward(both, Some(&batch.agents.there), observed);
        let raw = raw.reshape([rows, states, STATE]);
        let away = match &batch.dense_guide {
            Some(reference) => guide::add_to_reference(raw, reference.clone(), config),
            None => raw,
        };
        let place = positions.reshape([rows, 1, 2]);
        let here = Tensor::cat(vec![place, Tensor::zeros([rows, 1, STATE - 2], &away.device())], 2);
        let futures = away + here;
        let moving = vec![futures.clone().narrow(2, 0, 2), futures.clone().narrow(2, STATE - 2, 2)];
        let mut moving = Tensor::cat(moving, 2).reshape([rows, states * 4]);
        if let Some((forecast, is_av)) = &batch.av_forecast {
            moving = moving.clone() + (forecast.clone() - moving) * is_av.clone();
        }
        let encoded = self.future_traj_mlps.forward(moving * scale);
        (self.traj_fusion_mlps.forward(Tensor::cat(vec![agents, encoded], 1)), futures)
    }
}
