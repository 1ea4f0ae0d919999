//! The loss of VBD: the motion that denoised actions lead to, and that of the behaviour towards the right
//! anchor.

use burn::tensor::activation::log_softmax;
use burn::tensor::{Device, Int, Tensor, TensorData};
use rand::RngExt;
use reactsim_nn::learning::Intentions;
use reactsim_nn::training::{Output, Stream, Sums};

use super::super::network::{Encoded, Vbd, VbdConfig};
use super::super::sampling::with_av;
use super::Recipe;
use super::sample::{AV, Sample, TRUTH};
use crate::{Schedule, own_motion, standard_normal};

/// Weight of the scores of anchors (published).
const SCORES: f64 = 0.05;

/// Parts of the loss that stay the same in a training.
pub(super) struct LossSettings<'a> {
    pub(super) recipe: &'a Recipe,
    pub(super) schedule: &'a Schedule,
    pub(super) anchors: &'a Intentions,
}

/// Returns the loss of samples. Noise and its level are drawn from the stream.
pub(super) fn loss(
    network: &Vbd,
    samples: &[Sample],
    settings: &LossSettings<'_>,
    stream: &mut Stream,
    device: &Device,
) -> Output {
    let recipe = settings.recipe;
    let config = &recipe.network;
    let mut total = Tensor::<1>::zeros([1], device);
    let mut items = 0.0;
    let mut metrics = Sums::new();
    for sample in samples {
        let agents = sample.agents.len();
        let level = stream.random_range(0..settings.schedule.steps());
        let speeds = sample.seen.speeds(device);
        let shape = [agents, config.actions, 2];
        let clean = Tensor::<3>::from_data(TensorData::new(sample.actions.clone(), shape), device);
        let noise = standard_normal(stream, shape, device);
        let mut noisy = settings.schedule.add_noise(clean.clone(), noise, level);
        let av_given = agents > 1 && config.av_given > 0.0 && stream.random_bool(config.av_given);
        if av_given {
            noisy = with_av(clean.narrow(0, 0, 1), noisy);
        }
        let scene = network.encode(&sample.seen.input, config, device);
        let prepared = network.prepare(&sample.seen.input, &scene, agents, av_given, config);
        let found = network.denoise(&prepared, noisy, &speeds, level, config);
        let motion = own_motion(found, &speeds, config.hold);
        let denoised = motion_loss(motion.clone(), sample, config);

        let weight: f64 = sample.agents.iter().map(|w| f64::from(*w)).sum();
        add(&mut metrics, "denoised", &denoised, weight);
        total = total + denoised;
        if recipe.avoid > 0.0 {
            let overlaps = overlaps_with_av(motion, sample, config);
            add(&mut metrics, "overlap", &overlaps, weight);
            total = total + overlaps * recipe.avoid;
        }
        if stream.random_bool(recipe.predicted) {
            let (predicted, scores) = predictor_loss(network, &scene, sample, settings, device);
            add(&mut metrics, "predicted", &predicted, weight);
            add(&mut metrics, "score", &scores, weight);
            total = total + (predicted + scores * SCORES) * recipe.predictor;
        }
        items += weight;
    }
    Output::new(total, items, metrics)
}

/// Returns the loss of the behaviours towards the anchors that the agents headed for, and that of the scores
/// of anchors.
fn predictor_loss(
    network: &Vbd,
    scene: &Encoded,
    sample: &Sample,
    settings: &LossSettings<'_>,
    device: &Device,
) -> (Tensor<1>, Tensor<1>) {
    let config = &settings.recipe.network;
    let (agents, count) = (sample.agents.len(), settings.anchors.count());
    let behaviours = network.behaviours(scene, sample.seen.anchors(settings.anchors, device), config);
    let numbers = |values: Vec<i32>| Tensor::<1, Int>::from_data(TensorData::new(values, [agents]), device);
    let labels = numbers(sample.headings.iter().map(|h| *h as i32).collect());
    let rows = sample.headings.iter().enumerate().map(|(agent, h)| (agent * count + h) as i32);
    let chosen = behaviours.actions.reshape([agents * count, config.actions, 2]);
    let chosen = chosen.select(0, numbers(rows.collect()));
    let motion = own_motion(chosen, &sample.seen.speeds(device), config.hold);
    let predicted = motion_loss(motion, sample, config);
    let weights = Tensor::<2>::from_data(TensorData::new(sample.agents.clone(), [agents, 1]), device);
    let log_p = log_softmax(behaviours.scores, 1).gather(1, labels.unsqueeze_dim::<2>(1));
    (predicted, -(log_p * weights).sum())
}

/// Adds a part of the loss to the metrics.
fn add(metrics: &mut Sums, name: &'static str, value: &Tensor<1>, weight: f64) {
    metrics.add(name, f64::from(value.clone().into_scalar::<f32>()), weight);
}

/// Returns the weighted sum of the errors of motion, `[agents, states, 5]`: smooth absolute differences of
/// positions (m), and absolute ones of yaws (rad).
fn motion_loss(motion: Tensor<3>, sample: &Sample, config: &VbdConfig) -> Tensor<1> {
    let device = motion.device();
    let agents = sample.agents.len();
    let truth = TensorData::new(sample.truth.clone(), [agents, config.states(), TRUTH]);
    let apart = motion.narrow(2, 0, TRUTH) - Tensor::<3>::from_data(truth, &device);
    let places = smooth(apart.clone().narrow(2, 0, 2)).sum_dim(2);
    let turns = apart.narrow(2, 2, 1);
    let circles = (turns.clone().detach() / std::f64::consts::TAU).round() * std::f64::consts::TAU;
    let turns = (turns - circles).abs();
    let weights = TensorData::new(sample.weights.clone(), [agents, config.states(), 1]);
    ((places + turns) * Tensor::<3>::from_data(weights, &device)).sum()
}

/// Returns the weighted sum of the depths, m, to which agents that move like this, `[agents, states, 5]`,
/// overlap with the AV where they did not in truth.
fn overlaps_with_av(motion: Tensor<3>, sample: &Sample, config: &VbdConfig) -> Tensor<1> {
    let device = motion.device();
    let (agents, states) = (sample.agents.len(), config.states());
    let av = TensorData::new(sample.av.clone(), [agents, states, AV]);
    let av = Tensor::<3>::from_data(av, &device);
    let column = |k: usize| av.clone().narrow(2, k, 1);
    let (x, y) = (motion.clone().narrow(2, 0, 1) - column(0), motion.narrow(2, 1, 1) - column(1));
    let ahead = x.clone() * column(2) + y.clone() * column(3);
    let aside = y * column(2) - x * column(3);
    let depth = (column(4) - ahead.abs()).min_pair(column(5) - aside.abs()).clamp_min(0.0);
    let weights = TensorData::new(sample.weights.clone(), [agents, states, 1]);
    (depth * Tensor::<3>::from_data(weights, &device)).sum()
}

/// Half the square up to 1, the absolute value less a half beyond.
fn smooth(x: Tensor<3>) -> Tensor<3> {
    let size = x.abs();
    let near = size.clone().clamp_max(1.0);
    near.clone() * near.clone() * 0.5 + (size - near)
}

#[cfg(test)]
mod tests {
    use reactsim_nn::device;

    use super::*;

    #[test]
    fn the_depth_of_overlaps_with_the_av_counts() {
        // The AV is 10 m ahead of an agent that turns by 90 degrees; they overlap below 5 m along it and 2 m
        // across.
        let config = VbdConfig { actions: 1, hold: 2, ..VbdConfig::default() };
        let av = [10.0, 0.0, 1.0, 0.0, 5.0, 2.0, 10.0, 0.0, 0.0, 1.0, 5.0, 2.0];
        let sample =
            Sample { weights: vec![0.5, 0.25], av: av.to_vec(), agents: vec![1.0], ..Sample::default() };
        let depth = |places: [[f32; 2]; 2]| {
            let motion = places.map(|[x, y]| [x, y, 0.0, 0.0, 0.0]).concat();
            let motion = Tensor::from_data(TensorData::new(motion, [1, 2, 5]), &device());
            overlaps_with_av(motion, &sample, &config).into_scalar::<f32>()
        };
        assert_eq!(depth([[0.0, 0.0], [0.0, 0.0]]), 0.0);
        // 1 m along the agent, then 1.5 m across it, which points to the left.
        assert_eq!(depth([[6.0, 0.0], [0.0, 0.0]]), 0.5);
        assert_eq!(depth([[0.0, 0.0], [9.5, 0.5]]), 0.375);
        // Beside or behind is apart.
        assert_eq!(depth([[10.0, 2.5], [10.0, 5.5]]), 0.0);
    }
}
