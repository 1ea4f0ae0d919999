//! The loss, as in MTR. For the mode whose intention point is nearest to the end of the true
//! trajectory: the likelihood of the true states, the error of the velocity, and the score. In training
//! the same, without scores, for the dense prediction.

use burn::tensor::activation::log_softmax;
use burn::tensor::{Device, Int, Tensor, TensorData};
use reactsim_nn::learning::Intentions;
use reactsim_nn::training::{Output, Sums};

use super::super::network::{Batch, Config, LayerOutput, Network, STATE};
use super::super::predict::{MAX_CORRELATION, MAX_LOG_DEVIATION, MIN_LOG_DEVIATION};
use super::sample::{Sample, TRUTH_SIZE, Target, Truth};

/// Weight of a velocity error of 1 m/s in modes; in the dense prediction the weight is 1 (MTR).
const VELOCITY_WEIGHT: f64 = 0.5;

/// Runs the network over samples. In training, batch norms use the rows of this pass. Returns the loss, summed over
/// targets, and the output of the last layer.
pub(super) fn loss(
    network: &Network,
    samples: &[Sample],
    intentions: &Intentions,
    config: &Config,
    device: &Device,
    training: bool,
) -> (Output, Option<LayerOutput>) {
    let targets: Vec<&Target> = samples.iter().flat_map(|s| &s.targets).collect();
    let around: Vec<_> = targets.iter().map(|target| &target.around).collect();
    let batch = Batch::of(&around, intentions, config, device);
    let mut predicted = network.forward(&batch, config, training);

    let count = targets.len();
    let nearest_query = |t: &&Target| intentions.nearest(t.around.class, t.goal);
    let queries: Vec<usize> = targets.iter().map(nearest_query).collect();
    let rows = queries.iter().enumerate().map(|(i, q)| (i * batch.queries + q) as i32);
    let rows = ints(rows.collect(), device);
    let labels = ints(queries.iter().map(|&q| q as i32).collect(), device).unsqueeze_dim::<2>(1);
    let truths: Vec<&Truth> = targets.iter().map(|t| &t.truth).collect();
    let (truth, known) = truth_tensors(&truths, &vec![1.0; count], config, device);

    let layers = predicted.layers.len() as f64;
    let mut total = Tensor::<1>::zeros([1], device);
    let states = targets.iter().flat_map(|t| &t.truth.known).map(|k| f64::from(*k)).sum();
    let mut metrics = Sums::new();
    for (i, layer) in predicted.layers.iter().enumerate() {
        let mode = layer.modes.clone().select(0, rows.clone());
        let (likelihood, velocity) = state_losses(mode, truth.clone(), known.clone());
        let log_p = log_softmax(layer.scores.clone(), 1);
        let entropy = -log_p.clone().gather(1, labels.clone()).sum();
        total = total + (likelihood.clone() + velocity * VELOCITY_WEIGHT + entropy.clone()) / layers;
        if i + 1 == predicted.layers.len() {
            let right = log_p.argmax(1).equal(labels.clone()).float().sum();
            metrics.add("surprise", scalar(likelihood), states);
            metrics.add("score", scalar(entropy), count as f64);
            metrics.add("right_query", scalar(right), count as f64);
        }
    }

    // Simulators do not execute the dense prediction. In a validation on recordings, the few agents in it
    // that set off would decide which network is the best.
    if training {
        total = total + dense_loss(predicted.dense, &targets, config, device);
    }
    (
        Output { averages: predicted.averages, ..Output::new(total, count as f64, metrics) },
        predicted.layers.pop(),
    )
}

/// Returns the loss of the dense prediction: of the other agents in the input, weighted by the inverse of
/// their number per target.
fn dense_loss(predicted: Tensor<3>, targets: &[&Target], config: &Config, device: &Device) -> Tensor<1> {
    let (mut truths, mut weights) = (Vec::new(), Vec::new());
    let nobody = Truth { states: vec![0.0; config.states() * TRUTH_SIZE], known: vec![0.0; config.states()] };
    for target in targets {
        let is_known = |t: &Truth| t.known.contains(&1.0);
        let with = target.others.iter().filter(|t| is_known(t)).count().max(1);
        for i in 0..config.agents {
            truths.push(target.others.get(i).unwrap_or(&nobody));
            weights.push(1.0 / with as f32);
        }
    }
    let (truth, weight) = truth_tensors(&truths, &weights, config, device);
    let (likelihood, velocity) = state_losses(predicted, truth, weight);
    likelihood + velocity
}

fn scalar(value: Tensor<1>) -> f64 {
    f64::from(value.into_scalar::<f32>())
}

fn ints(values: Vec<i32>, device: &Device) -> Tensor<1, Int> {
    let n = values.len();
    Tensor::from_data(TensorData::new(values, [n]), device)
}

/// Returns true states `[n, states, 4]` and their weights `[n, states, 1]`, 0 where unknown.
fn truth_tensors(
    truths: &[&Truth],
    weights: &[f32],
    config: &Config,
    device: &Device,
) -> (Tensor<3>, Tensor<3>) {
    let (n, s) = (truths.len(), config.states());
    let states: Vec<f32> = truths.iter().flat_map(|t| t.states.iter().copied()).collect();
    let known = truths.iter().zip(weights).flat_map(|(t, w)| t.known.iter().map(move |k| k * w)).collect();
    (
        Tensor::from_data(TensorData::new(states, [n, s, TRUTH_SIZE]), device),
        Tensor::from_data(TensorData::new::<f32, _>(known, [n, s, 1]), device),
    )
}

/// Returns weighted sums over all states: negative log-likelihoods of the true positions, without the
/// constant, and absolute differences of velocities.
fn state_losses(output: Tensor<3>, truth: Tensor<3>, weight: Tensor<3>) -> (Tensor<1>, Tensor<1>) {
    let number = |from: usize, count: usize| output.clone().narrow(2, from, count);
    let logs = number(2, 2).clamp(MIN_LOG_DEVIATION, MAX_LOG_DEVIATION);
    let rho = number(4, 1).clamp(-MAX_CORRELATION, MAX_CORRELATION);
    // Distance in standard deviations.
    let away = (truth.clone().narrow(2, 0, 2) - number(0, 2)) * (-logs.clone()).exp();
    let (x, y) = (away.clone().narrow(2, 0, 1), away.narrow(2, 1, 1));
    let rest = -(rho.clone() * rho.clone()) + 1.0;
    let squares = x.clone() * x.clone() + y.clone() * y.clone() - rho * x * y * 2.0;
    let surprise = logs.sum_dim(2) + rest.clone().log() * 0.5 + squares / (rest * 2.0);
    let likelihood = (surprise * weight.clone()).sum();
    let velocity = (number(STATE - 2, 2) - truth.narrow(2, 2, 2)).abs().sum_dim(2);
    (likelihood, (velocity * weight).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_likelihood_is_that_of_a_normal_distribution() {
        let device = reactsim_nn::device();
        let output = [1.0f32, 2.0, 0.5, -0.25, 0.3, 4.0, 5.0];
        let truth = [1.7f32, 1.5, 3.0, 7.0];
        let of = |v: &[f32]| Tensor::<3>::from_data(TensorData::new(v.to_vec(), [1, 1, v.len()]), &device);
        let (likelihood, velocity) = state_losses(of(&output), of(&truth), of(&[2.0]));
        let (sx, sy, r) = (0.5f64.exp(), (-0.25f64).exp(), 0.3f64);
        let (dx, dy) = (0.7 / sx, -0.5 / sy);
        let wanted = (sx * sy * (1.0 - r * r).sqrt()).ln()
            + (dx * dx + dy * dy - 2.0 * r * dx * dy) / (2.0 * (1.0 - r * r));
        assert!((scalar(likelihood) - 2.0 * wanted).abs() < 1e-5);
        assert!((scalar(velocity) - 2.0 * 3.0).abs() < 1e-6);
    }
}
