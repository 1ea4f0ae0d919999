//! The network against values of the public code, with random weights at a small size.
#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::fs;
use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use safetensors::SafeTensors;
use safetensors::tensor::Dtype;

use super::{DiffusionPlanner, PlannerConfig, PlannerInput};
use crate::models::nn::{Initializer, Tensors, device};

/// The configuration of the golden data.
const CONFIG: PlannerConfig = PlannerConfig { width: 64, heads: 4, ..PlannerConfig::published() };
/// Number of trajectories.
const COUNT: usize = 11;

/// A file of tensors.
struct File(Vec<u8>);

impl File {
    fn data(&self, name: &str, dtype: Dtype) -> Vec<u8> {
        let file = SafeTensors::deserialize(&self.0).unwrap();
        let tensor = file.tensor(name).unwrap_or_else(|_| panic!("no {name}"));
        assert_eq!(tensor.dtype(), dtype, "{name}");
        tensor.data().to_vec()
    }

    fn floats(&self, name: &str) -> Vec<f32> {
        self.data(name, Dtype::F32).as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
    }
}

/// Returns the folder of the golden data; `None` if it is missing.
fn folder() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/diffusion_planner_golden");
    if !folder.is_dir() {
        eprintln!("skipped: {} is missing", folder.display());
        return None;
    }
    Some(folder)
}

fn load(folder: &Path, device: &Device) -> DiffusionPlanner {
    let bytes = fs::read(folder.join("weights.safetensors")).unwrap();
    let tensors = Tensors::read(&bytes).unwrap();
    tensors.load(DiffusionPlanner::init(&CONFIG, &mut Initializer::new(0, device))).unwrap()
}

fn input(file: &File) -> PlannerInput {
    let limits = file.floats("norm.lanes_speed_limit").into_iter();
    let known = file.data("norm.lanes_has_speed_limit", Dtype::BOOL);
    PlannerInput {
        agents: file.floats("norm.neighbor_agents_past"),
        statics: file.floats("norm.static_objects"),
        lanes: file.floats("norm.lanes"),
        limits: limits.zip(known).map(|(limit, known)| (known == 1).then_some(limit)).collect(),
        route: file.floats("norm.route_lanes"),
        current: file.floats("dec.current_states"),
    }
}

fn values<const D: usize>(tensor: &Tensor<D>) -> Vec<f32> {
    tensor.clone().into_data().iter::<f32>().collect()
}

/// Compares numbers; both lists are as long.
fn compare(name: &str, ours: &[f32], theirs: &[f32], tolerance: f32) {
    assert_eq!(ours.len(), theirs.len(), "{name}");
    let apart = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(apart <= tolerance, "{name}: {apart}");
}

/// Returns the trajectories of agents that are there.
fn of_present(values: &[f32], present: &[bool]) -> Vec<f32> {
    let each = values.len() / COUNT;
    let there = |i: &usize| *i == 0 || present[*i - 1];
    (0..COUNT).filter(there).flat_map(|i| values[i * each..(i + 1) * each].to_vec()).collect()
}

fn check(device: &Device) {
    let Some(folder) = folder() else { return };
    let network = load(&folder, device);
    for number in 0..3 {
        let file = File(fs::read(folder.join(format!("scene_{number}.safetensors"))).unwrap());
        let input = input(&file);
        let present = input.predicted(&CONFIG);
        let absent: Vec<bool> = present.iter().map(|p| !p).collect();
        let mask: Vec<bool> =
            file.data("dec.neighbor_current_mask", Dtype::BOOL).iter().map(|b| *b == 1).collect();
        assert_eq!(absent, mask);
        let scene = network.encode(&input, &CONFIG, device);
        compare("encoding", &values(&scene.scene), &file.floats("enc.encoding"), 1e-4);
        compare("route", &values(&scene.route), &file.floats("dit.route_encoding"), 1e-4);
        for level in 0..3 {
            let name = |part: &str| format!("dit.t{level}.{part}");
            let x = file.floats(&name("x_t"));
            let x = Tensor::<3>::from_data(TensorData::new(x, [1, COUNT, CONFIG.trajectory()]), device);
            let time = f64::from(file.floats(&name("time"))[0]);
            let clean = network.denoise(&scene, x, time);
            compare(&name("out"), &values(&clean), &file.floats(&name("out")), 1e-4);
        }
        let noise: Vec<f32> = file.floats("dpm.noise").iter().map(|n| 0.5 * n).collect();
        // Two samples at once are the same twice.
        let noise = TensorData::new([noise.clone(), noise].concat(), [2, COUNT, 4 * CONFIG.states]);
        let sampled = values(&network.sample(&scene, Tensor::from_data(noise, device)));
        let expected = of_present(&file.floats("dpm.prediction"), &present);
        for sample in sampled.chunks(sampled.len() / 2) {
            // The original goes from clean values to noise and back, which loses digits; metres.
            compare("prediction", &of_present(sample, &present), &expected, 1e-3);
        }
    }
}

#[test]
fn it_agrees_with_the_public_code_on_the_host() {
    check(&device());
}

#[test]
fn it_agrees_with_the_public_code_with_gradients() {
    check(&device().autodiff());
}

#[test]
fn published_sizes_are_those_of_the_public_code() {
    let network = DiffusionPlanner::init(&PlannerConfig::published(), &mut Initializer::new(0, &device()));
    assert_eq!(network.num_params(), 6_042_628);
}
