//! Training of the published network: samples, the closed loop of CATK, and what has gradients.

use burn::tensor::Device;
use reactsim::models::nn::device;
use reactsim::models::ntp::smart::learn::catk::{CatkRecipe, ClosestAmongTopK};
use reactsim::models::ntp::smart::learn::{Excerpt, NextSmartToken, Recipe};
use reactsim::models::ntp::smart::{Scene, SmartPolicy};
use reactsim::scene::{CURRENT, Frame, Scenario};
use reactsim::training::{Task, parameter_paths};

use crate::small_scenarios::scenario;
use crate::smart_simulator::{policy, untrained};

/// Number of steps of the history and of a whole scenario.
const HISTORY: usize = 2;
const STEPS: usize = 18;

fn catk(recipe: CatkRecipe) -> ClosestAmongTopK {
    let autodiff: Device = device().autodiff();
    let parent = SmartPolicy::read(&untrained(), &autodiff).unwrap();
    ClosestAmongTopK::new(recipe, parent, String::new(), &device())
}

/// Returns the default recipe in which the AV follows its record, or the network.
fn with_av(external_av: bool) -> CatkRecipe {
    let default = CatkRecipe::default();
    CatkRecipe { excerpt: Excerpt { external_av, ..default.excerpt }, ..default }
}

/// Returns the scene that a network drives in.
fn driven(recipe: &CatkRecipe, scenario: &Scenario) -> Scene {
    let task = catk(recipe.clone());
    let sample = task.prepare(scenario, None).unwrap();
    task.roll_out(&policy(&device()).network, &sample).unwrap()
}

/// Returns a scenario whose agents other than the AV stop where they are.
fn stopped(mut scenario: Scenario) -> Scenario {
    for slot in 1..scenario.start.agents.len() {
        let now: Frame = scenario.start.history[slot][CURRENT];
        scenario.log_future.tracks[slot].fill(now.map(|s| reactsim::scene::AgentState {
            vx: 0.0,
            vy: 0.0,
            ..s
        }));
    }
    scenario
}

fn logged(scenario: &Scenario) -> Scene {
    let SmartPolicy { vocabulary, map_vocabulary, network, .. } = policy(&device());
    let config = network.config().clone();
    let mut recipe = Recipe { agents: 32, ..Recipe::default() };
    recipe.network.separate_heads = true;
    recipe.network.num_map_layers = config.num_map_layers;
    let task = NextSmartToken::new(recipe, vocabulary, map_vocabulary, &device()).unwrap();
    task.prepare(scenario, None).unwrap().scene
}

#[test]
fn with_all_tokens_the_closed_loop_is_the_rolling_match_of_the_log() {
    let scenario = scenario(0);
    let all = driven(&CatkRecipe { top_k: 10_000, ..CatkRecipe::default() }, &scenario);
    let log = logged(&scenario);
    assert_eq!((all.steps.len(), log.steps.len()), (STEPS, STEPS));
    assert_eq!(all.agents, log.agents);
    let mut compared = 0;
    for (driven, logged) in all.steps.iter().zip(&log.steps) {
        for agent in 0..all.agents.len() {
            if logged.valid[agent] && driven.valid[agent] {
                assert_eq!(driven.token[agent], logged.token[agent]);
                compared += 1;
            }
        }
    }
    assert!(compared > STEPS, "only {compared} steps compared");
}

#[test]
fn with_one_token_the_record_has_no_influence_on_the_closed_loop() {
    let recipe = CatkRecipe { top_k: 1, ..CatkRecipe::default() };
    assert_eq!(driven(&recipe, &scenario(1)).steps, driven(&recipe, &stopped(scenario(1))).steps);
    let near = CatkRecipe { top_k: 10_000, ..CatkRecipe::default() };
    assert_ne!(driven(&near, &scenario(1)).steps, driven(&near, &stopped(scenario(1))).steps);
}

#[test]
fn an_external_av_follows_its_record_whatever_the_network_says() {
    let recipe = CatkRecipe { top_k: 1, ..with_av(true) };
    let scenario = scenario(2);
    let scene = driven(&recipe, &scenario);
    for (number, step) in scene.steps.iter().enumerate().skip(HISTORY) {
        let record = scenario.logged_at(0, 5 * (number + 1)).unwrap();
        let [x, y] = step.position[0];
        assert!((f64::from(x) - record.x).abs() < 1e-4 && (f64::from(y) - record.y).abs() < 1e-4);
    }
    let own = CatkRecipe { top_k: 1, ..with_av(false) };
    assert_ne!(driven(&own, &scenario).steps[STEPS - 1].position[0], scene.steps[STEPS - 1].position[0]);
    // It has no labels: one less per step.
    let labels = |recipe: CatkRecipe| {
        let task = catk(recipe);
        let sample = task.prepare(&scenario, None).unwrap();
        task.loss(&policy(&device()).network, &[sample], None).items
    };
    let of_av = labels(own) - labels(recipe);
    assert!((of_av - (STEPS - HISTORY) as f64).abs() < 1e-3, "{of_av}");
}

#[test]
fn a_scenario_in_which_only_an_external_av_has_a_record_is_passed_over() {
    let mut scenario = scenario(2);
    for slot in 1..scenario.start.agents.len() {
        scenario.log_future.tracks[slot].fill(None);
    }
    let sample = |external_av| catk(with_av(external_av)).prepare(&scenario, None);
    assert!(sample(false).is_some() && sample(true).is_none());
}

#[test]
fn fine_tuning_moves_the_attention_of_agents_and_the_heads_alone() {
    let excerpt = Excerpt { steps: 4, ..CatkRecipe::default().excerpt };
    let task = catk(CatkRecipe { excerpt, ..CatkRecipe::default() });
    let network = task.init(0);
    let sample = task.prepare(&scenario(3), None).unwrap();
    let mut stream = rand_chacha::rand_core::SeedableRng::seed_from_u64(1);
    let output = task.loss(&network, std::slice::from_ref(&sample), Some(&mut stream));
    assert!(output.items > 0.0);
    let trained = parameter_paths(&network);
    assert!(trained.iter().all(|path| path.contains("attn_layers") || path.contains("token_predict_head")));
    for part in ["t_attn_layers", "pt2a_attn_layers", "a2a_attn_layers", "token_predict_head"] {
        assert!(trained.iter().any(|path| path.starts_with(&format!("agent_encoder.{part}"))), "{part}");
    }
    // The loss without gradients, on the host, is the same.
    let plain = task.loss(&policy(&device()).network, &[sample], None);
    let value = |output: &reactsim::training::Output| output.loss.clone().into_scalar::<f32>();
    let (a, b) = (value(&output), value(&plain));
    assert!((a - b).abs() < 1e-3 * a.abs(), "{a} {b}");
}
