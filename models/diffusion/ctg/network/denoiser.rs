//! The denoiser of actions: a U-Net along time.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear};
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, linear, mish};

use super::convolution::Convolution;
use super::motion::NUMBERS;

/// Taps of the convolutions.
const TAPS: usize = 5;

/// Two convolutions with the condition between them, and a residual.
#[derive(Module, Debug)]
struct Block {
    first: Convolution,
    first_norm: LayerNorm,
    condition: Linear,
    second: Convolution,
    second_norm: LayerNorm,
    residual: Option<Convolution>,
}

impl Block {
    fn init(inputs: usize, outputs: usize, condition: usize, init: &mut Initializer) -> Self {
        Self {
            first: Convolution::init(TAPS, inputs, outputs, init),
            first_norm: init.norm(outputs),
            condition: init.linear(condition, outputs, true),
            second: Convolution::init(TAPS, outputs, outputs, init),
            second_norm: init.norm(outputs),
            residual: (inputs != outputs).then(|| Convolution::init(1, inputs, outputs, init)),
        }
    }

    /// Maps `[n, steps, inputs]` by `[n, condition]` to `[n, steps, outputs]`.
    fn forward(&self, x: Tensor<3>, condition: &Tensor<2>) -> Tensor<3> {
        let [n, steps, _] = x.dims();
        let given = linear(&self.condition, mish(condition.clone()));
        let outputs = given.dims()[1];
        let shape = [n, steps, outputs];
        let residual = match &self.residual {
            Some(residual) => residual.forward(x.clone(), 1),
            None => x.clone(),
        };
        let hidden = mish(self.first.rows(x, 1).norm(&self.first_norm).done()).reshape(shape);
        let hidden = hidden + given.unsqueeze_dim::<3>(1);
        mish(self.second.rows(hidden, 1).norm(&self.second_norm).done()).reshape(shape) + residual
    }
}

/// A level on the way down: two blocks, and a convolution that halves the number of steps unless it is the
/// last.
#[derive(Module, Debug)]
struct Down {
    blocks: Vec<Block>,
    halve: Option<Convolution>,
}

/// A level on the way up: two blocks, and a convolution after the number of steps was doubled.
#[derive(Module, Debug)]
struct Up {
    blocks: Vec<Block>,
    double: Convolution,
}

/// A U-Net of three levels.
#[derive(Module, Debug)]
pub(super) struct Denoiser {
    downs: Vec<Down>,
    middle: Vec<Block>,
    ups: Vec<Up>,
    last: Convolution,
    last_norm: LayerNorm,
    output: Linear,
}

impl Denoiser {
    /// Creates a network of three levels whose widths are multiples of this one.
    pub(super) fn init(width: usize, condition: usize, init: &mut Initializer) -> Self {
        let widths = [NUMBERS, 2 * width, 4 * width, 8 * width];
        let mut down = |level: usize| {
            let (inputs, outputs) = (widths[level], widths[level + 1]);
            Down {
                blocks: vec![
                    Block::init(inputs, outputs, condition, init),
                    Block::init(outputs, outputs, condition, init),
                ],
                halve: (level < 2).then(|| Convolution::init(3, outputs, outputs, init)),
            }
        };
        let downs = (0..3).map(&mut down).collect();
        let widest = widths[3];
        let middle = (0..2).map(|_| Block::init(widest, widest, condition, init)).collect();
        let mut up = |level: usize| {
            let (inputs, outputs) = (widths[level + 1], widths[level]);
            Up {
                blocks: vec![
                    Block::init(2 * inputs, outputs, condition, init),
                    Block::init(outputs, outputs, condition, init),
                ],
                double: Convolution::init(3, outputs, outputs, init),
            }
        };
        let ups = [2, 1].into_iter().map(&mut up).collect();
        let last = Convolution::init(TAPS, widths[1], widths[1], init);
        Self {
            downs,
            middle,
            ups,
            last,
            last_norm: init.norm(widths[1]),
            output: init.linear(widths[1], 2, true),
        }
    }

    /// Returns the clean actions, `[n, actions, 2]`, of noisy trajectories, `[n, actions, 6]`, under
    /// conditions, `[n, condition]`.
    pub(super) fn forward(&self, noisy: Tensor<3>, condition: &Tensor<2>) -> Tensor<3> {
        let [n, actions, _] = noisy.dims();
        let through = |x, blocks: &[Block]| blocks.iter().fold(x, |x, block| block.forward(x, condition));
        let (mut x, mut kept) = (noisy, Vec::new());
        for down in &self.downs {
            x = through(x, &down.blocks);
            kept.push(x.clone());
            if let Some(halve) = &down.halve {
                x = halve.forward(x, 2);
            }
        }
        x = through(x, &self.middle);
        for (up, kept) in self.ups.iter().zip(kept.into_iter().rev()) {
            x = through(Tensor::cat(vec![x, kept], 2), &up.blocks);
            let [_, steps, width] = x.dims();
            let doubled = x.unsqueeze_dim::<4>(2).repeat_dim(2, 2).reshape([n, 2 * steps, width]);
            x = up.double.forward(doubled, 1);
        }
        let rows = mish(self.last.rows(x, 1).norm(&self.last_norm).done());
        linear(&self.output, rows).reshape([n, actions, 2])
    }
}
