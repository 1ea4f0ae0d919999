//! Perceptrons.

use burn::module::{
    Content, Devices, Module, ModuleDisplay, ModuleDisplayDefault, ModuleMapper, ModuleVisitor,
};
use burn::nn::{LayerNorm, Linear};
use burn::tensor::activation::{elu, gelu_approximate, silu};
use burn::tensor::{Device, Tensor};

use super::{Initializer, Rows, gelu};

/// Activation after a hidden layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// ReLU.
    Relu,
    /// ELU.
    Elu,
    /// GELU.
    Gelu,
    /// Approximation of GELU by a hyperbolic tangent.
    GeluTanh,
    /// SiLU.
    Silu,
    /// SwiGLU: SiLU of the first half of the features times the second half. The linear layer before it has
    /// twice the hidden width.
    SwiGlu,
}

impl Activation {
    fn apply(self, rows: Rows) -> Tensor<2> {
        match self {
            Self::Relu => rows.relu().done(),
            Self::Elu => elu(rows.done(), 1.0),
            Self::Gelu => gelu(rows.done()),
            Self::GeluTanh => gelu_approximate(rows.done()),
            Self::Silu => silu(rows.done()),
            Self::SwiGlu => {
                let both = rows.done();
                let hidden = both.dims()[1] / 2;
                let (gate, value) = (both.clone().narrow(1, 0, hidden), both.narrow(1, hidden, hidden));
                silu(gate) * value
            }
        }
    }
}

/// Kind of a [`Perceptron`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PerceptronKind {
    /// Activation after each hidden layer.
    pub activation: Activation,
    /// Names of the linear layers in files, in order. A perceptron with fewer layers uses the first names.
    pub linears: &'static [&'static str],
    /// Names of the layer norms between linear layers and activations; empty if there are no norms.
    pub norms: &'static [&'static str],
}

impl PerceptronKind {
    /// Perceptrons with ReLU and without norms, numbered as in PyTorch's `Sequential`.
    pub const RELU: Self = Self { activation: Activation::Relu, linears: &["0", "2", "4"], norms: &[] };
    /// Perceptrons of the SMART family (SMART, CATK, TrajTok), with layer norms and ReLU.
    pub const SMART: Self = Self {
        activation: Activation::Relu,
        linears: &["mlp.0", "mlp.3", "mlp.6"],
        norms: &["mlp.1", "mlp.4"],
    };

    /// Builds a perceptron with initial weights. `widths` are the widths of the input, of each hidden layer and
    /// of the output.
    ///
    /// # Panics
    /// If there are no layers, or more layers than names.
    pub fn init(self, widths: &[usize], init: &mut Initializer) -> Perceptron {
        let layers = widths.len().saturating_sub(1);
        let has_norms = !self.norms.is_empty();
        let named = if has_norms { self.linears.len().min(self.norms.len() + 1) } else { self.linears.len() };
        assert!((1..=named).contains(&layers), "{layers} layers of {self:?}");
        let layer = |(i, pair): (usize, &[usize])| {
            let is_hidden = i + 1 < layers;
            let is_doubled = is_hidden && self.activation == Activation::SwiGlu;
            let width = if is_doubled { 2 * pair[1] } else { pair[1] };
            Layer {
                linear: init.linear(pair[0], width, true),
                norm: (is_hidden && has_norms).then(|| init.norm(width)),
            }
        };
        Perceptron { layers: widths.windows(2).enumerate().map(layer).collect(), kind: self }
    }
}

/// A linear layer, and the norm after it.
#[derive(Module, Debug)]
struct Layer {
    linear: Linear,
    norm: Option<LayerNorm>,
}

/// Linear layers with biases. Each but the last is followed by an activation, in some kinds after a norm.
#[derive(Clone, Debug)]
pub struct Perceptron {
    layers: Vec<Layer>,
    kind: PerceptronKind,
}

impl Perceptron {
    /// Maps `[n, inputs]` to `[n, outputs]`.
    pub fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        self.forward_dropping(x, |hidden| hidden)
    }

    /// Like [`Perceptron::forward`], with `dropout` applied to the features of hidden layers.
    pub fn forward_dropping(
        &self,
        mut x: Tensor<2>,
        mut dropout: impl FnMut(Tensor<2>) -> Tensor<2>,
    ) -> Tensor<2> {
        for (i, Layer { linear, norm }) in self.layers.iter().enumerate() {
            let rows = Rows::linear(linear, x);
            let rows = match norm {
                Some(norm) => rows.norm(norm),
                None => rows,
            };
            let is_hidden = i + 1 < self.layers.len();
            x = if is_hidden { dropout(self.kind.activation.apply(rows)) } else { rows.done() };
        }
        x
    }
}

/// Container of the layers of a perceptron, in the form of derived modules.
const CONTAINER: &str = "Struct:Perceptron";

// A derived module would name layers by fields and positions.
impl Module for Perceptron {
    fn visit<V: ModuleVisitor>(&self, visitor: &mut V) {
        for (i, Layer { linear, norm }) in self.layers.iter().enumerate() {
            visitor.enter_module(self.kind.linears[i], CONTAINER);
            linear.visit(visitor);
            visitor.exit_module(self.kind.linears[i], CONTAINER);
            if let Some(norm) = norm {
                visitor.enter_module(self.kind.norms[i], CONTAINER);
                norm.visit(visitor);
                visitor.exit_module(self.kind.norms[i], CONTAINER);
            }
        }
    }

    fn map<M: ModuleMapper>(self, mapper: &mut M) -> Self {
        let Self { layers, kind } = self;
        let layer = |(i, Layer { linear, norm }): (usize, Layer)| {
            mapper.enter_module(kind.linears[i], CONTAINER);
            let linear = linear.map(mapper);
            mapper.exit_module(kind.linears[i], CONTAINER);
            let norm = norm.map(|norm| {
                mapper.enter_module(kind.norms[i], CONTAINER);
                let norm = norm.map(mapper);
                mapper.exit_module(kind.norms[i], CONTAINER);
                norm
            });
            Layer { linear, norm }
        };
        Self { layers: layers.into_iter().enumerate().map(layer).collect(), kind }
    }

    fn collect_devices(&self, devices: Devices) -> Devices {
        self.layers.collect_devices(devices)
    }

    fn fork(self, device: &Device) -> Self {
        Self { layers: self.layers.fork(device), ..self }
    }

    fn to_device(self, device: &Device) -> Self {
        Self { layers: self.layers.to_device(device), ..self }
    }

    fn train(self) -> Self {
        Self { layers: self.layers.train(), ..self }
    }

    fn valid(&self) -> Self {
        Self { layers: self.layers.valid(), ..*self }
    }

    fn materialize(self) -> Self {
        Self { layers: self.layers.materialize(), ..self }
    }
}

impl ModuleDisplayDefault for Perceptron {
    fn content(&self, content: Content) -> Option<Content> {
        content.add("layers", &self.layers).optional()
    }
}

impl ModuleDisplay for Perceptron {}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::{Tensors, device, linear, save};

    fn saved(perceptron: &Perceptron) -> Vec<u8> {
        save(perceptron, &BTreeMap::new())
    }

    #[test]
    fn files_have_the_names_of_the_kind() {
        let swiglu =
            PerceptronKind { activation: Activation::SwiGlu, linears: &["w12", "w3"], norms: &["norm"] };
        for (kind, widths, expected) in [
            (PerceptronKind::RELU, &[3, 2][..], &["0.bias [2]", "0.weight [2, 3]"][..]),
            (
                swiglu,
                &[3, 4, 2],
                &[
                    "norm.bias [8]",
                    "norm.weight [8]",
                    "w12.bias [8]",
                    "w12.weight [8, 3]",
                    "w3.bias [2]",
                    "w3.weight [2, 4]",
                ],
            ),
        ] {
            let init = |seed| kind.init(widths, &mut Initializer::new(seed, &device()));
            let bytes = saved(&init(1));
            let file = Tensors::read(&bytes).unwrap();
            let names: Vec<String> = file.shapes().map(|(name, shape)| format!("{name} {shape:?}")).collect();
            assert_eq!(names, expected);
            assert_ne!(saved(&init(2)), bytes);
            assert_eq!(saved(&file.load(init(2)).unwrap()), bytes);
        }
    }

    #[test]
    #[should_panic(expected = "4 layers")]
    fn every_layer_needs_a_name() {
        PerceptronKind::RELU.init(&[1; 5], &mut Initializer::new(1, &device()));
    }

    #[test]
    fn activations_follow_hidden_layers_and_dropout_follows_activations() {
        let x = || Tensor::<2>::from_data([[-1.0f32, 2.0]], &device());
        let numbers = |x: Tensor<2>| x.into_data().iter::<f32>().collect::<Vec<_>>();
        let perceptron = PerceptronKind::RELU.init(&[2, 4, 3, 2], &mut Initializer::new(1, &device()));
        let [first, second, third] = [0, 1, 2].map(|i| &perceptron.layers[i].linear);
        let hidden = linear(second, linear(first, x()).clamp_min(0.0)).clamp_min(0.0);
        assert_eq!(numbers(perceptron.forward(x())), numbers(linear(third, hidden.clone())));
        let mut seen = Vec::new();
        let dropped = perceptron.forward_dropping(x(), |hidden| {
            seen.push(numbers(hidden.clone()));
            hidden * 0.0
        });
        assert_eq!(seen.len(), 2);
        assert_eq!(numbers(dropped), [0.0; 2], "biases begin at 0");
    }
}
