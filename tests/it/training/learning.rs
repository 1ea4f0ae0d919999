//! What is learned.

use std::sync::atomic::AtomicBool;

use reactsim::training::{Learner, Outcome, Settings};

use super::toy::{Curve, Net, Toy, execution, settings};

fn learn(settings: Settings, jobs: usize) -> Outcome<Net> {
    let learner = Learner { task: &Toy, source: &Curve::of(64), settings, execution: execution(jobs) };
    learner.learn(&AtomicBool::new(false)).unwrap()
}

#[test]
fn a_toy_is_learned() {
    let outcome = learn(Settings { epochs: 200.0, ..settings() }, 1);
    assert!(outcome.loss < 0.01, "{}", outcome.loss);
}

#[test]
fn threads_change_no_bit() {
    let of = |jobs| learn(Settings { epochs: 5.0, ..settings() }, jobs).loss.to_bits();
    assert_eq!(of(1), of(2));
    assert_eq!(of(1), of(5));
}
