//! The network against values of the public code, with random weights at a small size.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use reactsim_golden::{Golden, GoldenFile, assert_close, values};
use reactsim_nn::{Initializer, device};

use super::{DiffusionPlanner, PlannerConfig, PlannerInput};

/// The configuration of the golden data.
const CONFIG: PlannerConfig = PlannerConfig { width: 64, heads: 4, ..PlannerConfig::published() };
/// Number of trajectories.
const COUNT: usize = 11;

fn load(golden: &Golden, device: &Device) -> DiffusionPlanner {
    golden
        .file("weights")
        .tensors()
        .load(DiffusionPlanner::init(&CONFIG, &mut Initializer::new(0, device)))
        .unwrap()
}

fn input(file: &GoldenFile) -> PlannerInput {
    let limits = file.floats("norm.lanes_speed_limit").into_iter();
    let known = file.flags("norm.lanes_has_speed_limit");
    PlannerInput {
        agents: file.floats("norm.neighbor_agents_past"),
        statics: file.floats("norm.static_objects"),
        lanes: file.floats("norm.lanes"),
        limits: limits.zip(known).map(|(limit, known)| known.then_some(limit)).collect(),
        route: file.floats("norm.route_lanes"),
        current: file.floats("dec.current_states"),
    }
}

/// Returns the trajectories of agents that are there.
fn of_present(values: &[f32], present: &[bool]) -> Vec<f32> {
    let each = values.len() / COUNT;
    let there = |i: &usize| *i == 0 || present[*i - 1];
    (0..COUNT).filter(there).flat_map(|i| values[i * each..(i + 1) * each].to_vec()).collect()
}

fn check(device: &Device) {
    let Some(golden) = Golden::open("diffusion_planner_golden") else { return };
    let network = load(&golden, device);
    for number in 0..3 {
        let file = golden.file(&format!("scene_{number}"));
        let input = input(&file);
        let present = input.predicted(&CONFIG);
        let absent: Vec<bool> = present.iter().map(|p| !p).collect();
        assert_eq!(absent, file.flags("dec.neighbor_current_mask"));
        let scene = network.encode(&input, &CONFIG, device);
        assert_close(&values(&scene.scene), &file.floats("enc.encoding"), 1e-4, "encoding");
        assert_close(&values(&scene.route), &file.floats("dit.route_encoding"), 1e-4, "route");
        for level in 0..3 {
            let name = |part: &str| format!("dit.t{level}.{part}");
            let x = file.floats(&name("x_t"));
            let x = Tensor::<3>::from_data(TensorData::new(x, [1, COUNT, CONFIG.trajectory()]), device);
            let time = f64::from(file.floats(&name("time"))[0]);
            let clean = network.denoise(&scene, x, time);
            assert_close(&values(&clean), &file.floats(&name("out")), 1e-4, &name("out"));
        }
        let noise: Vec<f32> = file.floats("dpm.noise").iter().map(|n| 0.5 * n).collect();
        // Two samples at once are the same twice.
        let noise = TensorData::new([noise.clone(), noise].concat(), [2, COUNT, 4 * CONFIG.states]);
        let sampled = values(&network.sample(&scene, Tensor::from_data(noise, device)));
        let metres = |[x, y, cos, sin]: &[f32; 4]| [20.0 * x + 10.0, 20.0 * y, *cos, *sin];
        let sampled: Vec<f32> = sampled.as_chunks::<4>().0.iter().flat_map(metres).collect();
        let expected = of_present(&file.floats("dpm.prediction"), &present);
        for sample in sampled.chunks(sampled.len() / 2) {
            // The original goes from clean values to noise and back, which loses digits; metres.
            assert_close(&of_present(sample, &present), &expected, 1e-3, "prediction");
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
