//! The network against values of the public code, with random weights at a small size.
#![allow(clippy::print_stderr, reason = "a test that is skipped says so")]

use std::fs;
use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use reactsim::geometry::math;
use safetensors::SafeTensors;
use safetensors::tensor::Dtype;

use super::{Line, SceneInput, Vbd, VbdConfig};
use crate::models::nn::{Initializer, Tensors, device};

/// The configuration of the golden data.
const CONFIG: VbdConfig = VbdConfig {
    width: 64,
    hidden: 32,
    heads: 4,
    frequencies: 16,
    encoder_layers: 2,
    ..VbdConfig::published()
};
/// Number of agents that are denoised, of anchors, and of points of a line.
const DENOISED: usize = 5;
const ANCHORS: usize = 16;
const POINTS: usize = 30;
/// Largest absolute difference.
const TOLERANCE: f32 = 1e-4;

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

    fn integers(&self, name: &str) -> Vec<usize> {
        let integer = |b: &[u8; 4]| i32::from_le_bytes(*b) as usize;
        self.data(name, Dtype::I32).as_chunks::<4>().0.iter().map(integer).collect()
    }
}

/// Returns the folder of the golden data; `None` if it is missing.
fn folder() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/vbd_golden");
    if !folder.is_dir() {
        eprintln!("skipped: {} is missing", folder.display());
        return None;
    }
    Some(folder)
}

fn load(folder: &Path, device: &Device) -> Vbd {
    let bytes = fs::read(folder.join("weights.safetensors")).unwrap();
    let foreign = |name: &str| name.starts_with("noise_scheduler.") || name.starts_with("action_");
    let tensors = Tensors::read(&bytes).unwrap().without(foreign);
    tensors.load(Vbd::init(&CONFIG, &mut Initializer::new(0, device))).unwrap()
}

fn scene(file: &File) -> SceneInput {
    let history = file.floats("in_agents_history");
    let agents = history.chunks(11 * 8).map(|agent| std::array::from_fn(|k| f64::from(agent[10 * 8 + k])));
    let lines = file.floats("in_polylines");
    let lines = lines.chunks(POINTS * 5).map(|line| Line {
        points: line.chunks(5).map(|p| [p[0], p[1], p[2]].map(f64::from)).collect(),
        light: line[3] as usize,
        kind: line[4] as usize,
    });
    let lights = file.floats("in_traffic_light_points");
    let lights = lights.chunks(3).map(|l| ([f64::from(l[0]), f64::from(l[1])], l[2] as usize));
    SceneInput {
        agents: agents.collect(),
        kinds: file.integers("in_agents_type"),
        lines: lines.collect(),
        lights: lights.collect(),
    }
}

fn values<const D: usize>(tensor: &Tensor<D>) -> Vec<f32> {
    tensor.clone().into_data().iter::<f32>().collect()
}

/// Compares numbers; both lists are as long.
fn compare(name: &str, ours: &[f32], theirs: &[f32]) {
    assert_eq!(ours.len(), theirs.len(), "{name}");
    let apart = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(apart <= TOLERANCE, "{name}: {apart}");
}

fn check(device: &Device) {
    let Some(folder) = folder() else { return };
    let network = load(&folder, device);
    for number in 0..2 {
        let file = File(fs::read(folder.join(format!("scene_{number}.safetensors"))).unwrap());
        let input = scene(&file);
        compare("relations", &input.relations(true), &file.floats("in_relations"));
        let encoded = network.encode(&input, &CONFIG, device);
        compare("relation encodings", &values(&encoded.relations), &file.floats("enc_relation_encodings"));
        compare("encodings", &values(&encoded.elements), &file.floats("enc_encodings"));

        let masked = VbdConfig { masked: true, ..CONFIG };
        let other = network.encode(&input, &masked, device);
        compare("masked encodings", &values(&other.elements), &file.floats("variant_keymask_encodings"));

        let matrix = |values: Vec<f32>, shape: [usize; 3]| {
            Tensor::<3>::from_data(TensorData::new(values, shape), device)
        };
        let anchors = file.floats("in_anchors")[..DENOISED * ANCHORS * 2].to_vec();
        let anchors = matrix(anchors, [DENOISED, ANCHORS, 2]);
        let behaviours = network.behaviours(&encoded, anchors, &CONFIG);
        compare("actions", &values(&behaviours.actions), &file.floats("pred_actions_normalized"));
        compare("scores", &values(&behaviours.scores), &file.floats("pred_scores"));

        let speeds: Vec<f32> =
            input.agents[..DENOISED].iter().map(|a| math::hypot(a[3], a[4]) as f32).collect();
        let speeds = Tensor::<2>::from_data(TensorData::new(speeds, [DENOISED, 1]), device);
        for level in [2, 25, 49] {
            let noisy = matrix(file.floats(&format!("den{level}_input_normalized")), [DENOISED, 40, 2]);
            let clean = network.denoise(&encoded, noisy, &speeds, level, &CONFIG, None);
            compare("clean actions", &values(&clean), &file.floats(&format!("den{level}_x0_normalized")));
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
    let network = Vbd::init(&VbdConfig::published(), &mut Initializer::new(0, &device()));
    assert_eq!(network.num_params(), 11_808_275);
}
