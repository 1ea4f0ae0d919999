//! The network of PufferDrive 2.0: three encoders of rows, an LSTM cell, a policy over joint actions,
//! and a value.

use burn::module::{Module, Param};
use burn::nn::{Gelu, LayerNorm, Linear};
use burn::tensor::activation::{relu, sigmoid};
use burn::tensor::{Device, Tensor};
use reactsim_nn::{Initializer, largest};

/// Number of features of the vehicle itself.
pub const EGO: usize = 7;
/// Number of features of a partner.
pub const PARTNER: usize = 7;
/// Number of features of a piece of the road, its type one-hot.
pub const ROAD: usize = 13;
/// Width of the LSTM.
pub const HIDDEN: usize = 256;
/// Number of joint actions: 7 accelerations times 13 steering angles.
pub const ACTIONS: usize = 91;

/// Width of the encoders.
const ENCODER_WIDTH: usize = 64;

/// Linear layer, layer norm, linear layer, with nothing in between.
type Encoder = (Linear, LayerNorm, Linear);

/// The network. Field names are the tensor names of the file.
#[derive(Module, Debug)]
pub struct Network {
    policy: Policy,
    lstm: Lstm,
}

#[derive(Module, Debug)]
struct Policy {
    ego_encoder: Encoder,
    road_encoder: Encoder,
    partner_encoder: Encoder,
    shared_embedding: (Gelu, Linear),
    actor: Linear,
    value_fn: Linear,
}

/// The weights of PyTorch's `nn.LSTM` with one layer; gates in the order input, forget, cell, output.
#[derive(Module, Debug)]
struct Lstm {
    weight_ih_l0: Param<Tensor<2>>,
    weight_hh_l0: Param<Tensor<2>>,
    bias_ih_l0: Param<Tensor<1>>,
    bias_hh_l0: Param<Tensor<1>>,
}

/// State of the LSTM, each tensor [vehicles, [`HIDDEN`]].
#[derive(Clone, Debug)]
pub struct Recurrent {
    /// Hidden state.
    pub hidden: Tensor<2>,
    /// Cell state.
    pub cell: Tensor<2>,
}

/// Output of the network.
#[derive(Clone, Debug)]
pub struct Output {
    /// Logits of the joint actions, [vehicles, [`ACTIONS`]].
    pub logits: Tensor<2>,
    /// Values, [vehicles, 1].
    pub value: Tensor<2>,
    /// State of the LSTM for the next step.
    pub next: Recurrent,
}

impl Network {
    /// Creates a network with random weights, to be replaced by those of a file.
    pub fn init(init: &mut Initializer, device: &Device) -> Self {
        let mut encoder = |inputs| {
            (
                init.linear(inputs, ENCODER_WIDTH, true),
                init.norm(ENCODER_WIDTH),
                init.linear(ENCODER_WIDTH, ENCODER_WIDTH, true),
            )
        };
        let (ego_encoder, road_encoder, partner_encoder) = (encoder(EGO), encoder(ROAD), encoder(PARTNER));
        let weight = || Param::from_tensor(Tensor::zeros([4 * HIDDEN, HIDDEN], device));
        let bias = || Param::from_tensor(Tensor::zeros([4 * HIDDEN], device));
        Self {
            policy: Policy {
                ego_encoder,
                road_encoder,
                partner_encoder,
                shared_embedding: (Gelu::new(), init.linear(3 * ENCODER_WIDTH, HIDDEN, true)),
                actor: init.linear(HIDDEN, ACTIONS, true),
                value_fn: init.linear(HIDDEN, 1, true),
            },
            lstm: Lstm {
                weight_ih_l0: weight(),
                weight_hh_l0: weight(),
                bias_ih_l0: bias(),
                bias_hh_l0: bias(),
            },
        }
    }

    /// Runs one step of 0.1 s for every vehicle: `ego` [vehicles, [`EGO`]], `road` [vehicles, rows,
    /// [`ROAD`]], `partners` [vehicles, rows, [`PARTNER`]]. Unused rows are zero and count all the
    /// same.
    pub fn forward(&self, ego: Tensor<2>, road: Tensor<3>, partners: Tensor<3>, state: Recurrent) -> Output {
        let policy = &self.policy;
        let ego = encode(&policy.ego_encoder, ego);
        let road = largest(encode(&policy.road_encoder, road));
        let partners = largest(encode(&policy.partner_encoder, partners));
        let joined = Tensor::cat(vec![ego, road, partners], 1);
        let (gelu, linear) = &policy.shared_embedding;
        let next = self.lstm.forward(relu(linear.forward(gelu.forward(joined))), state);
        Output {
            logits: policy.actor.forward(next.hidden.clone()),
            value: policy.value_fn.forward(next.hidden.clone()),
            next,
        }
    }
}

fn encode<const D: usize>((first, norm, second): &Encoder, x: Tensor<D>) -> Tensor<D> {
    second.forward(norm.forward(first.forward(x)))
}

impl Lstm {
    fn forward(&self, x: Tensor<2>, state: Recurrent) -> Recurrent {
        let from_input = x.matmul(self.weight_ih_l0.val().transpose());
        let from_hidden = state.hidden.matmul(self.weight_hh_l0.val().transpose());
        let bias = self.bias_ih_l0.val() + self.bias_hh_l0.val();
        let gates = from_input + from_hidden + bias.unsqueeze();
        let gate = |i: usize| gates.clone().narrow(1, i * HIDDEN, HIDDEN);
        let cell = sigmoid(gate(1)) * state.cell + sigmoid(gate(0)) * gate(2).tanh();
        Recurrent { hidden: sigmoid(gate(3)) * cell.clone().tanh(), cell }
    }
}
