//! Initial parameter values that depend only on the seed and the parameter's name.

use burn::module::Module;
use reactsim_geometry::math;

use super::parameters::{self, Owner, Parameter};
use super::stream::{Stream, stream, unit};

/// Redraws the parameters of all linear layers and embeddings of a network, each from a stream named
/// by seed and path. Burn's own random numbers are shared by all threads of the program, and so depend
/// on what else runs. Other parameters are left unchanged.
///
/// Weights and biases of linear layers are uniform within ±1/√(inputs), as in PyTorch
/// (<https://pytorch.org/docs/stable/generated/torch.nn.Linear.html>); embeddings are normal with
/// standard deviation `embedding_deviation`.
pub fn draw_parameters<M: Module>(model: M, seed: u64, embedding_deviation: f32) -> M {
    let (layout, mut values) = parameters::read(&model);
    let mut inputs = 1;
    for parameter in &layout.parameters {
        let Parameter { path, owner, shape, range, .. } = parameter;
        let list = &mut values[range.clone()];
        let mut stream = stream(seed, "initial", 0, path);
        match owner {
            Owner::Linear => {
                // The bias follows the weight, which is [inputs, outputs].
                if shape.len() == 2 {
                    inputs = shape[0].max(1);
                }
                let bound = 1.0 / (inputs as f32).sqrt();
                list.fill_with(|| bound * (2.0 * unit(&mut stream) - 1.0));
            }
            Owner::Embedding => list.fill_with(|| embedding_deviation * normal(&mut stream)),
            Owner::Average | Owner::Other => {}
        }
    }
    parameters::write(model, &values)
}

/// Draws a number from the standard normal distribution.
fn normal(stream: &mut Stream) -> f32 {
    let (u, v) = (1.0 - f64::from(unit(stream)), f64::from(unit(stream)));
    math::standard_normal(u, v) as f32
}
