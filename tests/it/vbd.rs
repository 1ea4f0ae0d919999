//! VBD: its training, its plans, and refusals.

use std::collections::BTreeMap;

use reactsim::models::learning::Intentions;
use reactsim::models::nn::device;
use reactsim::models::vbd::learn::{Denoising, Recipe};
use reactsim::models::vbd::network::VbdConfig;
use reactsim::models::vbd::{Sight, VbdParameters, VbdPolicy, VbdSimulator};
use reactsim::rollout::{Controller, Settings, roll_out};
use reactsim::training::Task;

use crate::model_weights::{check_learning, check_refusals};
use crate::ntp_reactive::scenarios;
use crate::scenes::{bits, coasting, request};

/// Returns small sizes that differ wherever they can.
fn small() -> Recipe {
    Recipe {
        network: VbdConfig {
            width: 16,
            hidden: 8,
            heads: 2,
            frequencies: 4,
            encoder_layers: 1,
            pairs: 2,
            noise_levels: 10,
            near_elements: 7,
            near_agents: 4,
            ..VbdConfig::default()
        },
        sight: Sight { agents: 6, lines: 12, lights: 2, ..Sight::default() },
        predicted: 1.0,
        ..Recipe::default()
    }
}

fn task() -> Denoising {
    Denoising::new(small(), Intentions::fan(), &device()).unwrap()
}

fn policy() -> VbdPolicy {
    let task = task();
    task.policy(&burn::module::Module::valid(&task.init(1)))
}

pub(crate) fn untrained() -> Vec<u8> {
    policy().write(&BTreeMap::new()).unwrap()
}

fn controller(parameters: VbdParameters) -> Controller {
    Controller::Fair(Box::new(VbdSimulator::new("vbd", policy(), parameters, device())))
}

const PARAMETERS: VbdParameters = VbdParameters {
    agents: 6,
    steps: 3,
    draws: false,
    temperature: 1.0,
    keeps_noise: true,
    inpainting: false,
};

#[test]
fn every_part_that_is_used_learns() {
    // A constant added to the scores of all anchors, or to those of all keys, changes nothing.
    let wanted = |name: &String| !name.ends_with("score_decoder.second.bias");
    let still: Vec<String> = check_learning(&task()).into_iter().filter(wanted).collect();
    assert!(still.is_empty(), "{still:?}");
}

#[test]
fn rollouts_are_the_same_every_time_and_differ_with_the_settings() {
    let scenarios = scenarios(2);
    let run = |parameters| {
        let controller = controller(parameters);
        let requests = scenarios.iter().map(|s| request(s, coasting(s), 0)).collect();
        roll_out(requests, &controller, &Settings::default())
            .into_iter()
            .map(|r| bits(&r.unwrap().tracks))
            .collect::<Vec<_>>()
    };
    let as_is = run(PARAMETERS);
    assert!(as_is == run(PARAMETERS));
    assert!(as_is != run(VbdParameters { draws: true, ..PARAMETERS }));
    assert!(as_is != run(VbdParameters { inpainting: true, ..PARAMETERS }));
    assert!(as_is != run(VbdParameters { steps: 10, ..PARAMETERS }));
    assert!(as_is != run(VbdParameters { temperature: 0.5, ..PARAMETERS }));
    assert!(as_is != run(VbdParameters { keeps_noise: false, ..PARAMETERS }));
    assert!(as_is != run(VbdParameters { agents: 2, ..PARAMETERS }));
}

#[test]
fn a_file_gives_the_same_policy_and_foreign_and_damaged_ones_are_refused() {
    let good = untrained();
    let read = VbdPolicy::read(&good, &device()).unwrap();
    assert_eq!((read.config, read.sight), (small().network, small().sight));
    assert_eq!(read.write(&BTreeMap::new()).unwrap(), good);
    let refusal = |bytes: &[u8]| VbdPolicy::read(bytes, &device()).unwrap_err().to_string();
    check_refusals(&good, refusal);
    for (config, field) in [
        (VbdConfig { hold: 9, ..small().network }, "actions"),
        (VbdConfig { width: 15, ..small().network }, "width"),
        (VbdConfig { noise_levels: 1, ..small().network }, "noise_levels"),
        (VbdConfig { near_agents: 0, ..small().network }, "near_agents"),
        (VbdConfig { av_given: f64::NAN, ..small().network }, "av_given"),
    ] {
        assert_eq!(config.check().unwrap_err().field, field);
    }
    assert_eq!(VbdConfig::published().check(), Ok(()));
}
