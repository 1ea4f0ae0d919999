//! The network against values of the public code, with random weights at a small size.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use reactsim_geometry::math;
use reactsim_golden::{Golden, GoldenFile, assert_close, values};
use reactsim_nn::{Initializer, device};

use super::{Line, SceneInput, Vbd, VbdConfig};

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
const TOLERANCE: f64 = 1e-4;

fn load(golden: &Golden, device: &Device) -> Vbd {
    let foreign = |name: &str| name.starts_with("noise_scheduler.") || name.starts_with("action_");
    let weights = golden.file("weights");
    let tensors = weights.tensors().without(foreign);
    tensors.load(Vbd::init(&CONFIG, &mut Initializer::new(0, device))).unwrap()
}

fn scene(file: &GoldenFile) -> SceneInput {
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
        av_motion: [0.0; 2],
    }
}

fn compare(name: &str, ours: &[f32], theirs: &[f32]) {
    assert_close(ours, theirs, TOLERANCE, name);
}

fn check(device: &Device) {
    let Some(golden) = Golden::open("vbd_golden") else { return };
    let network = load(&golden, device);
    for number in 0..2 {
        let file = golden.file(&format!("scene_{number}"));
        let input = scene(&file);
        let all = input.nearest(input.len(), input.len(), input.len(), true);
        compare("relations", &input.relations(&all, true, false), &file.floats("in_relations"));
        let encoded = network.encode(&input, &CONFIG, device);
        compare(
            "relation encodings",
            &values(&encoded.surroundings.relations),
            &file.floats("enc_relation_encodings"),
        );
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
        let prepared = network.prepare(&input, &encoded, DENOISED, false, &CONFIG);
        for level in [2, 25, 49] {
            let noisy = matrix(file.floats(&format!("den{level}_input_normalized")), [DENOISED, 40, 2]);
            let clean = network.denoise(&prepared, noisy, &speeds, level, &CONFIG);
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
