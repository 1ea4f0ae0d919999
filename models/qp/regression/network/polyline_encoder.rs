//! Encoder of polylines as tokens.

use burn::module::Module;
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, Perceptron, PerceptronKind, Rows, pool};

use super::batch::Polylines;
use super::config::{Config, Norms};
use super::layers::{NormedMlp, Observed};
use crate::regression::inputs::{agent_numbers, point_numbers};

/// A PointNet for polylines: points pass a perceptron and are pooled, pass another one together with
/// the pooled values, and are pooled again.
#[derive(Module, Debug)]
pub(crate) struct PolylineEncoder {
    pre_mlps: NormedMlp,
    mlps: NormedMlp,
    out_mlps: Perceptron,
    hidden: usize,
}

impl PolylineEncoder {
    /// Creates an encoder of histories of agents.
    pub(crate) fn of_agents(config: &Config, init: &mut Initializer) -> Self {
        let inputs = agent_numbers(config.attributes);
        Self::init(inputs, config.agent_hidden, 1, config.width, config.norms, init)
    }

    /// Creates an encoder of lines of the map.
    pub(crate) fn of_lines(config: &Config, init: &mut Initializer) -> Self {
        let inputs = point_numbers(config.attributes);
        Self::init(inputs, config.line_hidden, config.line_layers, config.width, config.norms, init)
    }

    /// Creates an encoder of `inputs` numbers per point with `layers` layers before the first pooling
    /// and two after it.
    fn init(
        inputs: usize,
        hidden: usize,
        layers: usize,
        outputs: usize,
        norms: Norms,
        init: &mut Initializer,
    ) -> Self {
        Self {
            pre_mlps: NormedMlp::init(inputs, &vec![hidden; layers], false, norms, init),
            mlps: NormedMlp::init(2 * hidden, &[hidden, hidden], false, norms, init),
            out_mlps: PerceptronKind::RELU.init(&[hidden, hidden, outputs], init),
            hidden,
        }
    }

    /// Encodes polylines as `[lines, outputs]`.
    pub(crate) fn forward(&self, lines: &Polylines, observed: &mut Observed) -> Tensor<2> {
        let (there, count) = (&lines.there, lines.count);
        let x = self.pre_mlps.rows(lines.points.clone(), Some(there), observed).times(there.clone()).done();
        let pooled = pool(x.clone(), count);
        // The first layer of the second perceptron takes points and pooled values side by side. Its
        // halves are applied separately, to pooled values once per line.
        let weight = self.mlps.first_weight();
        let of_points = weight.clone().narrow(0, 0, self.hidden);
        let of_pooled = Rows::product(pooled, weight.narrow(0, self.hidden, self.hidden)).done();
        let both = Rows::product(x, of_points).plus(of_pooled);
        let x = self.mlps.after_first(both, Some(there), observed).times(there.clone()).done();
        self.out_mlps.forward(pool(x, count))
    }
}
