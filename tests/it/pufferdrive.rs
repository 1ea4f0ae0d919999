//! The policy trained by others: its network against recorded values, its driving against the limits.

use std::fs;

use burn::tensor::{Device, Tensor, TensorData};
use reactsim::models::find;
use reactsim::models::nn::{Initializer, Tensors};
use reactsim::models::pufferdrive::network::{HIDDEN, Network, ROAD, Recurrent};
use reactsim::rollout::{Controller, Rollout, Settings};
use reactsim::scene::{AgentKind, CURRENT, Frame, Scenario};
use serde_json::Value;

use crate::model_weights::untrained;
use crate::networks::{devices, values, worst};
use crate::protocol::scenarios;
use crate::qp::check_limits;
use crate::scenes::{coasting, roll};
use crate::shared;

fn numbers(value: &Value) -> Vec<f32> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap() as f32).collect()
}

/// Checks the published inputs and outputs of three equal steps.
fn golden_on(device: &Device) {
    let Some(weights) = shared("data/weights/pufferdrive_v2.safetensors") else { return };
    let Some(golden) = shared("data/weights/pufferdrive_v2.golden.json") else { return };
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
        let far = worst(&values(output.logits), &numbers(&step["logits"]));
        assert!(far < 1e-3, "{far}");
        let value = values(output.value)[0];
        assert!((f64::from(value) - step["value"].as_f64().unwrap()).abs() < 1e-3);
        kept = output.next;
    }
}

#[test]
fn the_network_says_what_it_should() {
    devices().iter().for_each(golden_on);
}

/// Returns the simulator with untrained weights, and changes to its card.
fn simulator(changes: &[(&str, &str)]) -> Controller {
    let model = find("pufferdrive").unwrap();
    let mut setup = model.setup().unwrap();
    setup.weights = untrained(model.id);
    for (key, value) in changes {
        setup.parameters.set(key, value).unwrap();
    }
    (model.make)(setup).unwrap()
}

fn rollout(scenario: &Scenario, controller: &Controller) -> Rollout {
    roll(scenario, coasting(scenario), controller, &Settings::default())
}

fn tracks(scenario: &Scenario, controller: &Controller) -> Vec<Vec<Frame>> {
    rollout(scenario, controller).tracks
}

#[test]
fn with_the_projection_no_choice_of_actions_breaks_the_limits() {
    let wild = simulator(&[("greedy", "false"), ("speed_limit", "40")]);
    for scenario in &scenarios(1) {
        check_limits(scenario, &rollout(scenario, &wild));
    }
}

#[test]
fn parameters_of_the_card_do_what_they_say() {
    let (with, without) = (simulator(&[]), simulator(&[("projection", "false")]));
    let everything_parked =
        simulator(&[("parked.travel", "1e3"), ("parked.speed", "100"), ("parked.offset", "-1")]);
    let mut differ = 0;
    for scenario in &scenarios(1) {
        differ += usize::from(tracks(scenario, &with) != tracks(scenario, &without));
        for (agent, track) in scenario.start.agents.iter().zip(tracks(scenario, &everything_parked)).skip(1) {
            if agent.kind == AgentKind::Vehicle {
                let place = |f: usize| track[f].map(|s: reactsim::scene::AgentState| (s.x, s.y, s.heading));
                assert_eq!(place(CURRENT), place(CURRENT + 80), "{}", agent.id);
            }
        }
    }
    assert!(differ > 0);
}
