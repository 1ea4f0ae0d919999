//! A network that learns a curve.

use std::time::Duration;

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::{Device, Tensor, TensorData, activation};
use rand_chacha::rand_core::Rng;
use reactsim::training::{Execution, Output, Settings, Source, Stream, Sums, Task, View, draw_parameters};

/// Points on a curve.
pub(super) struct Curve {
    pub(super) ids: Vec<String>,
}

impl Curve {
    pub(super) fn of(n: usize) -> Self {
        Self { ids: (0..n).map(|i| format!("point-{i}")).collect() }
    }
}

impl Source for Curve {
    type Example = f32;

    fn len(&self) -> usize {
        self.ids.len()
    }

    fn id(&self, number: usize) -> &str {
        &self.ids[number]
    }

    fn digest(&self) -> String {
        format!("curve-{}", self.ids.len())
    }

    fn read(&self, number: usize) -> Result<f32, String> {
        Ok(number as f32 / self.ids.len() as f32)
    }
}

#[derive(Module, Debug)]
pub(super) struct Net {
    first: Linear,
    second: Linear,
    unused: Linear,
}

/// Learns sin(6x), with inputs that are varied a little.
pub(super) struct Toy;

impl Task for Toy {
    type Example = f32;
    type Sample = (f32, f32);
    type Model = Net;

    fn init(&self, seed: u64) -> Net {
        let device = Device::flex().autodiff();
        let linear = |i, o| LinearConfig::new(i, o).init(&device);
        draw_parameters(Net { first: linear(1, 32), second: linear(32, 1), unused: linear(2, 2) }, seed, 1.0)
    }

    fn prepare(&self, example: &f32, view: View<'_>) -> Option<(f32, f32)> {
        let shift = match view {
            View::Varied(stream) => (stream.next_u32() as f32 / u32::MAX as f32 - 0.5) * 0.02,
            View::Plain => 0.0,
        };
        let x = example + shift;
        Some((4.0 * x, (6.0 * x).sin()))
    }

    fn loss(&self, model: &Net, samples: &[(f32, f32)], _: Option<&mut Stream>) -> Output {
        let device = model.first.weight.device();
        let n = samples.len();
        let column = |f: fn(&(f32, f32)) -> f32| {
            let data = TensorData::new(samples.iter().map(f).collect::<Vec<f32>>(), [n, 1]);
            Tensor::<2>::from_data(data, &device)
        };
        let hidden = activation::tanh(model.first.forward(column(|s| s.0)));
        let error = model.second.forward(hidden) - column(|s| s.1);
        let mut metrics = Sums::new();
        let absolute = error.clone().abs().sum().into_scalar::<f32>();
        metrics.add("absolute_error", f64::from(absolute), n as f64);
        Output { loss: (error.clone() * error).sum(), items: n as f64, metrics }
    }
}

pub(super) fn settings() -> Settings {
    Settings {
        epochs: 60.0,
        batch: 16,
        together: 2,
        learning_rate: 0.02,
        held_out: 0.1,
        ..Settings::default()
    }
}

pub(super) fn execution(jobs: usize) -> Execution {
    Execution { jobs, checkpoint_every: Duration::from_secs(3600) }
}
