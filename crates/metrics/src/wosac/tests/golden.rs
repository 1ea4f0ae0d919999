//! Agreement with results of the official code. The recordings and results may not be distributed; where they
//! are missing, these tests are skipped with a message.
#![expect(clippy::print_stdout, reason = "the largest differences are shown with `--nocapture`")]

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use reactsim_formats::wosac::{WosacLogs, decode_rollouts};
use reactsim_scene::{
    FUTURE,
    wosac::{ScenarioRollouts, WosacLog},
};
use reactsim_test_support::shared;
use serde_json::Value;

use super::super::*;

/// Tolerance of every result.
const TOLERANCE: f64 = 1e-6;

fn decompress(path: &Path) -> Vec<u8> {
    let mut content = Vec::new();
    let mut decoder = zstd::stream::read::Decoder::new(File::open(path).unwrap()).unwrap();
    decoder.window_log_max(27).unwrap();
    decoder.read_to_end(&mut content).unwrap();
    content
}

/// A scenario with rollouts and the results of the official code.
pub(super) struct Golden {
    pub(super) log: WosacLog,
    pub(super) rollouts: ScenarioRollouts,
    expected: Value,
}

pub(super) fn all() -> Vec<Golden> {
    let Some(folder) = shared("wosac_golden") else { return Vec::new() };
    let index: Value = serde_json::from_slice(&std::fs::read(folder.join("index.json")).unwrap()).unwrap();
    let mut shards: BTreeMap<String, Vec<(usize, String)>> = BTreeMap::new();
    let mut golden = Vec::new();
    let load = |id: &str, log: WosacLog| Golden {
        log,
        rollouts: decode_rollouts(&decompress(&folder.join(format!("{id}.rollouts.binproto.zst")))).unwrap(),
        expected: serde_json::from_slice(&decompress(&folder.join(format!("{id}.expected.json.zst"))))
            .unwrap(),
    };
    for scenario in index["scenarios"].as_array().unwrap() {
        let id = scenario["scenario_id"].as_str().unwrap();
        match scenario["shard"].as_str() {
            Some(shard) => {
                let at = scenario["position"].as_u64().unwrap() as usize;
                let path = format!("{}/{shard}", scenario["split"].as_str().unwrap());
                shards.entry(path).or_default().push((at, id.to_owned()));
            }
            None => {
                let path = folder.join(format!("{id}.scenario.binproto.zst"));
                golden.push(load(id, WosacLogs::open(&path).unwrap().next().unwrap().unwrap()));
            }
        }
    }
    for (shard, scenarios) in shards {
        let Some(path) = shared(&format!("data/womd/{shard}.zst")) else { continue };
        for (position, log) in WosacLogs::open(&path).unwrap().enumerate() {
            if let Some((_, id)) = scenarios.iter().find(|(at, _)| *at == position) {
                golden.push(load(id, log.unwrap()));
            }
        }
    }
    golden
}

/// Largest difference found, with its place.
#[derive(Default)]
struct Largest(f64, String);

impl Largest {
    fn add(&mut self, found: f64, expected: f64, place: impl Fn() -> String) {
        let difference = (found - expected).abs();
        if difference > self.0 {
            *self = Self(difference, place());
        }
    }
}

#[test]
fn every_result_agrees() {
    let mut largest: BTreeMap<&str, Largest> = BTreeMap::new();
    for Golden { log, rollouts, expected } in all() {
        let scorer = Scorer::new(&log).unwrap();
        let results = scorer.score(&rollouts, &Config::ALL).unwrap();
        for (config, result) in Config::ALL.iter().zip(results) {
            let groups = [("metrics", result.fields()), ("buckets", result.buckets(config).to_vec())];
            for (group, fields) in groups {
                let expected = &expected[config.id][group];
                let known = expected.as_object().unwrap().len() - usize::from(group == "metrics");
                assert_eq!(fields.iter().filter(|(_, value)| value.is_some()).count(), known);
                for (name, value) in fields {
                    let place = || format!("{} {} {group} {name}", log.scenario_id, config.id);
                    let expected = expected[name].as_f64();
                    assert_eq!(value.is_some(), expected.is_some(), "{}", place());
                    let (Some(value), Some(expected)) = (value, expected) else { continue };
                    largest.entry(name).or_default().add(value, expected, place);
                }
            }
        }
    }
    for (name, Largest(difference, place)) in &largest {
        println!("{name}: {difference:.1e} ({place})");
    }
    let beyond: Vec<_> = largest.iter().filter(|(_, largest)| largest.0 > TOLERANCE).collect();
    assert!(beyond.is_empty(), "{:?}", beyond.iter().map(|(n, l)| (n, l.0, &l.1)).collect::<Vec<_>>());
}

#[test]
fn every_histogram_agrees() {
    for Golden { log, rollouts, expected } in all() {
        let scorer = Scorer::new(&log).unwrap();
        let tallies = scorer.tally(&rollouts, &Config::ALL, &mut |_| ()).unwrap();
        for config in [Config::CHALLENGE_2025, Config::CONFIG_2023] {
            for feature in Feature::ALL {
                let Estimator::Histogram(bins) = config.estimators[feature as usize] else { continue };
                let histograms = tallies.all.histograms(feature, bins).unwrap();
                let expected = &expected["histogram_counts"][config.id][feature.name()];
                for object in 0..scorer.evaluated().len() {
                    let expected: Vec<u32> = serde_json::from_value(expected[object].clone()).unwrap();
                    let id = &log.scenario_id;
                    assert_eq!(histograms.counts(object), expected, "{id} {} {}", config.id, feature.name());
                }
            }
        }
        let expected: Vec<Vec<f64>> =
            serde_json::from_value(expected["ade_per_rollout_object"].clone()).unwrap();
        for (found, expected) in tallies.displacements.iter().flatten().zip(expected.iter().flatten()) {
            assert!((found - expected).abs() < 2e-6 * expected.max(1.0), "{found}, expected {expected}");
        }
    }
}

/// Tolerances of the features at single steps.
const STEP_TOLERANCES: [(Feature, f64); 7] = [
    (Feature::LinearSpeed, 5e-6),
    (Feature::LinearAcceleration, 5e-5),
    (Feature::AngularSpeed, 2e-6),
    (Feature::AngularAcceleration, 2e-5),
    (Feature::DistanceToNearestObject, 3e-4),
    (Feature::TimeToCollision, 2e-6),
    (Feature::DistanceToRoadEdge, 1e-4),
];

#[test]
fn every_step_agrees() {
    let mut largest: BTreeMap<&str, Largest> = BTreeMap::new();
    for Golden { log, rollouts, expected } in all() {
        let scorer = Scorer::new(&log).unwrap();
        let ids: Vec<i32> = serde_json::from_value(expected["object_id"].clone()).unwrap();
        assert_eq!(scorer.evaluated(), ids);
        let index = expected["rollout_index"].as_u64().unwrap() as usize;
        let simulated = scorer.features(&rollouts).unwrap();
        let valid: Vec<Vec<u8>> = serde_json::from_value(expected["log_features"]["valid"].clone()).unwrap();
        let sets = [("log_features", scorer.logged_features()), ("rollout_features", &simulated[index])];
        for (set, features) in sets {
            for object in 0..ids.len() {
                // Of the log, states whose neighbours are invalid have no meaning.
                let is_judged = |k: usize, reach: usize| {
                    let frames = k.saturating_sub(reach)..=(k + reach).min(FUTURE - 1);
                    set == "rollout_features" || k >= reach && frames.clone().all(|k| valid[object][k] == 1)
                };
                for (feature, tolerance) in STEP_TOLERANCES {
                    let reach = match feature {
                        Feature::LinearAcceleration | Feature::AngularAcceleration => 2,
                        Feature::LinearSpeed | Feature::AngularSpeed => 1,
                        _ => 0,
                    };
                    let expected = &expected[set][feature.name()][object];
                    let found = features[object].values(feature).unwrap();
                    for (k, &found) in found.iter().enumerate().filter(|&(k, _)| is_judged(k, reach)) {
                        let place = || {
                            format!("{} {set} {} object {object} step {k}", log.scenario_id, feature.name())
                        };
                        match expected[k].as_f64() {
                            None => assert!(found.is_nan(), "{}: {found}", place()),
                            Some(expected) => {
                                // Garbage far from the unit of the feature is compared relatively.
                                let scale = expected.abs().max(100.0) / 100.0;
                                let difference = (f64::from(found) - expected).abs() / scale;
                                assert!(difference <= tolerance, "{}: {found}, expected {expected}", place());
                                largest.entry(feature.name()).or_default().add(difference, 0.0, place);
                            }
                        }
                    }
                }
                for (event, name) in [
                    (Feature::CollisionIndication, "collision_per_step"),
                    (Feature::OffroadIndication, "offroad_per_step"),
                    (Feature::TrafficLightViolation, "traffic_light_violation_per_step"),
                ] {
                    for k in (0..FUTURE).filter(|&k| is_judged(k, 0)) {
                        let expected = expected[set][name][object][k].as_u64().unwrap() == 1;
                        let found = features[object].has_event(event, k);
                        assert_eq!(
                            found, expected,
                            "{} {set} {name} object {object} step {k}",
                            log.scenario_id
                        );
                    }
                }
            }
        }
        let sums = &expected["sum_over_steps_per_rollout_object"];
        for (feature, _) in STEP_TOLERANCES {
            for (r, features) in simulated.iter().enumerate() {
                for (object, features) in features.iter().enumerate() {
                    let values = features.values(feature).unwrap().iter().filter(|value| !value.is_nan());
                    let found: f64 = values.map(|&value| f64::from(value)).sum();
                    let expected = sums[feature.name()][r][object].as_f64().unwrap();
                    let scale = expected.abs().max(1000.0) / 1000.0;
                    assert!(
                        (found - expected).abs() / scale < 2e-2,
                        "{} {} rollout {r} object {object}: {found}, expected {expected}",
                        log.scenario_id,
                        feature.name()
                    );
                }
            }
        }
    }
    for (name, Largest(difference, place)) in &largest {
        println!("{name}: {difference:.1e} ({place})");
    }
}
