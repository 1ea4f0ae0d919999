//! Results of training.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;

use reactsim_nn::training::{Ending, NamedTensors, Observer, Row, Settings, TrainingError, kept_weights};

use super::toy::{Curve, Toy, Trial, left, settings};

#[test]
fn a_toy_is_learned() {
    let folder = tempfile::tempdir().unwrap();
    let trial =
        Trial { settings: Settings { epochs: 200.0, validate_every: 100, ..settings() }, ..Trial::default() };
    let outcome = trial.learn(folder.path(), false).unwrap();
    assert_eq!(outcome.ending, Ending::Finished);
    let best = outcome.best.unwrap();
    assert!(best.value < 0.01, "{best:?}");
    let (rows, weights) = left(folder.path());
    assert_eq!(weights.about["step"], best.step);
    assert_eq!(rows.last().unwrap().step(), outcome.steps);
    let Some(Row::Step(first)) = rows.first() else { panic!("no step first") };
    assert!(
        (first.learning_rate - 0.004).abs() < 1e-9 && first.loss.unwrap() > 0.1 && first.gradient_norm > 0.0
    );
    assert!(first.metrics["absolute_error"] > 0.1);
}

#[test]
fn threads_change_no_bit() {
    let of = |jobs| {
        let folder = tempfile::tempdir().unwrap();
        Trial { jobs, ..Trial::default() }.learn(folder.path(), false).unwrap();
        left(folder.path())
    };
    let alone = of(1);
    assert_eq!(alone, of(2));
    assert_eq!(alone, of(5));
}

#[test]
fn networks_on_the_way_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let trial = Trial { keep_every: 1, ..Trial::default() };
    let outcome = trial.learn(folder.path(), false).unwrap();
    let kept = kept_weights(folder.path()).unwrap();
    assert!(kept.iter().map(|(step, _)| *step).eq(0..=outcome.steps), "{kept:?}");
    let of = |step: u64| NamedTensors::read(&kept[step as usize].1).unwrap();
    let (best, (_, weights)) = (outcome.best.unwrap().step, left(folder.path()));
    assert_eq!(of(best).tensors, weights.tensors);
    assert_ne!(of(0).tensors, weights.tensors);
    assert_eq!(of(3).about["step"], 3);
    assert!(of(3).about.get("validation_loss").is_none(), "only the best one has been judged");
    // The same networks, if the training is interrupted and fewer are kept.
    let other = tempfile::tempdir().unwrap();
    let trial = Trial { keep_every: 5, ..Trial::default() };
    trial.learn_until(other.path(), false, &AtomicBool::new(true)).unwrap();
    trial.learn(other.path(), true).unwrap();
    for (step, path) in kept_weights(other.path()).unwrap() {
        assert!(step % 5 == 0 || step == outcome.steps, "{step} of {}", outcome.steps);
        assert_eq!(NamedTensors::read(&path).unwrap().tensors, of(step).tensors, "{step}");
    }
}

#[test]
fn a_training_that_gets_no_better_ends() {
    let folder = tempfile::tempdir().unwrap();
    let settings =
        Settings { learning_rate: 1e-12, patience: 2, validate_every: 3, epochs: 100.0, ..settings() };
    let trial = Trial { settings, ..Trial::default() };
    let outcome = trial.learn(folder.path(), false).unwrap();
    assert_eq!(outcome.ending, Ending::NoImprovement);
    assert!(outcome.steps < 60, "{}", outcome.steps);
    // The training stays ended.
    let again = trial.learn(folder.path(), true).unwrap();
    assert_eq!((again.ending, again.steps), (Ending::NoImprovement, outcome.steps));
}

#[test]
fn a_trained_network_stays_the_best_until_a_later_one_is_better() {
    let learned = |trained: bool, learning_rate: f64| {
        let folder = tempfile::tempdir().unwrap();
        let trial = Trial {
            task: Toy { trained },
            settings: Settings { learning_rate, ..settings() },
            ..Trial::default()
        };
        let best = trial.learn(folder.path(), false).unwrap().best.unwrap();
        let (rows, weights) = left(folder.path());
        assert_eq!(weights.about["step"], best.step);
        (best.step, rows[0].step(), weights.about["validation_loss"].as_f64().unwrap())
    };
    let (step, first, worse) = learned(false, 100.0);
    assert!(step > 0 && first == 1, "{step} {first}");
    let (step, first, kept) = learned(true, 100.0);
    assert!((step, first) == (0, 0) && kept < worse, "{step} {first} {kept} {worse}");
    assert!(learned(true, 0.02).0 > 0);
}

#[test]
fn what_is_measured_in_closed_loop_is_logged() {
    let folder = tempfile::tempdir().unwrap();
    let measure = |_: &_, step: u64| Ok(BTreeMap::from([("collisions".to_owned(), step as f64)]));
    let stop = AtomicBool::new(false);
    Trial::default().learn_with(folder.path(), false, &stop, Some(&measure)).unwrap();
    let (rows, _) = left(folder.path());
    let looks: Vec<f64> = rows
        .iter()
        .filter_map(|row| match row {
            Row::Validation(row) => Some(row.closed_loop["collisions"]),
            Row::Step(_) => None,
        })
        .collect();
    assert_eq!(looks[..3], [7.0, 14.0, 21.0]);
}

/// Records the ids of examples that are passed over.
#[derive(Default)]
struct Told(RefCell<Vec<String>>);

impl Observer for Told {
    fn passed_over(&self, id: &str) {
        self.0.borrow_mut().push(id.to_owned());
    }
}

#[test]
fn what_nothing_can_be_learned_from_is_passed_over_and_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let (told, mut source) = (Told::default(), Curve::of(64));
    source.empty = Some(9);
    Trial { source, observer: &told, ..Trial::default() }.learn(folder.path(), false).unwrap();
    assert_eq!(told.0.into_inner(), ["point-9"]);
}

#[test]
fn a_loss_that_is_no_number_ends_it_with_the_step_and_the_scenarios() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = Curve::of(64);
    source.poison = Some(30);
    let error = Trial { source, ..Trial::default() }.learn(folder.path(), false).unwrap_err();
    let text = error.to_string();
    assert!(text.starts_with("the loss is NaN at step ") && text.contains("point-30"), "{text}");
    let TrainingError::NotFinite { step, examples, .. } = error else { panic!("{text}") };
    assert_eq!(examples.len(), 2);
    // The last checkpoint stays.
    let last = super::toy::checkpoints(folder.path()).pop().unwrap();
    assert!(last.ends_with(format!("checkpoint-{:08}.safetensors", step - 1)), "{last:?}");
}

#[test]
fn an_example_that_can_not_be_read_ends_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = Curve::of(64);
    source.torn = Some(12);
    let error = Trial { source, ..Trial::default() }.learn(folder.path(), false).unwrap_err();
    assert_eq!(error.to_string(), "could not read point-12: the disk says no");
}

#[test]
fn data_without_anything_to_learn_are_refused() {
    let refusal = |source| {
        let folder = tempfile::tempdir().unwrap();
        Trial { source, ..Trial::default() }.learn(folder.path(), false).unwrap_err().to_string()
    };
    assert_eq!(
        refusal(Curve::of(0)),
        "there is nothing to learn from: no scenario is left to train on (0 held out)"
    );
    let wrong = Trial { settings: Settings { batch: 0, ..settings() }, ..Trial::default() };
    let folder = tempfile::tempdir().unwrap();
    let error = wrong.learn(folder.path(), false).unwrap_err();
    assert_eq!(error.to_string(), "batch is 0, expected 1 to 65536");
}
