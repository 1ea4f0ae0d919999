//! Diffusion-Planner: its training, its plans, and refusals.

use std::collections::BTreeMap;

use burn::module::Module;
use rand_chacha::rand_core::SeedableRng;
use reactsim::models::diffusion_planner::learn::{Planning, Recipe};
use reactsim::models::diffusion_planner::network::PlannerConfig;
use reactsim::models::diffusion_planner::{PlannerPolicy, PlannerSight};
use reactsim::models::nn::device;
use reactsim::rollout::Observation;
use reactsim::scene::{AgentState, Scenario};
use reactsim::training::{Stream, Task};

use crate::model_weights::{check_learning, check_refusals};
use crate::ntp_reactive::{moved, scenarios};

/// Returns small sizes that differ wherever they can.
fn small() -> Recipe {
    Recipe {
        network: PlannerConfig {
            width: 16,
            heads: 2,
            encoder_depth: 1,
            decoder_depth: 1,
            history: 5,
            agents: 6,
            statics: 2,
            lanes: 8,
            points: 4,
            predicted: 3,
            states: 8,
            ..PlannerConfig::default()
        },
        draws: 2,
        ..Recipe::default()
    }
}

fn task() -> Planning {
    Planning::new(small(), &device())
}

fn policy() -> PlannerPolicy {
    let task = task();
    task.policy(&task.init(1).valid())
}

pub(crate) fn untrained() -> Vec<u8> {
    policy().write(&BTreeMap::new()).unwrap()
}

#[test]
fn every_part_that_is_used_learns() {
    // There is no route, and no box stands in these scenes. A constant added to all scores changes nothing.
    let wanted = |name: &String| !name.contains("route_encoder") && !name.contains("static_encoder");
    let still: Vec<String> = check_learning(&task()).into_iter().filter(wanted).collect();
    assert!(still.is_empty(), "{still:?}");
}

fn plans(scenario: &Scenario, temperature: f64, seeds: [u64; 2]) -> Vec<Vec<AgentState>> {
    let mut streams = seeds.map(Stream::seed_from_u64);
    let start = &scenario.start;
    let seen = Observation::new(start, &start.history, &start.light_history, None);
    policy().plans(&seen, temperature, &mut streams, &device())
}

#[test]
fn plans_differ_by_their_noise_alone() {
    let scenario = &scenarios(1)[0];
    let found = plans(scenario, 1.0, [1, 2]);
    assert_eq!(found.iter().map(Vec::len).collect::<Vec<_>>(), [80, 80]);
    assert!(found == plans(scenario, 1.0, [1, 2]));
    assert!(found[0] != found[1]);
    assert!(found[0] != plans(scenario, 0.5, [1, 2])[0]);
    let still = plans(scenario, 0.0, [1, 2]);
    assert_eq!(still[0], still[1]);
}

#[test]
fn plans_do_not_depend_on_the_frame_of_reference() {
    let scenario = &scenarios(1)[0];
    let (turn, shift) = (0.7, reactsim::geometry::Vec2::new(120.0, -35.0));
    let there = moved(scenario.clone(), turn, shift);
    let (here, there) = (plans(scenario, 1.0, [1, 2]), plans(&there, 1.0, [1, 2]));
    // Later on, the vehicle follows an untrained plan forwards or backwards, as rounding will have it.
    let first = |plans: &[Vec<AgentState>]| -> Vec<AgentState> {
        plans.iter().flat_map(|plan| plan.iter().take(15).copied()).collect()
    };
    for (a, b) in first(&here).iter().zip(&first(&there)) {
        let axis = reactsim::geometry::direction(turn);
        let expected = reactsim::geometry::Vec2::new(
            axis.x * a.x - axis.y * a.y + shift.x,
            axis.y * a.x + axis.x * a.y + shift.y,
        );
        // The heading of a slow vehicle magnifies rounding; a fault of the frame would be metres.
        assert!((expected - b.position()).norm() < 0.2, "{expected} {b:?}");
    }
}

#[test]
fn a_file_gives_the_same_policy_and_foreign_and_damaged_ones_are_refused() {
    let good = untrained();
    let read = PlannerPolicy::read(&good, &device()).unwrap();
    assert_eq!((read.config, read.sight), (small().network, small().sight));
    assert_eq!(read.write(&BTreeMap::new()).unwrap(), good);
    check_refusals(&good, |bytes| PlannerPolicy::read(bytes, &device()).unwrap_err().to_string());
    for (config, field) in [
        (PlannerConfig { states: 7, ..small().network }, "states"),
        (PlannerConfig { width: 15, ..small().network }, "width"),
        (PlannerConfig { predicted: 6, ..small().network }, "predicted"),
        (PlannerConfig { points: 1, ..small().network }, "points"),
    ] {
        assert_eq!(config.check().unwrap_err().field, field);
    }
    assert_eq!(PlannerConfig::published().check(), Ok(()));
    assert_eq!(PlannerConfig::default().check(), Ok(()));
    assert!(!PlannerSight::published().av_row);
}
