//! CTG: its training, its plans, and refusals.

use std::collections::BTreeMap;

use reactsim::models::ctg::learn::{CtgLearning, Recipe};
use reactsim::models::ctg::network::{CtgConfig, Decoding};
use reactsim::models::ctg::{CtgParameters, CtgPolicy, CtgSimulator, Rules, Sight};
use reactsim::models::nn::device;
use reactsim::rollout::{Controller, Replan, Settings, roll_out};
use reactsim::training::Task;

use crate::model_weights::{check_damaged, check_learning, replaced};
use crate::ntp_reactive::scenarios;
use crate::scenes::{bits, coasting, request};

/// Returns small sizes that differ wherever they can.
fn small(decoding: Decoding) -> Recipe {
    let network = CtgConfig {
        decoding,
        image_width: 4,
        features: 16,
        width: 4,
        noise_levels: 6,
        ..CtgConfig::default()
    };
    let sight = Sight { pixels: 32, pixel: 2.0, frames: 3, radius: 60.0 };
    Recipe { network, sight, agents: 5, ..Recipe::default() }
}

fn task(decoding: Decoding) -> CtgLearning {
    CtgLearning::new(small(decoding), &device()).unwrap()
}

fn policy(decoding: Decoding) -> CtgPolicy {
    let task = task(decoding);
    task.policy(&burn::module::Module::valid(&task.init(1)))
}

pub(crate) fn untrained(decoding: Decoding) -> Vec<u8> {
    policy(decoding).write(&BTreeMap::new()).unwrap()
}

const FREE: Rules = Rules { collision: 0.0, road: 0.0, speed: 0.0 };
const PARAMETERS: CtgParameters = CtgParameters { agents: 6, steps: 3, candidates: 1, rules: FREE };

#[test]
fn every_part_that_is_used_learns() {
    for decoding in [Decoding::Cloning, Decoding::Diffusion] {
        let still = check_learning(&task(decoding));
        assert!(still.is_empty(), "{decoding:?}: {still:?}");
    }
}

#[test]
fn rollouts_are_the_same_every_time_and_differ_with_the_settings() {
    let scenarios = scenarios(2);
    let run_by = |settings: &Settings, decoding, parameters| {
        let simulator = CtgSimulator::new("ctg-diffusion", policy(decoding), parameters, device());
        let requests = scenarios.iter().map(|s| request(s, coasting(s), 0)).collect();
        roll_out(requests, &Controller::Fair(Box::new(simulator)), settings)
            .into_iter()
            .map(|r| bits(&r.unwrap().tracks))
            .collect::<Vec<_>>()
    };
    let run = |decoding, parameters| run_by(&Settings::default(), decoding, parameters);
    let as_is = run(Decoding::Diffusion, PARAMETERS);
    assert!(as_is == run(Decoding::Diffusion, PARAMETERS));
    let all = Rules { collision: 1.0, road: 1.0, speed: 1.0 };
    for other in [
        CtgParameters { steps: 6, ..PARAMETERS },
        CtgParameters { agents: 2, ..PARAMETERS },
        CtgParameters { rules: all, ..PARAMETERS },
        CtgParameters { candidates: 3, rules: all, ..PARAMETERS },
    ] {
        assert!(as_is != run(Decoding::Diffusion, other), "{other:?}");
    }
    // Several samples without rules are all as good: the first is executed. A later plan would have other
    // noise.
    let once = Settings { replan: Replan::every(80).unwrap(), ..Settings::default() };
    let first = run_by(&once, Decoding::Diffusion, PARAMETERS);
    assert!(first == run_by(&once, Decoding::Diffusion, CtgParameters { candidates: 3, ..PARAMETERS }));
    let cloned = run(Decoding::Cloning, CtgParameters::cloning(6));
    assert!(cloned != as_is && cloned == run(Decoding::Cloning, CtgParameters::cloning(6)));
}

#[test]
fn a_file_gives_the_same_policy_and_foreign_and_damaged_ones_are_refused() {
    let good = untrained(Decoding::Diffusion);
    let read = CtgPolicy::read(&good, &device()).unwrap();
    assert_eq!(
        (read.config, read.sight),
        (small(Decoding::Diffusion).network, small(Decoding::Diffusion).sight)
    );
    assert_eq!(read.write(&BTreeMap::new()).unwrap(), good);
    let refusal = |bytes: &[u8]| CtgPolicy::read(bytes, &device()).unwrap_err().to_string();
    check_damaged(&good, refusal);
    let other = refusal(&replaced(&good, "\\\"features\\\":16", "\\\"features\\\":32"));
    assert!(other.contains("expected ["), "{other}");
    let odd = refusal(&replaced(&good, "\\\"pixels\\\":32", "\\\"pixels\\\":33"));
    assert!(odd.contains("pixels = 33"), "{odd}");

    // Sizes that would take 50 GB are refused by the shapes of the tensors.
    let config = CtgConfig { image_width: 512, features: 4096, ..read.config };
    let large =
        CtgPolicy { config, sight: Sight { pixels: 512, ..read.sight }, network: read.network.clone() };
    let large = refusal(&large.write(&BTreeMap::new()).unwrap());
    assert!(large.contains("expected ["), "{large}");

    let foreign = read.expect(Decoding::Cloning).unwrap_err().to_string();
    assert!(foreign.contains("`ctg-diffusion` or `ctg-guided`"), "{foreign}");
    let own = small(Decoding::Diffusion).network;
    for (config, field) in [
        (CtgConfig { actions: 22, ..own }, "actions"),
        (CtgConfig { hold: 5, ..own }, "hold"),
        (CtgConfig { image_width: 0, ..own }, "image_width"),
        (CtgConfig { noise_levels: 1, ..own }, "noise_levels"),
    ] {
        assert_eq!(config.check().unwrap_err().field, field);
    }
}
