//! The scene encoder.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::{Device, Tensor, TensorData};
use reactsim_nn::{CLOSED, Initializer, linear};

use super::PlannerConfig;
use super::elements::{AgentEncoder, Elements, LaneEncoder, PLACE, StaticEncoder, column, matrix};
use super::fusion::Fusion;
use super::input::PlannerInput;

/// Encodes agents, static objects and lanes.
#[derive(Module, Debug)]
pub(super) struct Encoder {
    neighbor_encoder: AgentEncoder,
    static_encoder: StaticEncoder,
    lane_encoder: LaneEncoder,
    pos_emb: Linear,
    fusion: Fusion,
}

impl Encoder {
    pub(super) fn init(config: &PlannerConfig, init: &mut Initializer) -> Self {
        Self {
            neighbor_encoder: AgentEncoder::init(config, init),
            static_encoder: StaticEncoder::init(config, init),
            lane_encoder: LaneEncoder::init(config, init),
            pos_emb: init.linear(PLACE, config.width, true),
            fusion: Fusion::init(config, init),
        }
    }

    /// Returns the features of all elements, `[elements, width]`.
    pub(super) fn forward(&self, input: &PlannerInput, config: &PlannerConfig, device: &Device) -> Tensor<2> {
        let kinds = [
            self.neighbor_encoder.forward(input, config, device),
            self.static_encoder.forward(input, device),
            self.lane_encoder.forward(input, config, device),
        ];
        let (mut tokens, mut present, mut places) = (Vec::new(), Vec::new(), Vec::new());
        for Elements { tokens: own, present: there, places: at } in kinds {
            tokens.push(own);
            present.extend(there);
            places.extend(at);
        }
        let places = linear(&self.pos_emb, matrix(places, PLACE, device)) * column(&present, device);
        // The first key stays open, so that there always is one.
        let key = |(i, there): (usize, &bool)| if i == 0 || *there { 0.0 } else { CLOSED };
        let closed: Vec<f32> = present.iter().enumerate().map(key).collect();
        let closed = TensorData::new(closed, [1, 1, 1, config.elements()]);
        self.fusion.forward(Tensor::cat(tokens, 0) + places, &Tensor::from_data(closed, device))
    }
}
