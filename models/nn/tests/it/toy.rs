//! A network that learns a curve.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::{Device, Tensor, TensorData, activation};
use rand_chacha::rand_core::Rng;
use reactsim_nn::training::{
    ClosedLoop, Execution, LOG, Learner, NamedTensors, Observer, Outcome, Output, Row, Settings, Source,
    Stream, Sums, Task, TrainingError, WEIGHTS, Wall, draw_parameters, read_log,
};
use serde_json::Map;

/// Points on a curve.
pub(super) struct Curve {
    pub(super) ids: Vec<String>,
    /// Index of an example whose value is not finite.
    pub(super) poison: Option<usize>,
    /// Index of an example that gives no sample.
    pub(super) empty: Option<usize>,
    /// Index of an example that cannot be read.
    pub(super) torn: Option<usize>,
}

impl Curve {
    pub(super) fn of(n: usize) -> Self {
        Self { ids: (0..n).map(|i| format!("point-{i}")).collect(), poison: None, empty: None, torn: None }
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
        if self.poison == Some(number) {
            return Ok(f32::NAN);
        }
        if self.torn == Some(number) {
            return Err("the disk says no".to_owned());
        }
        let x = number as f32 / self.ids.len() as f32;
        Ok(if self.empty == Some(number) { -x } else { x })
    }
}

#[derive(Module, Debug)]
pub(super) struct Net {
    first: Linear,
    second: Linear,
    unused: Linear,
}

/// Learns sin(6x), with inputs that are varied a little.
#[derive(Default)]
pub(super) struct Toy {
    /// Whether the first network counts as trained.
    pub(super) trained: bool,
}

impl Task for Toy {
    type Example = f32;
    type Sample = (f32, f32);
    type Model = Net;

    fn init(&self, seed: u64) -> Net {
        let device = Device::flex().autodiff();
        let linear = |i, o| LinearConfig::new(i, o).init(&device);
        draw_parameters(Net { first: linear(1, 32), second: linear(32, 1), unused: linear(2, 2) }, seed, 1.0)
    }

    fn begins_trained(&self) -> bool {
        self.trained
    }

    fn prepare(&self, example: &f32, stream: Option<&mut Stream>) -> Option<(f32, f32)> {
        let shift = stream.map_or(0.0, |stream| (stream.next_u32() as f32 / u32::MAX as f32 - 0.5) * 0.02);
        if *example < 0.0 {
            return None;
        }
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
        Output::new((error.clone() * error).sum(), n as f64, metrics)
    }
}

/// Outcome of a training.
pub(super) type Learned = Result<Outcome<Net>, TrainingError>;

pub(super) fn settings() -> Settings {
    Settings {
        epochs: 10.0,
        batch: 16,
        together: 2,
        learning_rate: 0.02,
        warm_up: 5,
        held_out: 0.1,
        validate_every: 7,
        ..Settings::default()
    }
}

/// A training of the toy network.
pub(super) struct Trial<'a> {
    pub(super) task: Toy,
    pub(super) source: Curve,
    pub(super) settings: Settings,
    pub(super) jobs: usize,
    pub(super) observer: &'a dyn Observer,
    pub(super) checkpoint_every: Duration,
    pub(super) keep_every: u64,
}

impl Default for Trial<'_> {
    fn default() -> Self {
        Self {
            task: Toy::default(),
            source: Curve::of(64),
            settings: settings(),
            jobs: 2,
            observer: &(),
            checkpoint_every: Duration::ZERO,
            keep_every: 0,
        }
    }
}

impl Trial<'_> {
    pub(super) fn learn(&self, folder: &Path, resume: bool) -> Learned {
        self.learn_until(folder, resume, &AtomicBool::new(false))
    }

    pub(super) fn learn_until(&self, folder: &Path, resume: bool, stop: &AtomicBool) -> Learned {
        self.learn_with(folder, resume, stop, None)
    }

    pub(super) fn learn_with(
        &self,
        folder: &Path,
        resume: bool,
        stop: &AtomicBool,
        closed_loop: Option<&ClosedLoop<'_, Net>>,
    ) -> Learned {
        let learner = Learner {
            task: &self.task,
            source: &self.source,
            settings: self.settings.clone(),
            execution: Execution {
                jobs: self.jobs,
                checkpoint_every: self.checkpoint_every,
                keep_every: self.keep_every,
            },
            about: Map::new(),
            closed_loop,
            observer: self.observer,
        };
        learner.learn(folder, resume, stop)
    }
}

/// Returns the log without clock times, and the weights: all results of a training.
pub(super) fn left(folder: &Path) -> (Vec<Row>, NamedTensors) {
    let mut rows = read_log(&folder.join(LOG)).unwrap();
    for row in &mut rows {
        match row {
            Row::Step(row) => row.wall = Wall::default(),
            Row::Validation(row) => row.wall = Wall::default(),
        }
    }
    (rows, NamedTensors::read(&folder.join(WEIGHTS)).unwrap())
}

/// Returns the checkpoints of a folder.
pub(super) fn checkpoints(folder: &Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    found.retain(|p| p.file_name().unwrap().to_str().unwrap().starts_with("checkpoint-"));
    found.sort();
    found
}
