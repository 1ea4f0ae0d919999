//! The dense prediction: one future of everybody, which is encoded and becomes part of what is known of him.

use burn::module::Module;
use burn::tensor::Tensor;

use super::STATE;
use super::batch::Batch;
use super::config::{Attributes, Config};
use super::guide;
use super::layers::{NormedMlp, PlainMlp};
use crate::models::nn::Initializer;

/// The layers of the dense prediction. Their tensors are tensors of the decoder.
#[derive(Module, Debug)]
pub(crate) struct Dense {
    obj_pos_encoding_layer: PlainMlp,
    dense_future_head: NormedMlp,
    future_traj_mlps: PlainMlp,
    traj_fusion_mlps: PlainMlp,
}

impl Dense {
    pub(crate) fn init(config: &Config, init: &mut Initializer) -> Self {
        let (d, states) = (config.decoder_width, config.states());
        Self {
            obj_pos_encoding_layer: PlainMlp::three(2, [d, d, d], init),
            dense_future_head: NormedMlp::init(2 * d, &[d, d, states * STATE], true, config.norms, init),
            future_traj_mlps: PlainMlp::three(4 * states, [d, d, d], init),
            traj_fusion_mlps: PlainMlp::three(2 * d, [d, d, d], init),
        }
    }

    /// Agents `[n, width]` to agents that know a future, and the futures `[n, states, 7]` in the frame of the predicted agent.
    pub(crate) fn forward(
        &self,
        agents: Tensor<2>,
        batch: &Batch,
        config: &Config,
    ) -> (Tensor<2>, Tensor<3>) {
        let (rows, states) = (agents.dims()[0], config.states());
        // Own attributes are numbers near 1 where published ones are metres.
        let scale = match config.attributes {
            Attributes::Published => 1.0,
            Attributes::Own => 0.05,
        };
        let positions = batch.agents.positions.clone();
        let at = self.obj_pos_encoding_layer.forward(positions.clone() * scale);
        let raw = self.dense_future_head.forward(Tensor::cat(vec![at, agents.clone()], 1));
        let raw = raw.reshape([rows, states, STATE]);
        let away = match &batch.dense_guide {
            Some(guess) => guide::applied(raw, guess.clone(), config),
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
