//! Fine-tuning by rewards: what is drawn by chance and turns out well becomes likelier.

use std::sync::atomic::AtomicBool;

use rand_chacha::rand_core::SeedableRng;
use reactsim::models::nn::device;
use reactsim::models::ntp::Sampling;
use reactsim::models::ntp::smart::learn::Excerpt;
use reactsim::models::ntp::smart::learn::grpo::{GroupRelative, GrpoRecipe, Rewards};
use reactsim::models::ntp::smart::{Smart, SmartPolicy};
use reactsim::scene::Scenario;
use reactsim::training::{Execution, Learner, Settings, Source, Stream, Task};

use crate::small_scenarios::scenario;
use crate::smart_simulator::untrained;

fn task(recipe: GrpoRecipe) -> GroupRelative {
    let parent = SmartPolicy::read(&untrained(), &device().autodiff()).unwrap();
    GroupRelative::new(recipe, parent, String::new(), &device())
}

/// A recipe without labels.
fn rewards_alone(top_k: usize, distance: f64) -> GrpoRecipe {
    GrpoRecipe {
        excerpt: Excerpt { agents: 4, steps: 3, mirror: 0.0, stretch: 0.0, ..GrpoRecipe::default().excerpt },
        rollouts: 4,
        anchor: 0.0,
        sampling: Sampling { top_k, temperature: 1.0 },
        rewards: Rewards { distance, most_distance: 100.0, ..GrpoRecipe::default().rewards },
    }
}

/// Returns the loss of an untrained network by draws of this seed.
fn loss(recipe: GrpoRecipe, seed: u64) -> f32 {
    let task = task(recipe);
    let sample = task.prepare(&scenario(3), None).unwrap();
    let output = task.loss(&task.init(0), &[sample], Some(&mut Stream::seed_from_u64(seed)));
    assert!(output.items > 0.0);
    output.loss.into_scalar::<f32>()
}

#[test]
fn rollouts_that_are_alike_teach_nothing() {
    let nothing = |loss: f32| loss.abs() < 1e-6;
    assert!(nothing(loss(rewards_alone(1, 1.0), 0)));
    let mut unjudged = rewards_alone(0, 0.0);
    (unjudged.rewards.av_contact, unjudged.rewards.contact) = (0.0, 0.0);
    assert!(nothing(loss(unjudged, 0)));
    assert!(!nothing(loss(rewards_alone(0, 1.0), 0)));
    assert_eq!(loss(rewards_alone(0, 1.0), 1), loss(rewards_alone(0, 1.0), 1));
    assert_ne!(loss(rewards_alone(0, 1.0), 1), loss(rewards_alone(0, 1.0), 2));
}

/// The same scenario under several names.
pub(crate) struct Same(Scenario, Vec<String>);

impl Same {
    pub(crate) fn of(scenario: Scenario, names: usize) -> Self {
        Self(scenario, (0..names).map(|i| i.to_string()).collect())
    }
}

impl Source for Same {
    type Example = Scenario;

    fn len(&self) -> usize {
        self.1.len()
    }

    fn id(&self, number: usize) -> &str {
        &self.1[number]
    }

    fn read(&self, _number: usize) -> Result<Scenario, String> {
        Ok(self.0.clone())
    }

    fn digest(&self) -> String {
        String::new()
    }
}

#[test]
fn agents_learn_to_do_what_is_rewarded() {
    let task = task(rewards_alone(0, 1.0));
    let source = Same::of(scenario(3), 16);
    let sample = task.prepare(&scenario(3), None).unwrap();
    let reward =
        |model: &Smart| -task.loss(model, std::slice::from_ref(&sample), None).loss.into_scalar::<f32>();
    let folder = tempfile::tempdir().unwrap();
    let learner = Learner {
        task: &task,
        source: &source,
        settings: Settings {
            epochs: 20.0,
            batch: 8,
            together: 4,
            learning_rate: 2e-3,
            warm_up: 0,
            held_out: 0.0,
            ..Settings::default()
        },
        execution: Execution {
            jobs: 2,
            checkpoint_every: std::time::Duration::from_secs(3600),
            keep_every: 0,
        },
        about: serde_json::Map::new(),
        closed_loop: None,
        observer: &(),
    };
    let outcome = learner.learn(folder.path(), false, &AtomicBool::new(false)).unwrap();
    let before = reward(&SmartPolicy::read(&untrained(), &device()).unwrap().network);
    let after = reward(&burn::module::Module::valid(&outcome.model));
    assert!(after > 0.8 * before, "reward {before} before and {after} after");
}
