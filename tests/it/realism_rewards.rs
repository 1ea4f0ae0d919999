//! Fine-tuning by realism: what makes the rollouts of a scenario more realistic becomes likelier.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use reactsim::models::learning::{Trainable, Training};
use reactsim::models::nn::device;
use reactsim::models::ntp::realism::{Features, RealismRecipe, Weights, realism};
use reactsim::scene::Length;
use reactsim::training::{Ending, Execution, Observer, Row, Settings, read_log};

use crate::small_scenarios::scenario;
use crate::smart_rewards::Same;
use crate::{ntp_reactive, smart_simulator};

/// Sets a flag after a number of steps.
struct StopsAfter<'a>(u64, &'a AtomicBool);

impl Observer for StopsAfter<'_> {
    fn row(&self, row: &Row) {
        if row.step() >= self.0 {
            self.1.store(true, Ordering::Relaxed);
        }
    }
}

fn task(weights: &[u8], reactions: f64, rollouts: usize) -> Box<dyn Trainable> {
    let recipe = RealismRecipe {
        rollouts,
        agents: 8,
        features: Features::All,
        weights: Weights { realism: 1.0, reactions, kl: 0.01 },
    };
    realism(recipe, weights, String::new(), &device()).unwrap()
}

/// Trains in a folder until a step, after which it may go on.
fn learn(
    task: &dyn Trainable,
    source: &Same,
    (folder, epochs, held_out): (&Path, f64, f64),
    (jobs, resume, until): (usize, bool, u64),
) -> Result<Ending, String> {
    let settings = Settings {
        epochs,
        batch: 4,
        learning_rate: 3e-3,
        floor: 1.0,
        warm_up: 0,
        weight_decay: 0.0,
        held_out,
        validate_every: 1000,
        ..Settings::default()
    };
    let stop = AtomicBool::new(false);
    let outcome = task.learn(Training {
        source,
        settings,
        execution: Execution { jobs, checkpoint_every: Duration::from_secs(3600), keep_every: 0 },
        about: serde_json::Map::new(),
        measure: None,
        observer: &StopsAfter(until, &stop),
        folder,
        resume,
        stop: &stop,
    });
    outcome.map(|outcome| outcome.ending).map_err(|error| error.to_string())
}

/// Returns the rewards of the validations of a training.
fn rewards(folder: &Path) -> Vec<f64> {
    let rows = read_log(&folder.join("log.jsonl")).unwrap();
    let reward = |row: &Row| match row {
        Row::Validation(row) => Some(row.metrics["reward"]),
        Row::Step(_) => None,
    };
    rows.iter().filter_map(reward).collect()
}

/// Returns the metrics of the first step of a training.
fn first_step(folder: &Path) -> BTreeMap<String, f64> {
    let rows = read_log(&folder.join("log.jsonl")).unwrap();
    let metrics = |row: Row| match row {
        Row::Step(row) => Some(row.metrics),
        Row::Validation(_) => None,
    };
    rows.into_iter().find_map(metrics).unwrap()
}

#[test]
fn what_is_realistic_becomes_likelier() {
    let source = Same::of(scenario(3), 12);
    for (weights, reactions) in [(ntp_reactive::untrained(), 0.0), (smart_simulator::untrained(), 1.0)] {
        let folder = tempfile::tempdir().unwrap();
        let task = task(&weights, reactions, 12);
        let ended = learn(task.as_ref(), &source, (folder.path(), 8.0, 0.1), (2, false, 1000));
        assert_eq!(ended, Ok(Ending::Finished));
        // The network is still that of the beginning, and learns from the scores by which it drove.
        let first = first_step(folder.path());
        assert!(first["divergence"].abs() < 1e-5 && first["entropy"] > 0.1, "{first:?}");
        let rewards = rewards(folder.path());
        let [before, after] = rewards[..] else { panic!("{rewards:?}") };
        assert!(after > before + 0.02, "reward {before} before and {after} after");
    }
}

#[test]
fn an_interrupted_training_ends_as_another_one() {
    let source = Same::of(scenario(3), 12);
    let task = task(&ntp_reactive::untrained(), 1.0, 4);
    let (one, two) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (whole, parts) = (one.path(), two.path());
    assert_eq!(learn(task.as_ref(), &source, (whole, 2.0, 0.0), (1, false, 1000)), Ok(Ending::Finished));
    assert_eq!(learn(task.as_ref(), &source, (parts, 2.0, 0.0), (2, false, 2)), Ok(Ending::Interrupted));
    assert_eq!(learn(task.as_ref(), &source, (parts, 2.0, 0.0), (2, true, 1000)), Ok(Ending::Finished));
    let weights = |folder: &Path| fs::read(folder.join("weights.safetensors")).unwrap();
    assert_eq!(weights(whole), weights(parts));
}

#[test]
fn other_lengths_and_other_weights_are_refused_by_name() {
    let mut short = scenario(3);
    for track in &mut short.log_future.tracks {
        track.truncate(40);
    }
    short.log_future.lights.iter_mut().for_each(|states| states.truncate(40));
    assert_ne!(short.length(), Length::BENCHMARK);
    let folder = tempfile::tempdir().unwrap();
    let task = task(&ntp_reactive::untrained(), 1.0, 4);
    let refused =
        learn(task.as_ref(), &Same::of(short, 12), (folder.path(), 1.0, 0.0), (1, false, 1)).unwrap_err();
    assert!(refused.contains("road-003") && refused.contains("no other length"), "{refused}");

    let recipe = RealismRecipe::default();
    let other = realism(recipe, b"no weights", String::new(), &device()).err().unwrap();
    assert!(other.contains("neither of `ntp-reactive`"), "{other}");
}
