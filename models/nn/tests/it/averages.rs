//! Running averages among the parameters of a network.

use std::sync::atomic::AtomicBool;

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::{Device, Tensor, TensorData};
use reactsim_nn::training::{
    Average, Execution, Learner, Output, Settings, Stream, Sums, Task, draw_parameters,
};
use serde_json::Map;

use super::toy::{Curve, settings};

#[derive(Module, Debug)]
struct Net {
    linear: Linear,
    mean: Average,
}

/// Learns a line, and on the way the mean of its inputs.
struct Line;

impl Task for Line {
    type Example = f32;
    type Sample = f32;
    type Model = Net;

    fn init(&self, seed: u64) -> Net {
        let device = Device::flex().autodiff();
        let linear = draw_parameters(LinearConfig::new(1, 1).init(&device), seed, 1.0);
        Net { linear, mean: Average::new(Tensor::zeros([1], &device)) }
    }

    fn prepare(&self, example: &f32, _: Option<&mut Stream>) -> Option<f32> {
        Some(*example)
    }

    fn loss(&self, model: &Net, samples: &[f32], _: Option<&mut Stream>) -> Output {
        let device = model.linear.weight.device();
        let n = samples.len();
        let x = Tensor::<2>::from_data(TensorData::new(samples.to_vec(), [n, 1]), &device);
        let error = model.linear.forward(x.clone()) - x.clone() * 2.0;
        let averages = vec![model.mean.observe(x.mean())];
        Output { averages, ..Output::new((error.clone() * error).sum(), n as f64, Sums::new()) }
    }
}

#[test]
fn averages_follow_the_values_of_batches_and_change_nothing_else() {
    let learned = |jobs, clip| {
        let folder = tempfile::tempdir().unwrap();
        let source = Curve::of(64);
        let learner = Learner {
            task: &Line,
            source: &source,
            // One batch per epoch has all examples.
            settings: Settings { epochs: 30.0, batch: 64, held_out: 0.0, clip, ..settings() },
            execution: Execution {
                jobs,
                checkpoint_every: std::time::Duration::from_secs(3600),
                keep_every: 0,
            },
            about: Map::new(),
            closed_loop: None,
            observer: &(),
        };
        let net = learner.learn(folder.path(), false, &AtomicBool::new(false)).unwrap().model;
        let number = |tensor: Tensor<1>| tensor.into_data().iter::<f32>().next().unwrap();
        (number(net.mean.val()), number(net.linear.weight.val().flatten(0, 1)))
    };
    let (mean, weight) = learned(1, 1.0);
    let wanted = (0..64).map(|i| i as f32 / 64.0).sum::<f32>() / 64.0 * (1.0 - 0.9f32.powi(30));
    assert!((mean - wanted).abs() < 1e-5, "{mean} {wanted}");
    assert_eq!(learned(2, 1.0), (mean, weight));
    // Clipping concerns the gradient of the others alone.
    let (clipped, slower) = learned(1, 1e-3);
    assert_eq!(clipped, mean);
    assert_ne!(slower, weight);
}
