//! Parameters of the cards: each has a unit and a range; values outside it are refused, and simulators run
//! with values inside it.

mod attack;
mod values;

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reactsim::metrics::Options;
use reactsim::models::{Allowed, Baseline, MODELS, ModelError, ParameterRange, Ranges, Setup, find, qp};
use reactsim::rollout::{Controller, Settings, roll_out};
use reactsim::scene::Scenario;
use toml::{Table, Value};

use self::values::{accepts, values};
use crate::model_weights::untrained;
use crate::program::{refused, said, text};
use crate::scenes::{mini, request};

/// Returns the setup of a baseline, with untrained weights if its own do not ship.
fn setup(model: &Baseline) -> Setup {
    let mut setup = model.setup().unwrap();
    if model.needs_weights && setup.weights.is_none() {
        setup.weights = untrained(model.id);
    }
    setup
}

/// Returns the dotted paths of the values of a table.
fn paths(table: &Table) -> Vec<String> {
    let inner = |(key, value): (&String, &Value)| match value.as_table() {
        Some(inner) => paths(inner).into_iter().map(|path| format!("{key}.{path}")).collect(),
        None => vec![key.clone()],
    };
    table.iter().flat_map(inner).collect()
}

/// Returns the ranges of a setup.
fn ranges(setup: &Setup) -> Vec<(String, ParameterRange)> {
    setup.parameters.ranges().unwrap().into_iter().map(|(key, _, range)| (key, range.clone())).collect()
}

#[test]
fn every_parameter_has_a_range_that_holds_its_value() {
    let cards = MODELS.iter().map(|m| (m.id, m.card, m.ranges)).chain([("qp", qp::CARD, qp::RANGES)]);
    let mut checked = 0;
    for (id, card, text) in cards {
        let setup = Setup::new(id, card, text, None).unwrap();
        let parameters: BTreeSet<String> = paths(setup.parameters.values()).into_iter().collect();
        let ranges = Ranges::read(id, text).unwrap();
        let entries: BTreeSet<String> = ranges.keys().map(str::to_owned).collect();
        assert_eq!(parameters, entries, "{id}: the parameters and the entries of the ranges differ");
        for (key, value, range) in setup.parameters.ranges().unwrap() {
            assert!(range.allowed.contains(value), "{id}: {key} is {value}, not {range}");
            assert!(!range.unit.trim().is_empty(), "{id}: {key} has no unit");
            assert!(range.about.ends_with('.') && range.about.len() < 80, "{id}: {key}: {}", range.about);
            checked += 1;
        }
        setup.parameters::<Table>().unwrap();
    }
    assert!(checked > 80, "only {checked} parameters found");
}

#[test]
fn values_are_accepted_if_they_are_within_the_range() {
    for model in MODELS {
        let fresh = model.setup().unwrap();
        for (key, range) in ranges(&fresh) {
            for value in values(&range.allowed, &format!("{} {key}", model.id)) {
                let mut setup = fresh.clone();
                match setup.parameters.set(&key, &value) {
                    Ok(_) => {
                        assert!(accepts(&range.allowed, &value), "{}: {key}={value} is accepted", model.id);
                        setup.parameters::<Table>().unwrap();
                    }
                    Err(error) => {
                        assert!(!accepts(&range.allowed, &value), "{}: {key}={value}: {error}", model.id);
                        let text = error.to_string();
                        assert!(text.contains(&format!("`{key}`")) && text.contains(&value), "{text}");
                        assert_eq!(setup.parameters, fresh.parameters, "{}: {key}={value}", model.id);
                    }
                }
            }
        }
    }
}

/// Returns the smallest and the largest value of a range.
fn bounds(allowed: &Allowed) -> Vec<String> {
    match allowed {
        Allowed::Floats { min, max } => vec![format!("{min:?}"), format!("{max:?}")],
        Allowed::Integers { min, max } => vec![min.to_string(), max.to_string()],
        Allowed::Flags => vec!["false".to_owned(), "true".to_owned()],
        Allowed::Texts(texts) => texts.clone(),
    }
}

/// Builds a simulator. Parameters that conflict with one of `kept` are moved to the bound that fits.
fn build(model: &Baseline, mut setup: Setup, kept: &[&str]) -> Controller {
    let of = |setup: &Setup, key: &str, last: bool| {
        let ranges = ranges(setup);
        let range = &ranges.iter().find(|(k, _)| k == key).unwrap().1;
        let bounds = bounds(&range.allowed);
        bounds[if last { bounds.len() - 1 } else { 0 }].clone()
    };
    for _ in 0..10 {
        match (model.make)(setup.clone()) {
            Ok(controller) => return controller,
            Err(ModelError::Order { lower, upper, .. }) => {
                let (key, last) = if kept.contains(&lower) { (upper, true) } else { (lower, false) };
                let bound = of(&setup, key, last);
                setup.parameters.set(key, &bound).unwrap();
            }
            Err(error) => panic!("{}: {error}", model.id),
        }
    }
    panic!("{}: no values fit to {kept:?}", model.id);
}

/// Rolls out scenarios. Returns a message if that fails or ends in states that are not finite.
fn drive(scenarios: &[Scenario], controller: &Controller) -> Result<(), String> {
    let rolled = catch_unwind(AssertUnwindSafe(|| {
        let requests = scenarios.iter().map(|s| request(s, s.deviation.as_ref().unwrap().track.clone(), 0));
        roll_out(requests.collect(), controller, &Settings::default())
    }));
    for rollout in rolled.map_err(|_| "panics".to_owned())? {
        let rollout = rollout.map_err(|error| error.to_string())?;
        if rollout.tracks.iter().flatten().flatten().any(|state| !state.is_finite()) {
            return Err("states are no numbers".to_owned());
        }
    }
    Ok(())
}

/// Returns the baselines without a network.
fn rules() -> impl Iterator<Item = &'static Baseline> {
    MODELS.iter().filter(|m| !m.needs_weights && !m.ranges.is_empty())
}

#[test]
fn rules_drive_at_every_bound() {
    let scenarios = mini();
    for model in rules() {
        let fresh = setup(model);
        for (key, range) in ranges(&fresh) {
            for value in bounds(&range.allowed) {
                let mut setup = fresh.clone();
                setup.parameters.set(&key, &value).unwrap();
                let controller = build(model, setup, &[&key]);
                drive(&scenarios, &controller).unwrap_or_else(|e| panic!("{}: {key}={value}: {e}", model.id));
            }
        }
    }
}

#[test]
fn networks_are_built_at_every_bound() {
    for model in MODELS.iter().filter(|m| m.needs_weights) {
        let fresh = setup(model);
        for (key, range) in ranges(&fresh) {
            for value in bounds(&range.allowed) {
                let mut setup = fresh.clone();
                setup.parameters.set(&key, &value).unwrap();
                build(model, setup, &[&key]);
            }
        }
    }
}

/// Drives with all parameters drawn at once from their ranges, a third of them from the bounds.
fn drive_drawn_settings(count: u64) {
    let scenarios = mini();
    for model in rules() {
        let fresh = setup(model);
        for seed in 0..count {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut setup = fresh.clone();
            for (key, range) in ranges(&fresh) {
                let bounds = bounds(&range.allowed);
                let value = match &range.allowed {
                    Allowed::Floats { min, max } if rng.random_range(0..3) > 0 => {
                        format!("{:?}", rng.random_range(*min..=*max))
                    }
                    _ => bounds[rng.random_range(0..bounds.len())].clone(),
                };
                setup.parameters.set(&key, &value).unwrap();
            }
            let controller = build(model, setup, &[]);
            drive(&scenarios, &controller).unwrap_or_else(|e| panic!("{}, seed {seed}: {e}", model.id));
        }
    }
}

#[test]
fn rules_drive_with_values_drawn_from_all_ranges() {
    drive_drawn_settings(8);
}

#[test]
#[ignore = "takes minutes"]
fn rules_drive_with_many_values_drawn_from_all_ranges() {
    drive_drawn_settings(1000);
}

#[test]
fn parameters_that_do_not_fit_together_are_named() {
    for (id, key, value, text) in [
        (
            "idm",
            "conflict.horizon",
            "0.2",
            "idm: `conflict.sample` is 0.3, expected at most `conflict.horizon`, which is 0.2",
        ),
        ("idm", "conflict.av_horizon", "0.2", "`conflict.av_horizon`, which is 0.2"),
        (
            "idm",
            "vehicle.deceleration",
            "6",
            "expected at most `limits.emergency_deceleration`, which is 5.5",
        ),
        ("idm", "cyclist.deceleration", "6", "`cyclist.deceleration` is 6, expected at most"),
        ("idm", "limits.jerk", "26", "expected at most `limits.emergency_jerk`, which is 25"),
        ("pufferdrive", "goal_nearest", "61", "expected at most `goal_farthest`, which is 60"),
    ] {
        let model = find(id).unwrap();
        let mut setup = setup(model);
        setup.parameters.set(key, value).unwrap();
        let Err(error) = (model.make)(setup) else { panic!("{key}={value} is accepted") };
        assert!(error.to_string().contains(text), "{error}");
    }
}

#[test]
fn the_program_refuses_values_out_of_range_before_the_first_scenario() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for (command, set, part) in [
        (&["run"][..], "idm.limits.jerk=-1", "idm: `limits.jerk` is -1, expected 0.1 to 200 m/s³"),
        (&["run"], "idm.vehicle.headway=-2", "hint: `reactsim list parameters idm` shows"),
        (&["study", "replan"], "stop.deceleration=-1", "stop: `deceleration` is -1, expected 0.1 to 20 m/s²"),
        (&["study", "guards"], "stop.deceleration=-1", "stop: `deceleration` is -1, expected 0.1 to 20 m/s²"),
    ] {
        let id = set.split('.').next().unwrap();
        let rest = ["--limit", "1", "--models", id, "--set", set, "--out", text(&out)];
        let error = refused(&[command, &rest].concat());
        assert!(error.contains(part), "{command:?} {set}: {error}");
        assert!(!out.exists(), "{command:?} {set}");
    }
}

#[test]
fn lists_show_parameters_and_metric_options() {
    let list = |arguments: &[&str]| said(&[&["list"], arguments].concat(), 0).0;
    for model in MODELS.iter().filter(|m| !m.ranges.is_empty()) {
        let text = list(&["parameters", model.id]);
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
        for (key, _) in ranges(&setup(model)) {
            assert!(text.lines().any(|line| line.starts_with(&format!("{key} "))), "{key} is not in\n{text}");
        }
    }
    let text = list(&["parameters", "stop"]);
    let row = "deceleration  3.4    m/s²  0.1 to 20  Deceleration of every agent.";
    assert!(text.contains(row), "{row} is not in\n{text}");
    let error = refused(&["list", "parameters", "nobody"]);
    let expected = "there is no simulator `nobody`; those with parameters are stop, idm,";
    assert!(error.contains(expected), "{error}");

    let text = list(&["metric-options"]);
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    for name in Options::NAMES {
        assert!(text.lines().any(|line| line.starts_with(&format!("{name} "))), "{name} is not in\n{text}");
    }
}
