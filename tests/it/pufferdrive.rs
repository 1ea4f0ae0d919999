//! The policy that others trained: its network against recorded values, its driving against what it may do.

use std::fs;

use burn::tensor::{Device, Tensor, TensorData};
use reactsim::models::nn::{Initializer, Tensors};
use reactsim::models::pufferdrive::network::{HIDDEN, Network, ROAD, Recurrent};
use serde_json::Value;

use crate::networks::devices;
use crate::shared;

fn numbers(value: &Value) -> Vec<f32> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap() as f32).collect()
}

/// The published inputs and outputs of three equal steps.
fn golden_on(device: &Device) {
    let Some((weights, golden)) =
        published("pufferdrive_v2.safetensors").zip(published("pufferdrive_v2.golden.json"))
    else {
        return;
    };
    let bytes = fs::read(weights).unwrap();
    let network = Network::init(&mut Initializer::new(0, device), device);
    let network = Tensors::read(&bytes).unwrap().load(network).unwrap();
    let golden: Value = serde_json::from_str(&fs::read_to_string(golden).unwrap()).unwrap();
    let mut road = Vec::new();
    for row in golden["road"].as_array().unwrap() {
        let row = numbers(row);
        let mut wide = [0.0; ROAD];
        wide[..6].copy_from_slice(&row[..6]);
        wide[6 + row[6] as usize] = 1.0;
        road.extend(wide);
    }
    let mut partners = numbers(&golden["partners_nonzero_row0"]);
    partners.resize(63 * 7, 0.0);
    let ego = Tensor::<2>::from_data(TensorData::new(numbers(&golden["ego"]), [1, 7]), device);
    let road = Tensor::<3>::from_data(TensorData::new(road, [1, 200, ROAD]), device);
    let partners = Tensor::<3>::from_data(TensorData::new(partners, [1, 63, 7]), device);
    let mut kept =
        Recurrent { hidden: Tensor::zeros([1, HIDDEN], device), cell: Tensor::zeros([1, HIDDEN], device) };
    for step in golden["steps"].as_array().unwrap() {
        let output = network.forward(ego.clone(), road.clone(), partners.clone(), kept);
        let logits: Vec<f32> = output.logits.into_data().iter::<f32>().collect();
        let wanted = numbers(&step["logits"]);
        assert_eq!(logits.len(), wanted.len());
        for (a, b) in logits.iter().zip(&wanted) {
            assert!((a - b).abs() < 1e-3, "{a} is not {b}");
        }
        let value: f32 = output.value.into_data().iter::<f32>().next().unwrap();
        assert!((f64::from(value) - step["value"].as_f64().unwrap()).abs() < 1e-3);
        kept = output.next;
    }
}

#[test]
fn the_network_says_what_it_should() {
    devices().iter().for_each(golden_on);
}
